#pragma once

#include <cstdio>
#include <string>
#include <vector>

#include <CLI/App.hpp>
#include <nlohmann/json_fwd.hpp>

namespace faultline {

/// `faultline log`: info, check, cut, export.
void add_log_command(CLI::App& program, int& exit_code);

// Its parts; each adds itself to `parent`.
void add_log_check_command(CLI::App& parent, int& exit_code);
void add_log_cut_command(CLI::App& parent, int& exit_code);
void add_log_export_command(CLI::App& parent, int& exit_code);
void add_log_info_command(CLI::App& parent, int& exit_code);

/// Adds `FILE..`: the files of one log, in order.
void add_log_files(CLI::App& command, std::vector<std::string>& files);

/// What is in a log, for people on `out`. @return the same as data.
nlohmann::ordered_json print_log_info(std::FILE* out, const std::vector<std::string>& files);

}  // namespace faultline
