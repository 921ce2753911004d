#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <faultline/diagnosis_t.hpp>
#include <faultline/event_t.hpp>
#include <faultline/residual_t.hpp>
#include <faultline/run_t.hpp>
#include <faultline/stats_t.hpp>
#include <faultline/truth_t.hpp>

#include "diagnosis/bank/bank.h"
#include "drivers/dbc/dbc_database.h"
#include "drivers/signal/traffic_monitor.h"
#include "tools/lcm/frame_message.h"
#include "tools/lcm/lcm_source.h"
#include "tools/lcm/run_parts.h"

namespace faultline {

/// What a running bench last said on live LCM, for people to look at: always the newest of each
/// kind. Memory is bounded, however long the bench runs and whatever comes. Use from one thread.
class LiveView {
 public:
  using Clock = std::chrono::steady_clock;
  /// Events kept; older ones are forgotten.
  static constexpr std::size_t kEvents = 32;
  /// Held of a run's parts at most; a bank of 100 filters has some 1 MB.
  static constexpr std::size_t kRunBytes = std::size_t{64} << 20;
  /// Every message of the bench fits one datagram: what is longer is not its.
  static constexpr std::size_t kLongestMessage = 65536;
  /// Filters, rows or outputs of one message that are looked at.
  static constexpr std::size_t kFilters = 4096;

  /// Takes one message. What is damaged, or of another type, is counted and left out.
  void take(const LiveMessage& message);

  /// A residual or diagnosis came within the last second.
  [[nodiscard]] bool is_running(Clock::time_point now) const noexcept;
  /// Empty before the first RUN message.
  [[nodiscard]] const std::string& run_id() const noexcept { return run_id_; }
  /// Changes whenever bank(), run_id() or dbc() do.
  [[nodiscard]] std::uint64_t run_revision() const noexcept { return revision_; }
  [[nodiscard]] const std::optional<Bank>& bank() const noexcept { return bank_; }
  [[nodiscard]] const DbcDatabase& dbc() const noexcept { return dbc_; }
  [[nodiscard]] const std::optional<residual_t>& residual() const noexcept { return residual_; }
  [[nodiscard]] const std::optional<diagnosis_t>& diagnosis() const noexcept { return diagnosis_; }
  [[nodiscard]] const std::optional<stats_t>& stats() const noexcept { return stats_; }
  [[nodiscard]] const std::optional<truth_t>& truth() const noexcept { return truth_; }
  /// The oldest first.
  [[nodiscard]] const std::deque<event_t>& events() const noexcept { return events_; }
  [[nodiscard]] const TrafficMonitor& traffic() const noexcept { return traffic_; }
  [[nodiscard]] Timestamp last_frame() const noexcept { return last_frame_; }
  /// Messages that could not be read; and residuals that numbers say were lost.
  [[nodiscard]] std::uint64_t unreadable() const noexcept { return unreadable_; }
  [[nodiscard]] std::uint64_t lost() const noexcept { return lost_; }

  /// What is held of the run's parts, in bytes, with some for the bookkeeping of each chunk.
  [[nodiscard]] std::size_t run_bytes() const noexcept { return run_bytes_; }

  /// The bank's name of filter i, "residual i+1" before the bank is known.
  [[nodiscard]] std::string filter_name(std::size_t i) const;
  /// The verdict with its sets, "isolated u2", "ambiguous u1 | u2"; empty before the first.
  [[nodiscard]] std::string verdict_text() const;
  /// Seconds of bench time for which the verdict stands; nothing before both are known.
  [[nodiscard]] std::optional<double> verdict_age_s() const;

  /// Smallest and largest evaluation signal of each filter since the last reset_peaks().
  [[nodiscard]] const std::vector<double>& least() const noexcept { return least_; }
  [[nodiscard]] const std::vector<double>& greatest() const noexcept { return greatest_; }
  void reset_peaks();

 private:
  bool take_run(const LiveMessage& message);
  bool take_residual(const LiveMessage& message);
  bool take_frames(const LiveMessage& message);
  bool take_event(const LiveMessage& message);
  bool keep_chunk(const run_t& chunk);
  bool read_part(std::string_view name);
  void begin_run(const std::string& run_id);

  std::string run_id_;
  RunParts parts_;  ///< dbc and bank alone
  std::size_t run_bytes_ = 0;
  std::uint64_t revision_ = 0;
  bool has_tried_dbc_ = false, has_tried_bank_ = false;
  std::optional<Bank> bank_;
  DbcDatabase dbc_;
  TrafficMonitor traffic_{DbcDatabase{}, kIdentifiers};
  static constexpr std::size_t kIdentifiers = 1024;
  FrameBatch batch_;
  Timestamp last_frame_{};
  std::optional<residual_t> residual_;
  std::optional<diagnosis_t> diagnosis_;
  std::optional<stats_t> stats_;
  std::optional<truth_t> truth_;
  std::deque<event_t> events_;
  std::vector<double> least_, greatest_;
  std::uint64_t unreadable_ = 0, lost_ = 0;
  std::optional<Clock::time_point> last_heard_;
};

}  // namespace faultline
