#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include <faultline/estimate_t.hpp>
#include <faultline/event_t.hpp>
#include <faultline/stats_t.hpp>

#include "diagnosis/bank/bank.h"
#include "diagnosis/model/plant_model.h"
#include "drivers/dbc/dbc_database.h"
#include "tools/bench/scenario.h"
#include "tools/lcm/run_parts.h"
#include "tools/log/log_files.h"
#include "tools/replay/recorded_faults.h"
#include "tools/report/envelope_series.h"
#include "tools/report/traffic_record.h"

namespace faultline {

/// Cycles from, from + 1, .. until - 1.
struct CycleRange {
  std::int64_t from = 0;
  std::int64_t until = 0;
};

/// The announced verdict from one cycle to another.
struct VerdictStretch {
  CycleRange cycles;
  std::string verdict;  ///< healthy, isolated, ambiguous, unexplained, inhibited
  std::string cause;    ///< the last one of this stretch
  std::string blame;    ///< inhibited: may be empty
  std::vector<std::vector<std::string>> sets;  ///< each sorted
  std::int64_t set_total = 0;
  std::int64_t onset_cycle = -1;  ///< -1: none
  estimate_t estimate;            ///< the last one of this stretch with values

  /// Isolated, ambiguous or unexplained.
  [[nodiscard]] bool is_alarm() const noexcept;
};

/// What a report tells of one channel or residual row.
struct LoggedSignal {
  std::string name;
  std::string unit;  ///< may be empty
  EnvelopeSeries values;
};

/// One residual of the bank: its evaluation against its threshold.
struct LoggedResidual {
  std::string name;
  /// The residual itself where it has one row and fires on |r| > τ, else its evaluation.
  EnvelopeSeries values;
  bool is_signed = false;  ///< values are r, to be compared with both τ and -τ
  EnvelopeSeries threshold;
  std::vector<CycleRange> fired;
};

/// An estimated fault size with its band: the proved bound, else one standard deviation.
struct EstimatePoint {
  std::int64_t cycle = 0;
  double value = 0.0;
  double band = 0.0;  ///< negative: not known
};

/// Of a channel, by the sequence numbers of its messages.
struct ChannelAccount {
  std::uint64_t logged = 0;
  std::uint64_t missing = 0;  ///< gaps in the numbers
};

/// One run, as a log tells it: all that a report is made from. What the log lacks is empty.
struct RunRecord {
  std::vector<std::string> files;
  std::uint64_t messages = 0;     ///< of this run
  std::uint64_t runs_before = 0;  ///< other runs in the same log; the last is told
  std::int64_t first_utime = 0;
  std::vector<FileDamage> damages;
  std::uint64_t undecodable = 0;     ///< messages on our channels that are not of our types
  std::vector<std::string> remarks;  ///< what is missing or wrong, in sentences

  std::string run_id;
  std::vector<RunParts::Part> parts;
  std::optional<Scenario> scenario;
  std::optional<PlantModel> plant;
  std::optional<Bank> bank;
  DbcDatabase dbc;

  double sample_time_s = 0.0;  ///< the bank's, else measured
  bool is_sample_time_measured = false;
  std::optional<CycleRange> cycles;  ///< of samples and residuals; absent: there are none
  std::vector<LoggedSignal> outputs, inputs;
  std::vector<LoggedResidual> residuals;
  std::vector<VerdictStretch> verdicts;
  std::map<std::string, std::vector<EstimatePoint>> estimates;  ///< by fault
  bool has_truth = false;
  std::vector<RecordedFault> faults;
  std::vector<event_t> events;  ///< the first kMostEvents
  std::uint64_t event_count = 0;
  std::optional<stats_t> stats;  ///< the last one
  std::map<std::string, ChannelAccount> channels;
  TrafficRecord traffic;

  static constexpr std::size_t kMostEvents = 500;

  /// Cycle 0 is 0 s.
  [[nodiscard]] double time_s(std::int64_t cycle) const noexcept {
    return static_cast<double>(cycle) * sample_time_s;
  }
  /// The scenario's name, else the first file's.
  [[nodiscard]] std::string name() const;
};

/// Reads a log, ours or a real unit's, once, and past what is damaged in it.
/// @param files of one log, in order
/// @throws std::system_error one cannot be read; std::invalid_argument it is no LCM log, or none of
///   our messages is in it.
[[nodiscard]] RunRecord read_run_record(const std::vector<std::string>& files);

}  // namespace faultline
