#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "tools/bench/run_history.h"
#include "tools/replay/recorded_faults.h"
#include "tools/replay/result_comparison.h"

namespace faultline {

struct ReplayOptions {
  /// An LCM log, several of one rotated run in their order, or a candump log ("-": stdin).
  std::vector<std::string> logs;
  std::optional<std::filesystem::path> scenario;  ///< what the frames are read by, instead of RUN
  std::optional<std::filesystem::path> bank;      ///< another design, or the only one
  std::optional<std::filesystem::path> dbc;       ///< instead of the recorded one
  std::optional<std::filesystem::path> output;    ///< LCM log to write: frames and what is found
  bool is_quiet = false;                          ///< no progress on stderr
  /// What was passed over in the log.
  std::function<void(const std::string& text)> on_problem;
};

/// What one bank says of a record.
struct BankAnswer {
  std::string bank;    ///< its name
  std::string source;  ///< where it came from: "the log", a file
  std::vector<VerdictEntry> verdicts;
  std::vector<std::optional<double>> first_fired_s;  ///< per residual
  std::vector<std::string> residuals;                ///< their names
  std::vector<InjectionOutcome> injections;
  std::vector<ExpectationOutcome> expectations;
  std::uint64_t samples = 0, bad_samples = 0, resets = 0;

  [[nodiscard]] bool are_expectations_met() const;
};

/// The results in the log beside those of the replay.
struct Verification {
  ResultComparison comparison;
  std::vector<std::string> difference;  ///< the first difference in words, line by line

  /// Every result in the log was reproduced to the bit; but for those at the end of a log that
  /// lacks its end.
  [[nodiscard]] bool is_verified() const noexcept;
};

/// What the replay of one run came to.
struct RunReplay {
  std::string run_id, name;  ///< empty for a candump log
  std::uint64_t frames = 0;
  std::uint64_t missing_frames = 0;            ///< of which the log shows that they are missing
  bool has_ended = false;                      ///< the log has the end of the run
  std::vector<RecordedFault> faults{};         ///< that TRUTH says acted
  std::optional<Verification> verification{};  ///< of a log with results
  std::vector<BankAnswer> answers{};           ///< the recorded bank's first, if there is one
};

struct ReplayResult {
  std::vector<RunReplay> runs;
  std::uint64_t damages = 0;  ///< stretches of the log that could not be read
  double wall_s = 0.0;
};

/// Diagnoses recorded frames again, as fast as the machine can: with the bank of the log, and with
/// another one if one is given. The results of the log's own bank are compared with the recorded
/// ones to the bit.
/// @throws InputError, BankFileError, DbcError, SignalMapError, NotSolvable bad input, or a bank
///   that does not fit the log; std::invalid_argument no such log; FrameLogError no log of frames;
/// @throws std::system_error it cannot be read; MessageSinkError `output` cannot be written.
[[nodiscard]] ReplayResult replay(const ReplayOptions& options);

}  // namespace faultline
