#pragma once

#include <CLI/App.hpp>

namespace faultline {

// One node of the bench as a process of its own, and what is done to it while it runs. Each adds
// itself to the program; `exit_code` is what it answered.
void add_plant_command(CLI::App& program, int& exit_code);
void add_controller_command(CLI::App& program, int& exit_code);
void add_inject_command(CLI::App& program, int& exit_code);

}  // namespace faultline
