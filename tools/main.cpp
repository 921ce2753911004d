#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <string>

#include <fcntl.h>
#include <unistd.h>

#include <CLI/CLI.hpp>

#include "tools/can/can_command.h"
#include "tools/cli.h"
#include "tools/error_answer.h"
#include "tools/log/log_command.h"
#include "tools/node_commands.h"
#include "tools/version.h"

namespace faultline {
namespace {

/// A file opened while a standard stream is closed would take its place, and what is printed would
/// end up in a log.
void open_standard_streams() {
  for (const int stream : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO}) {
    // open() takes the lowest free number: the one found closed.
    if (::fcntl(stream, F_GETFD) == -1) static_cast<void>(::open("/dev/null", O_RDWR));
  }
}

int run_program(int argc, char** argv) {
  CLI::App program("Hardware-in-the-loop bench for model-based fault diagnosis.", "faultline");
  program.set_version_flag("--version", std::string("faultline ") + kVersion);
  program.require_subcommand(1);
  program.footer(kExitCodesHelp);
  int exit_code = kExitYes;
  add_run_command(program, exit_code);
  add_calibrate_command(program, exit_code);
  add_campaign_command(program, exit_code);
  add_score_command(program, exit_code);
  add_plant_command(program, exit_code);
  add_controller_command(program, exit_code);
  add_diagnose_command(program, exit_code);
  add_inject_command(program, exit_code);
  add_play_command(program, exit_code);
  add_replay_command(program, exit_code);
  add_report_command(program, exit_code);
  add_design_command(program, exit_code);
  add_check_command(program, exit_code);
  add_info_command(program, exit_code);
  add_linearise_command(program, exit_code);
  add_unknown_inputs_command(program, exit_code);
  add_log_command(program, exit_code);
  add_can_command(program, exit_code);
  add_decode_command(program, exit_code);
  add_doctor_command(program, exit_code);
  add_dash_command(program, exit_code);
  add_watch_command(program, exit_code);
  try {
    program.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return program.exit(error) == 0 ? kExitYes : kExitBadInput;
  }
  // What is still buffered goes out here, where its failure can be told.
  if (std::fflush(stdout) != 0) {
    throw OutputError(std::string("cannot write to stdout: ") + std::strerror(errno));
  }
  return exit_code;
}

}  // namespace
}  // namespace faultline

int main(int argc, char** argv) {
  faultline::open_standard_streams();
  // A closed pipe, or a file that may grow no more, is a failed write and not a death.
  std::signal(SIGPIPE, SIG_IGN);
  std::signal(SIGXFSZ, SIG_IGN);
  try {
    return faultline::run_program(argc, argv);
  } catch (...) {
    const faultline::ErrorAnswer answer = faultline::answer_current_exception();
    std::fflush(stdout);
    std::fprintf(stderr, "faultline: %s\n", answer.text.c_str());
    return answer.exit_code;
  }
}
