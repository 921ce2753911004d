#include <algorithm>
#include <memory>
#include <system_error>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include "tools/bench/bench_parts.h"

namespace faultline {
namespace {

InputError error_in(const Scenario& scenario, const ScheduleError& error) {
  return scenario_error(
      scenario, error.table(), error.field(),
      fmt::format("{}, entry {}.{}", error.table(), error.entry() + 1, error.what()),
      error.entry());
}

void append_messages(const std::vector<MappedMessage>& messages, bool is_command,
                     FaultTargets& targets) {
  for (const MappedMessage& message : messages) {
    targets.messages.push_back({message.name, is_command, message.protection.has_crc(),
                                message.protection.has_counter(), message.length});
  }
}

FaultTargets targets_of(const BenchInputs& inputs) {
  FaultTargets targets = fault_targets(inputs.plant);
  targets.sample_time_s = inputs.bank.sample_time_s;
  if (inputs.make_plant) {
    targets.components = inputs.make_plant()->components();
  } else {
    targets.are_components_open = true;
  }
  append_messages(inputs.map.sensor_messages, false, targets);
  append_messages(inputs.map.command_messages, true, targets);
  if (const auto& sync = inputs.map.sync) {
    targets.messages.push_back({sync->name, false, sync->protection.has_crc(),
                                sync->protection.has_counter(), sync->length});
  }
  return targets;
}

/// Reads the records of [[table]], each of which must last as long as it acts.
std::vector<Perturbation> with_records(BenchInputs& inputs, const Scenario& scenario,
                                       const std::string& table,
                                       std::vector<Perturbation> perturbations) {
  for (std::size_t entry = 0; entry < perturbations.size(); ++entry) {
    Perturbation& perturbation = perturbations[entry];
    if (perturbation.kind != PerturbationKind::kRecorded) continue;
    const auto refuse = [&](const std::string& text) {
      throw scenario_error(scenario, table, "file",
                           fmt::format("{}, entry {}.file: {}", table, entry + 1, text), entry);
    };
    NamedText text;
    try {
      text = data_text(inputs, scenario, perturbation.file);
    } catch (const std::system_error& error) {
      refuse(error.what());
    }
    perturbation.record = std::make_shared<const RecordedSignal>(text.text, text.source);
    const double end_s =
        std::min(scenario.duration_s, perturbation.until_s.value_or(scenario.duration_s));
    const double needed_s = end_s - perturbation.at_s;
    // The last cycle before the end may lie a step behind the last row.
    if (perturbation.is_repeated ||
        perturbation.record->length_s() + inputs.bank.sample_time_s >= needed_s) {
      continue;
    }
    refuse(
        fmt::format("found a record of {:.6g} s, expected the {:.6g} s in which it acts: end it "
                    "with until_s, or set repeat = true",
                    perturbation.record->length_s(), needed_s));
  }
  return perturbations;
}

}  // namespace

NamedText data_text(BenchInputs& inputs, const Scenario& scenario,
                    const std::filesystem::path& file) {
  const std::string name = file.lexically_relative(scenario.file.parent_path()).generic_string();
  const std::string part = "data:" + name;
  if (const RunPart* logged = find_part(inputs.parts, part)) {
    return {logged->text, file.string()};
  }
  // In front: who reads a log looks for parts no further than to the last of the bench's own.
  inputs.parts.insert(inputs.parts.begin(), read_part(part.c_str(), file));
  return {inputs.parts.front().text, file.string()};
}

void make_schedules(BenchInputs& inputs, const Scenario& scenario) {
  try {
    inputs.schedule = {targets_of(inputs), scenario.injections, scenario.seed};
    inputs.perturbations = {inputs.plant,
                            with_records(inputs, scenario, "disturbance", scenario.disturbances),
                            with_records(inputs, scenario, "noise", scenario.noises), scenario.seed,
                            inputs.bank.sample_time_s};
  } catch (const ScheduleError& error) {
    throw error_in(scenario, error);
  }
}

}  // namespace faultline
