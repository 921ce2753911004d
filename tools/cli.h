#pragma once

#include <cstdio>
#include <functional>
#include <stdexcept>
#include <string>

#include <CLI/App.hpp>
#include <nlohmann/json_fwd.hpp>

namespace faultline {

/// Exit codes of every command.
enum ExitCode : int {
  kExitYes = 0,  ///< done; the answer is yes
  kExitNo = 1,   ///< a valid question with a negative answer: expectation not met, not solvable
  kExitBadInput = 2,  ///< bad input or usage
  kExitFailure = 3,   ///< a bus, a file or LCM failed
  kExitSignal = 128,  ///< plus the number of the signal that stopped it: 130 for SIGINT
};

/// A result cannot be written (exit code 3).
class OutputError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Text for `--help` of every command.
inline constexpr char kExitCodesHelp[] =
    "Exit codes: 0 yes; 1 a valid question with a negative answer; 2 bad input or usage; "
    "3 a bus, a file or LCM failed; 130 interrupted.";

/// Adds `--json F|-`.
void add_json_option(CLI::App& command, std::string& target);

/// Writes `value` to `target`: a file, or "-" for stdout. @throws OutputError.
void write_json(const nlohmann::ordered_json& value, const std::string& target);

/// Has `write` write to `target`: a file, or "-" for stdout. @throws OutputError.
void write_to(const std::string& target, const std::function<void(std::FILE*)>& write);

/// Where text for people goes: stderr when the data goes to stdout.
[[nodiscard]] std::FILE* human_output(const std::string& json_target);

/// For `check` of an option: "" if `text` is a finite number, else what is wrong. CLI11's own
/// checks of numbers let "nan" through.
[[nodiscard]] std::string check_finite(const std::string& text);

/// Each command adds itself to the program; `exit_code` is what it answered.
void add_calibrate_command(CLI::App& program, int& exit_code);
void add_campaign_command(CLI::App& program, int& exit_code);
void add_check_command(CLI::App& program, int& exit_code);
void add_dash_command(CLI::App& program, int& exit_code);
void add_diagnose_command(CLI::App& program, int& exit_code);
void add_design_command(CLI::App& program, int& exit_code);
void add_doctor_command(CLI::App& program, int& exit_code);
void add_play_command(CLI::App& program, int& exit_code);
void add_replay_command(CLI::App& program, int& exit_code);
void add_report_command(CLI::App& program, int& exit_code);
void add_score_command(CLI::App& program, int& exit_code);
void add_run_command(CLI::App& program, int& exit_code);
void add_info_command(CLI::App& program, int& exit_code);
void add_linearise_command(CLI::App& program, int& exit_code);
void add_watch_command(CLI::App& program, int& exit_code);
void add_unknown_inputs_command(CLI::App& program, int& exit_code);

}  // namespace faultline
