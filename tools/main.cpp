#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <exception>
#include <stdexcept>
#include <string>
#include <system_error>

#include <fcntl.h>
#include <unistd.h>

#include <CLI/CLI.hpp>

#include "diagnosis/bank/bank_file.h"
#include "diagnosis/model/input_error.h"
#include "drivers/can/can_bus.h"
#include "drivers/dbc/dbc_parser.h"
#include "drivers/signal/message_protection.h"
#include "drivers/signal/signal_map.h"
#include "tools/bench/bench_inputs.h"
#include "tools/can/can_command.h"
#include "tools/can/frame_log.h"
#include "tools/cli.h"
#include "tools/lcm/message_sink.h"
#include "tools/log/log_command.h"
#include "tools/version.h"

namespace faultline {
namespace {

int report(const char* text, int exit_code) {
  std::fflush(stdout);
  std::fprintf(stderr, "faultline: %s\n", text);
  return exit_code;
}

/// The one place where exceptions become messages and exit codes.
int report_current_exception() {
  try {
    throw;
  } catch (const NotSolvable& error) {
    return report(error.what(), kExitNo);
  } catch (const InputError& error) {
    return report(error.what(), kExitBadInput);
  } catch (const DbcError& error) {
    return report(error.what(), kExitBadInput);
  } catch (const BankFileError& error) {
    return report(error.what(), kExitBadInput);
  } catch (const SignalMapError& error) {
    return report(error.what(), kExitBadInput);
  } catch (const ProtectionError& error) {
    return report(error.what(), kExitBadInput);
  } catch (const FrameLogError& error) {
    return report(error.what(), kExitBadInput);
  } catch (const BusError& error) {
    return report(error.what(), kExitFailure);
  } catch (const MessageSinkError& error) {
    return report(error.what(), kExitFailure);
  } catch (const OutputError& error) {
    return report(error.what(), kExitFailure);
  } catch (const std::system_error& error) {
    // An input file that is not there is the user's slip; one that the system fails to read is not.
    const bool is_missing = error.code() == std::errc::no_such_file_or_directory ||
                            error.code() == std::errc::is_a_directory ||
                            error.code() == std::errc::not_a_directory;
    return report(error.what(), is_missing ? kExitBadInput : kExitFailure);
  } catch (const std::invalid_argument& error) {
    return report(error.what(), kExitBadInput);
  } catch (const std::exception& error) {
    return report(error.what(), kExitFailure);
  }
}

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
  add_diagnose_command(program, exit_code);
  add_play_command(program, exit_code);
  add_replay_command(program, exit_code);
  add_design_command(program, exit_code);
  add_check_command(program, exit_code);
  add_info_command(program, exit_code);
  add_linearise_command(program, exit_code);
  add_log_command(program, exit_code);
  add_can_command(program, exit_code);
  add_decode_command(program, exit_code);
  add_doctor_command(program, exit_code);
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
    return faultline::report_current_exception();
  }
}
