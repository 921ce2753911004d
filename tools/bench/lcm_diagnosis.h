#pragma once

#include <chrono>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include <faultline/run_t.hpp>
#include <faultline/stats_t.hpp>

#include "tools/bench/live_diagnosis.h"
#include "tools/lcm/frame_sequence.h"
#include "tools/lcm/lcm_source.h"
#include "tools/lcm/run_parts.h"

namespace faultline {

/// Live diagnosis of what FAULTLINE_RUN and FAULTLINE_CAN bring over LCM. The last FAULTLINE_STATS
/// of a run says how many messages there were, and so whether the last ones came.
///
/// A diagnosis begins with the first frames after the parts of a run are whole; frames that came
/// before are kept until then, at most kMostKept. Another run_id, or numbers of frames that begin
/// again, begin another.
class LcmDiagnosis {
 public:
  static constexpr std::size_t kMostKept = 100'000;
  /// Messages that overtake each other do so within milliseconds; a slow bench sends a batch in
  /// some hundred.
  static constexpr std::chrono::milliseconds kPatience{500};

  struct Options {
    std::string source;                    ///< the URL, for messages
    std::optional<DiagnosisInputs> given;  ///< from files: RUN is not waited for
    /// The sinks of the next diagnosis. @throws MessageSinkError.
    std::function<LiveDiagnosisOutput()> open_output;
    /// One is over, its log closed.
    std::function<void(const LiveDiagnosis&)> on_end;
    /// Something that a person should know.
    std::function<void(const std::string&)> tell;
  };

  explicit LcmDiagnosis(Options options);

  /// @throws InputError, BankFileError, DbcError, SignalMapError the parts of a run are wrong;
  /// @throws MessageSinkError.
  void on_message(const LiveMessage& message);
  /// Call often: flushes, and waits no longer than kPatience for a message that is missing.
  void attend();
  /// Ends the diagnosis that is open.
  void finish();

  [[nodiscard]] bool is_waiting_for_run() const noexcept { return !inputs_; }
  [[nodiscard]] const FrameSequenceCounters& sequence() const noexcept {
    return sequence_.counters();
  }
  /// Messages on our channels that are not of our types.
  [[nodiscard]] std::uint64_t undecodable() const noexcept { return undecodable_; }
  /// Frames that came before the parts, and of which there were too many.
  [[nodiscard]] std::uint64_t forgotten_frames() const noexcept { return forgotten_frames_; }

 private:
  void on_run(const run_t& chunk);
  void on_stats();
  void on_batch(const FrameBatch& batch);
  void on_gap(const FrameGap& gap);
  void on_restart();
  void keep(const FrameBatch& batch);
  void diagnose(const FrameBatch& batch);
  void end_diagnosis();

  Options options_;
  FrameSequence sequence_;
  RunParts parts_;
  std::optional<DiagnosisInputs> inputs_;
  std::unique_ptr<LiveDiagnosis> diagnosis_;
  std::deque<FrameBatch> kept_;
  std::size_t kept_frames_ = 0;
  std::uint64_t forgotten_frames_ = 0, undecodable_ = 0;
  std::chrono::steady_clock::time_point complete_until_;  ///< last time nothing was missing
  FrameBatch batch_;
  run_t run_;
  stats_t stats_;
};

}  // namespace faultline
