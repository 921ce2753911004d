#include "tools/log/message_table.h"

#include <algorithm>
#include <array>
#include <utility>

#include <faultline/diagnosis_t.hpp>
#include <faultline/estimate_t.hpp>
#include <faultline/event_t.hpp>
#include <faultline/residual_t.hpp>
#include <faultline/sample_t.hpp>
#include <faultline/stats_t.hpp>
#include <faultline/truth_t.hpp>
#include <fmt/format.h>
#include <fmt/ranges.h>

#include "diagnosis/bank/bank_file.h"
#include "diagnosis/model/plant_file.h"
#include "tools/lcm/channels.h"
#include "tools/lcm/frame_message.h"

namespace faultline {
namespace {

/// Takes the cells of a row, and of the first row the names of the columns.
class Row {
 public:
  Row(std::vector<Cell>& cells, std::vector<std::string>& columns)
      : cells_(cells), columns_(columns), is_first_(columns.empty()) {
    cells_.clear();
  }

  void add(std::string_view name, Cell value) { add(name, "", std::move(value)); }
  void add(std::string_view name, std::string_view what, Cell value) {
    if (is_first_) columns_.push_back(fmt::format("{}{}", name, what));
    cells_.push_back(std::move(value));
  }

 private:
  std::vector<Cell>& cells_;
  std::vector<std::string>& columns_;
  bool is_first_;
};

/// Names of `count` values: those of the bank if it has so many.
std::vector<std::string> names_for(const std::vector<std::string>& names, const char* letter,
                                   std::size_t count) {
  if (names.size() == count) return names;
  std::vector<std::string> counted;
  for (std::size_t i = 1; i <= count; ++i) counted.push_back(fmt::format("{}{}", letter, i));
  return counted;
}

Cell whole(std::int64_t value) { return value; }

void add_states(Row& row, const std::vector<std::string>& names,
                const std::vector<std::uint8_t>& is_fresh, const std::vector<std::uint8_t>& state,
                const std::vector<std::uint8_t>& age) {
  for (std::size_t i = 0; i < names.size(); ++i) {
    row.add(names[i], "_is_fresh", whole(is_fresh[i]));
    row.add(names[i], "_state", whole(state[i]));
    row.add(names[i], "_age", whole(age[i]));
  }
}

void add_members(Row& row, const sample_t& sample, const ChannelNames& names) {
  const auto outputs = names_for(names.outputs, "y", sample.y.size());
  const auto inputs = names_for(names.inputs, "u", sample.u.size());
  row.add("command_cycle", sample.command_cycle);
  row.add("flags", whole(sample.flags));
  for (std::size_t i = 0; i < outputs.size(); ++i) row.add(outputs[i], sample.y[i]);
  for (std::size_t i = 0; i < inputs.size(); ++i) row.add(inputs[i], sample.u[i]);
  add_states(row, outputs, sample.y_is_fresh, sample.y_state, sample.y_age);
  add_states(row, inputs, sample.u_is_fresh, sample.u_state, sample.u_age);
}

void add_members(Row& row, const residual_t& residual, const ChannelNames& names) {
  const auto rows = names_for(names.residuals, "r", residual.residual.size());
  const auto filters = names_for(names.filters, "filter", residual.evaluation.size());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    row.add(rows[i], residual.residual[i]);
    // Of linear filters no row has one, at no time.
    if (residual.row_threshold[i] >= 0.0) row.add(rows[i], "_bound", residual.row_threshold[i]);
  }
  for (std::size_t i = 0; i < filters.size(); ++i) {
    row.add(filters[i], "_evaluation", residual.evaluation[i]);
    row.add(filters[i], "_threshold", residual.threshold[i]);
    row.add(filters[i], "_fired", whole(residual.fired[i]));
  }
}

void add_members(Row& row, const diagnosis_t& diagnosis, const ChannelNames&) {
  std::vector<std::string> sets;
  for (const fault_set_t& set : diagnosis.sets) {
    sets.push_back(fmt::format("{}", fmt::join(set.faults, ", ")));
  }
  row.add("since_cycle", diagnosis.since_cycle);
  row.add("onset_cycle", diagnosis.onset_cycle);
  row.add("verdict", diagnosis.verdict);
  row.add("sets", fmt::format("{}", fmt::join(sets, " | ")));
  row.add("set_total", whole(diagnosis.set_total));
  row.add("cause", diagnosis.cause);
  row.add("blame", diagnosis.blame);
}

void add_members(Row& row, const estimate_t& estimate, const ChannelNames& names) {
  row.add("onset_cycle", estimate.onset_cycle);
  row.add("reason", estimate.reason);
  for (const std::string& fault : names.faults) {
    const auto found = std::find(estimate.fault.begin(), estimate.fault.end(), fault);
    const auto i = static_cast<std::size_t>(found - estimate.fault.begin());
    const bool is_there = found != estimate.fault.end();
    const auto known = [](double value) { return value >= 0.0 ? Cell(value) : Cell(); };
    row.add(fault, is_there ? Cell(estimate.estimate[i]) : Cell());
    row.add(fault, "_deviation", is_there ? known(estimate.deviation[i]) : Cell());
    row.add(fault, "_bound", is_there ? known(estimate.bound[i]) : Cell());
  }
}

void add_members(Row& row, const truth_t& truth, const ChannelNames& names) {
  std::vector<std::string> faults;
  for (const injected_fault_t& fault : truth.faults) {
    faults.push_back(fmt::format("{} {} {}", fault.target, fault.kind, fault.value));
  }
  const auto states = names_for(names.states, "x", truth.x.size());
  for (std::size_t i = 0; i < states.size(); ++i) row.add(states[i], truth.x[i]);
  row.add("faults", fmt::format("{}", fmt::join(faults, ", ")));
}

void add_members(Row& row, const event_t& event, const ChannelNames&) {
  row.add("severity", event.severity);
  row.add("source", event.source);
  row.add("text", event.text);
}

void add_members(Row& row, const stats_t& stats, const ChannelNames&) {
  row.add("is_final", whole(stats.is_final));
  row.add("frames_sent", stats.frames_sent);
  row.add("send_errors", stats.send_errors);
  row.add("frames_received", stats.frames_received);
  row.add("frames_dropped", stats.frames_dropped);
  row.add("frames_unlogged", stats.frames_unlogged);
  row.add("samples", stats.samples);
  row.add("bad_samples", stats.bad_samples);
  row.add("late_cycles", stats.late_cycles);
  row.add("overruns", stats.overruns);
  row.add("skipped_cycles", stats.skipped_cycles);
  row.add("records_dropped", stats.records_dropped);
  row.add("resets", stats.resets);
  row.add("allocations", stats.allocations);
}

template <class Message>
bool add_message(Row& row, const MessageType& type, const LogEvent& event,
                 const ChannelNames& names, double t_s) {
  Message message;
  if (!decode_message(event.data, type.layout, message)) return false;
  row.add("t_s", t_s);
  row.add("utime", message.utime);
  row.add("cycle", message.cycle);
  add_members(row, message, names);
  return true;
}

void add_frame(Row& row, const CanFrame& frame, std::int64_t number, std::int64_t first_utime) {
  constexpr std::int64_t kPerMicrosecond = 1000;
  const std::int64_t stamp_ns = frame.stamp.time_since_epoch().count();
  const can_frame_t message = to_message(frame);
  const std::int64_t whole_us = stamp_ns / kPerMicrosecond, rest_ns = stamp_ns % kPerMicrosecond;
  // As doubles: the times of a damaged log may be any.
  const double since_us = static_cast<double>(whole_us) - static_cast<double>(first_utime);
  row.add("t_s", (since_us * 1e3 + static_cast<double>(rest_ns)) / 1e9);
  row.add("stamp_ns", stamp_ns);
  row.add("number", number);
  row.add("bus", whole(frame.bus));
  row.add("id", whole(frame.id));
  row.add("flags", whole(message.flags));
  row.add("length", whole(frame.length));
  row.add("data", fmt::format("{:02X}", fmt::join(message.data, "")));
}

}  // namespace

