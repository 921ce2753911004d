#include "tools/report/run_record.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <stdexcept>
#include <utility>

#include <faultline/diagnosis_t.hpp>
#include <faultline/residual_t.hpp>
#include <faultline/run_t.hpp>
#include <faultline/sample_t.hpp>
#include <faultline/truth_t.hpp>
#include <fmt/format.h>
#include <fmt/ranges.h>

#include "diagnosis/bank/bank_file.h"
#include "diagnosis/model/plant_file.h"
#include "drivers/dbc/dbc_parser.h"
#include "tools/lcm/channels.h"
#include "tools/lcm/message_type.h"

namespace faultline {
namespace {

/// No run has so many; a count beyond it is a damaged message, or a hostile one.
constexpr std::int64_t kMostCycles = std::int64_t{1} << 53;
/// No plant has so many channels, and no page so many charts.
constexpr std::int32_t kMostSignals = 1024;

class RecordReader {
 public:
  void take(const LogEvent& event) {
    const MessageType* const type = find_message_type(event.channel);
    if (type == nullptr) return;
    MessageHead head;
    if (read_head(*type, event.data, head) != MessageStatus::kWhole || head.cycle > kMostCycles ||
        !take_message(*type, head, event)) {
      ++record_.undecodable;
      return;
    }
    if (record_.messages++ == 0) record_.first_utime = event.utime;
    ChannelAccount& account = record_.channels[std::string(event.channel)];
    const auto expected = next_sequence_.find(event.channel);
    if (expected != next_sequence_.end() && head.sequence > expected->second) {
      account.missing += static_cast<std::uint64_t>(head.sequence - expected->second);
    }
    ++account.logged;
    next_sequence_[std::string(event.channel)] = head.sequence + 1;
  }

  RunRecord finish(const LogFiles& log, const std::vector<std::string>& files);

 private:
  bool take_message(const MessageType& type, const MessageHead& head, const LogEvent& event);
  void begin_another_run();
  void take_sample(const sample_t& sample);
  void take_residual(const residual_t& residual);
  void take_diagnosis(const diagnosis_t& diagnosis);
  void take_estimate(const estimate_t& estimate);
  void read_bank_part();
  void read_other_parts();
  void measure_sample_time();
  void count_cycle(std::int64_t cycle) {
    if (!record_.cycles) record_.cycles = CycleRange{cycle, cycle + 1};
    record_.cycles->until = std::max(record_.cycles->until, cycle + 1);
  }

  /// Decodes into a message that is used again: its arrays keep their memory.
  template <class Message>
  static bool decode(const MessageType& type, const LogEvent& event, Message& message) {
    return decode_message(event.data, type.layout, message);
  }

