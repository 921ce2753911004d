#include "tools/log/log_command.h"

#include <CLI/Validators.hpp>

#include "tools/cli.h"

namespace faultline {

void add_log_files(CLI::App& command, std::vector<std::string>& files) {
  command
      .add_option(
          "FILE", files,
          "LCM log, a run's own or lcm-logger's; several: one log that was split, in order; "
          "-: stdin")
      ->required()
      ->check(CLI::ExistingFile | CLI::IsMember({"-"}));
}

void add_log_command(CLI::App& program, int& exit_code) {
  CLI::App* log = program.add_subcommand("log", "Look at LCM logs, prove them complete, cut them");
  log->require_subcommand(1);
  log->footer(kExitCodesHelp);
  add_log_info_command(*log, exit_code);
  add_log_check_command(*log, exit_code);
  add_log_cut_command(*log, exit_code);
  add_log_export_command(*log, exit_code);
}

}  // namespace faultline
