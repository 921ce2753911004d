#pragma once

#include <string>
#include <vector>

#include <CLI/App.hpp>

#include "tools/can/bus_session.h"

namespace faultline {

/// `faultline can`: dump, stats, decode, convert, dbc check.
void add_can_command(CLI::App& program, int& exit_code);

// Its parts; each adds itself to `parent`.
void add_convert_command(CLI::App& parent, int& exit_code);
void add_dbc_check_command(CLI::App& parent, int& exit_code);
void add_decode_command(CLI::App& parent, int& exit_code);
void add_dump_command(CLI::App& parent, int& exit_code);
void add_stats_command(CLI::App& parent, int& exit_code);

/// Adds `--seconds` and `--count`.
void add_limit_options(CLI::App& command, SessionLimits& limits);

/// Adds `--filter F..` (FrameFilter).
void add_filter_option(CLI::App& command, std::vector<std::string>& filters);

}  // namespace faultline
