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

}  // namespace

void make_schedules(BenchInputs& inputs, const Scenario& scenario) {
  try {
    inputs.schedule = {targets_of(inputs), scenario.injections, scenario.seed};
    inputs.perturbations = {inputs.plant, scenario.disturbances, scenario.noises, scenario.seed};
  } catch (const ScheduleError& error) {
    throw error_in(scenario, error);
  }
}

}  // namespace faultline