  RunRecord record_;
  RunParts parts_;
  RecordedFaults faults_;
  std::map<std::string, std::int64_t, std::less<>> next_sequence_;
  std::vector<std::int64_t> fired_since_;  ///< per residual; -1: it does not fire
  std::int64_t last_residual_ = 0;
  std::optional<std::pair<std::int64_t, std::int64_t>> first_sample_,
      last_sample_;  ///< cycle, utime
  bool is_bank_read_ = false;
  sample_t sample_;
  residual_t residual_;
  FrameBatch frames_;
};

bool RecordReader::take_message(const MessageType& type, const MessageHead& head,
                                const LogEvent& event) {
  if (type.has_cycle && head.cycle < 0 && type.channel != kEventChannel) return false;
  if (type.channel == kRunChannel) {
    run_t run;
    if (!decode(type, event, run)) return false;
    if (!parts_.run_id().empty() && run.run_id != parts_.run_id()) begin_another_run();
    parts_.take(run);
  } else if (type.channel == kCanChannel) {
    if (!decode_frames(event.data, frames_)) return false;
    record_.traffic.add(frames_);
  } else if (type.channel == kSampleChannel) {
    if (!decode(type, event, sample_) ||
        std::max(sample_.output_count, sample_.input_count) > kMostSignals) {
      return false;
    }
    take_sample(sample_);
  } else if (type.channel == kResidualChannel) {
    if (!decode(type, event, residual_) ||
        std::max(residual_.row_count, residual_.filter_count) > kMostSignals) {
      return false;
    }
    take_residual(residual_);
  } else if (type.channel == kDiagnosisChannel) {
    diagnosis_t diagnosis;
    if (!decode(type, event, diagnosis)) return false;
    take_diagnosis(diagnosis);
  } else if (type.channel == kEstimateChannel) {
    estimate_t estimate;
    if (!decode(type, event, estimate)) return false;
    take_estimate(estimate);
  } else if (type.channel == kTruthChannel) {
    truth_t truth;
    if (!decode(type, event, truth)) return false;
    record_.has_truth = true;
    faults_.on_truth(truth);
  } else if (type.channel == kEventChannel) {
    event_t told;
    if (!decode(type, event, told)) return false;
    if (++record_.event_count <= RunRecord::kMostEvents) record_.events.push_back(std::move(told));
  } else if (type.channel == kStatsChannel) {
    stats_t stats;
    if (!decode(type, event, stats)) return false;
    record_.stats = std::move(stats);
  }
  return true;
}

// Of several runs in one log the last one is told, as by `faultline log export`.
void RecordReader::begin_another_run() {
  const std::uint64_t runs_before = record_.runs_before + 1;
  record_ = RunRecord();
  record_.runs_before = runs_before;
  parts_ = RunParts();
  faults_ = RecordedFaults();
  next_sequence_.clear();
  fired_since_.clear();
  first_sample_.reset();
  last_sample_.reset();
  is_bank_read_ = false;
}

/// Adds `values` to `signals`, which it makes on the first message. Others of another length are
/// no message of this run.
void add_values(std::vector<LoggedSignal>& signals, const std::vector<double>& values,
                std::size_t count, std::int64_t cycle, std::int64_t origin, const char* letter) {
  if (signals.empty()) {
    for (std::size_t i = 0; i < count; ++i) {
      signals.push_back({fmt::format("{}{}", letter, i + 1), "", EnvelopeSeries(origin)});
    }
  }
  for (std::size_t i = 0; i < std::min(count, signals.size()); ++i) {
    signals[i].values.add(cycle, values[i]);
  }
}

// lcm-gen's decoder leaves an array alone whose count is zero: the counts say how long arrays are.
void RecordReader::take_sample(const sample_t& sample) {
  count_cycle(sample.cycle);
  add_values(record_.outputs, sample.y, static_cast<std::size_t>(sample.output_count), sample.cycle,
             record_.cycles->from, "y");
  add_values(record_.inputs, sample.u, static_cast<std::size_t>(sample.input_count), sample.cycle,
             record_.cycles->from, "u");
  if (!first_sample_) first_sample_ = {sample.cycle, sample.utime};
  last_sample_ = {sample.cycle, sample.utime};
}

void RecordReader::take_residual(const residual_t& residual) {
  if (!is_bank_read_) read_bank_part();
  count_cycle(residual.cycle);
  const std::int64_t cycle = residual.cycle;
  const auto filters = static_cast<std::size_t>(residual.filter_count);
  if (record_.residuals.empty()) {
    const Bank* const bank = record_.bank ? &*record_.bank : nullptr;
    const bool is_of_bank = bank != nullptr && bank->filters.size() == filters &&
                            bank->residual_rows() == residual.row_count;
    const bool has_one_row_each = residual.row_count == residual.filter_count;
    for (std::size_t i = 0; i < filters; ++i) {
      const bool is_norm = is_of_bank && !bank->filters[i].course && !bank->filters[i].test &&
                           bank->filters[i].evaluation == Evaluation::kNorm;
      record_.residuals.push_back({is_of_bank ? bank->filters[i].name : fmt::format("r{}", i + 1),
                                   EnvelopeSeries(record_.cycles->from),
                                   is_norm && has_one_row_each,
                                   EnvelopeSeries(record_.cycles->from),
                                   {}});
    }
    fired_since_.assign(filters, -1);
  }
  if (filters != record_.residuals.size()) return;
  for (std::size_t i = 0; i < filters; ++i) {
    LoggedResidual& recorded = record_.residuals[i];
    const bool is_signed = recorded.is_signed && residual.row_count == residual.filter_count;
    recorded.values.add(cycle, is_signed ? residual.residual[i] : residual.evaluation[i]);
    recorded.threshold.add(cycle, residual.threshold[i]);
    if (residual.fired[i] != 0 && fired_since_[i] < 0) {
      fired_since_[i] = cycle;
    } else if (residual.fired[i] == 0 && fired_since_[i] >= 0) {
      recorded.fired.push_back({fired_since_[i], cycle});
      fired_since_[i] = -1;
    }
  }
  last_residual_ = cycle;
}

void RecordReader::take_diagnosis(const diagnosis_t& diagnosis) {
  std::vector<std::vector<std::string>> sets;
  for (std::int32_t i = 0; i < diagnosis.set_count; ++i) {
    const fault_set_t& set = diagnosis.sets[static_cast<std::size_t>(i)];
    sets.push_back(set.fault_count > 0 ? set.faults : std::vector<std::string>());
    std::sort(sets.back().begin(), sets.back().end());
  }
  auto& verdicts = record_.verdicts;
  const bool is_same = !verdicts.empty() && verdicts.back().verdict == diagnosis.verdict &&
                       verdicts.back().sets == sets;
  if (!is_same) {
    // Where a message is lost, the next one tells since when.
    std::int64_t since = std::clamp(diagnosis.since_cycle, std::int64_t{0}, diagnosis.cycle);
    if (!verdicts.empty()) {
      since = std::max(since, verdicts.back().cycles.from);
      verdicts.back().cycles.until = since;
    }
    verdicts.push_back({});
    verdicts.back().cycles = {since, diagnosis.cycle + 1};
    verdicts.back().verdict = diagnosis.verdict;
    verdicts.back().sets = std::move(sets);
  }
  VerdictStretch& stretch = verdicts.back();
  stretch.cycles.until = std::max(stretch.cycles.until, diagnosis.cycle + 1);
  stretch.cause = diagnosis.cause;
  stretch.set_total = diagnosis.set_total;
  if (stretch.onset_cycle < 0) stretch.onset_cycle = diagnosis.onset_cycle;
  if (stretch.blame.empty()) stretch.blame = diagnosis.blame;
}

void RecordReader::take_estimate(const estimate_t& estimate) {
  if (estimate.fault_count == 0) return;
  for (std::size_t i = 0; i < estimate.fault.size(); ++i) {
    const double band = estimate.bound[i] >= 0.0 ? estimate.bound[i] : estimate.deviation[i];
    record_.estimates[estimate.fault[i]].push_back({estimate.cycle, estimate.estimate[i], band});
  }
  if (record_.verdicts.empty()) return;
  record_.verdicts.back().estimate = estimate;
  record_.verdicts.back().onset_cycle = estimate.onset_cycle;
}

void RecordReader::read_bank_part() {
  const RunParts::Part* const part = parts_.find("bank");
  if (part == nullptr || !part->is_complete()) return;
  is_bank_read_ = true;
  try {
    record_.bank = parse_bank(part->text(), part->name);
  } catch (const std::exception& error) {
    record_.remarks.push_back(fmt::format("The bank in the log cannot be read: {}.", error.what()));
  }
}

void RecordReader::read_other_parts() {
  if (!is_bank_read_) read_bank_part();
  const auto read = [&](const char* name, const auto& parse) {
    const RunParts::Part* const part = parts_.find(name);
    if (part == nullptr) return;
    if (!part->is_whole()) {
      record_.remarks.push_back(fmt::format("The log has not all of the {} {}.", name, part->name));
      return;
    }
    try {
      parse(part->text(), part->name);
    } catch (const std::exception& error) {
      record_.remarks.push_back(
          fmt::format("The {} in the log cannot be read: {}.", name, error.what()));
    }
  };
  read("plant", [&](const std::string& text, const std::string& name) {
    record_.plant = parse_plant(text, name);
  });
  read("dbc", [&](const std::string& text, const std::string& name) {
    record_.dbc = parse_dbc(text, name);
  });
  read("scenario", [&](const std::string& text, const std::string& name) {
    record_.scenario = parse_scenario(text, name, included_texts(parts_.whole_parts()));
  });
}

// Without a bank nothing says what a cycle lasts but the samples' times.
void RecordReader::measure_sample_time() {
  if (record_.bank) {
    record_.sample_time_s = record_.bank->sample_time_s;
    return;
  }
  record_.is_sample_time_measured = true;
  record_.sample_time_s = 1.0;
  if (!first_sample_ || last_sample_->first <= first_sample_->first) return;
  const double per_cycle_us =
      (static_cast<double>(last_sample_->second) - static_cast<double>(first_sample_->second)) /
      static_cast<double>(last_sample_->first - first_sample_->first);
  if (per_cycle_us > 0.0) record_.sample_time_s = per_cycle_us * 1e-6;
}

void name_signals(std::vector<LoggedSignal>& signals, const std::vector<std::string>& names,
                  const std::vector<std::string>& units) {
  if (names.size() != signals.size()) return;
  for (std::size_t i = 0; i < signals.size(); ++i) {
    signals[i].name = names[i];
    if (units.size() == signals.size()) signals[i].unit = units[i];
  }
}

RunRecord RecordReader::finish(const LogFiles& log, const std::vector<std::string>& files) {
  record_.files = files;
  record_.damages = log.damages();
  if (record_.messages == 0) {
    throw std::invalid_argument(fmt::format(
        "{}: found no message of a run in it, expected a log of `faultline run` or `diagnose`",
        fmt::join(files, ", ")));
  }
  read_other_parts();
  measure_sample_time();
  if (record_.bank) {
    const Bank& bank = *record_.bank;
    const bool has_plant = record_.plant.has_value();
    name_signals(record_.outputs, bank.output_names,
                 has_plant ? record_.plant->output_units : std::vector<std::string>());
    name_signals(record_.inputs, bank.input_names,
                 has_plant ? record_.plant->input_units : std::vector<std::string>());
  }
  for (std::size_t i = 0; i < fired_since_.size(); ++i) {
    if (fired_since_[i] >= 0) {
      record_.residuals[i].fired.push_back({fired_since_[i], last_residual_ + 1});
    }
  }
  if (!record_.verdicts.empty() && record_.cycles) {
    CycleRange& last = record_.verdicts.back().cycles;
    last.until = std::max(last.until, record_.cycles->until);
  }
  record_.run_id = parts_.run_id();
  record_.parts = parts_.parts();
  record_.faults = faults_.faults();
  return std::move(record_);
}

}  // namespace

bool VerdictStretch::is_alarm() const noexcept {
  return verdict == "isolated" || verdict == "ambiguous" || verdict == "unexplained";
}

std::string RunRecord::name() const {
  if (scenario) return scenario->name;
  return files.empty() ? std::string() : std::filesystem::path(files.front()).filename().string();
}

RunRecord read_run_record(const std::vector<std::string>& files) {
  LogFiles log(files);
  RecordReader reader;
  while (const LogEvent* event = log.next()) reader.take(*event);
  return reader.finish(log, files);
}

}  // namespace faultline
