#include "tools/can/can_command.h"

#include <CLI/Validators.hpp>

#include "tools/cli.h"

namespace faultline {

void add_filter_option(CLI::App& command, std::vector<std::string>& filters) {
  command
      .add_option(
          "--filter", filters,
          "Only these frames: identifiers (110, 18FEF100), ranges (100-1FF), masks (100/7F0), "
          "names of the DBC's messages (Sensors*)")
      ->type_name("F");
}

void add_limit_options(CLI::App& command, SessionLimits& limits) {
  command.add_option("--seconds", limits.seconds, "End after so many seconds")
      ->check(CLI::PositiveNumber)
      ->check(check_finite);
  command.add_option("-n,--count", limits.frames, "End after so many frames")
      ->check(CLI::PositiveNumber);
}

void add_can_command(CLI::App& program, int& exit_code) {
  CLI::App* can = program.add_subcommand("can", "Look at CAN buses, logs of frames and DBC files");
  can->require_subcommand(1);
  can->footer(kExitCodesHelp);
  add_dump_command(*can, exit_code);
  add_stats_command(*can, exit_code);
  add_decode_command(*can, exit_code);
  add_convert_command(*can, exit_code);
  CLI::App* dbc = can->add_subcommand("dbc", "Look at DBC files");
  dbc->require_subcommand(1);
  add_dbc_check_command(*dbc, exit_code);
}

}  // namespace faultline