ChannelNames names_of(const RunParts& parts) {
  ChannelNames names;
  if (const RunParts::Part* part = parts.find("bank"); part != nullptr && part->is_whole()) {
    const Bank bank = parse_bank(part->text(), part->name);
    names.outputs = bank.output_names;
    names.inputs = bank.input_names;
    names.faults = bank.fault_names;
    for (const ResidualFilter& filter : bank.filters) {
      names.filters.push_back(filter.name);
      const auto rows = static_cast<std::size_t>(filter.M.rows());
      if (rows == 1) names.residuals.push_back(filter.name);
      for (std::size_t i = 1; rows > 1 && i <= rows; ++i) {
        names.residuals.push_back(fmt::format("{}_{}", filter.name, i));
      }
    }
  }
  if (const RunParts::Part* part = parts.find("plant"); part != nullptr && part->is_whole()) {
    names.states = parse_plant(part->text(), part->name).state_names;
  }
  return names;
}

MessageTable::MessageTable(const MessageType& type, const ChannelNames& names,
                           std::int64_t first_utime)
    : type_(type), names_(&names), first_utime_(first_utime) {}

bool MessageTable::is_tabular(const MessageType& type) noexcept {
  return type.channel != kRunChannel;
}

bool MessageTable::read(const LogEvent& event,
                        const std::function<void(std::span<const Cell>)>& write) {
  MessageHead head;
  if (read_head(type_, event.data, head) != MessageStatus::kWhole) return false;
  if (type_.channel == kCanChannel) {
    FrameBatch batch;
    if (!decode_frames(event.data, batch)) return false;
    for (std::size_t i = 0; i < batch.frames.size(); ++i) {
      Row row(cells_, columns_);
      add_frame(row, batch.frames[i], batch.first_frame + static_cast<std::int64_t>(i),
                first_utime_);
      write(cells_);
    }
    return batch.malformed == 0;
  }
  using Reader = bool (*)(Row&, const MessageType&, const LogEvent&, const ChannelNames&, double);
  static constexpr std::array<std::pair<std::string_view, Reader>, 7> kReaders{{
      {kSampleChannel, add_message<sample_t>},
      {kResidualChannel, add_message<residual_t>},
      {kDiagnosisChannel, add_message<diagnosis_t>},
      {kEstimateChannel, add_message<estimate_t>},
      {kTruthChannel, add_message<truth_t>},
      {kEventChannel, add_message<event_t>},
      {kStatsChannel, add_message<stats_t>},
  }};
  const auto reader = std::find_if(kReaders.begin(), kReaders.end(),
                                   [&](const auto& known) { return known.first == type_.channel; });
  const double t_s = (static_cast<double>(head.utime) - static_cast<double>(first_utime_)) / 1e6;
  Row row(cells_, columns_);
  if (!reader->second(row, type_, event, *names_, t_s)) return false;
  if (cells_.size() != columns_.size()) return false;
  write(cells_);
  return true;
}

}  // namespace faultline
