#include "tools/replay/replay_inputs.h"

#include <algorithm>
#include <utility>

#include <fmt/format.h>

#include "diagnosis/model/input_error.h"
#include "tools/bench/bench_inputs.h"

namespace faultline {
namespace {

ReplayInputs of_bench(BenchInputs inputs) {
  ReplayInputs replayed;
  static_cast<DiagnosisInputs&>(replayed) = std::move(static_cast<DiagnosisInputs&>(inputs));
  replayed.scenario = std::move(inputs.scenario);
  replayed.schedule = std::move(inputs.schedule);
  return replayed;
}

ReplayInputs of_diagnosis(DiagnosisInputs inputs) {
  ReplayInputs replayed;
  static_cast<DiagnosisInputs&>(replayed) = std::move(inputs);
  return replayed;
}

/// The log's own bank, if it has what is needed.
std::optional<ReplayInputs> recorded_inputs(const std::vector<RunPart>& parts,
                                            const std::string& log) {
  if (find_part(parts, "bank") == nullptr || find_part(parts, "dbc") == nullptr) {
    return std::nullopt;
  }
  return of_bench(bench_inputs_of_parts(parts, log));
}

/// The mappings of a scenario that a bank has channels for.
ChannelMappings mappings_for(const Bank& bank, const ChannelMappings& mappings) {
  const auto has = [](const std::vector<std::string>& names, const std::string& name) {
    return std::find(names.begin(), names.end(), name) != names.end();
  };
  ChannelMappings kept;
  for (const auto& [channel, mapping] : mappings) {
    if (has(bank.output_names, channel) || has(bank.input_names, channel)) {
      kept.emplace(channel, mapping);
    }
  }
  return kept;
}

/// What is written must be a log that can be read again: with the scenario's plant.
void check_is_of_scenario(const Bank& bank, const ReplayInputs& own, const std::string& source,
                          const std::string& log) {
  if (bank.plant_digest == own.bank.plant_digest) return;
  throw InputError(
      source, {},
      fmt::format("plant: found digest {} (\"{}\"), expected {}, that of {}, for a log "
                  "to be written",
                  bank.plant_digest, bank.plant_name, own.bank.plant_digest, log));
}

ReplayInputs other_inputs(const ReplayOptions& options, const std::vector<RunPart>& parts,
                          const std::optional<ReplayInputs>& own, const std::string& log) {
  const std::string source = options.bank->string();
  Bank bank = load_bank_file(*options.bank);
  if (own && bank.sample_time_s != own->bank.sample_time_s) {
    throw InputError(
        source, {},
        fmt::format("sample_time_s: found {} s, expected {} s, that of {}: a bank steps "
                    "once per cycle",
                    bank.sample_time_s, own->bank.sample_time_s, log));
  }
  std::optional<RunPart> dbc;
  std::string dbc_source;
  if (options.dbc) {
    dbc = read_part("dbc", *options.dbc);
    dbc_source = options.dbc->string();
  } else if (const RunPart* part = find_part(own ? own->parts : parts, "dbc")) {
    dbc = *part;
    dbc_source = log + ":" + part->name;
  } else {
    throw InputError(log, {},
                     "found no DBC in it, expected one with --dbc FILE or --scenario FILE");
  }
  const ChannelMappings mappings =
      own ? mappings_for(bank, own->scenario.signals) : ChannelMappings();
  ReplayInputs inputs =
      of_diagnosis(make_diagnosis_inputs(std::move(bank), *dbc, dbc_source, mappings));
  if (!own) return inputs;
  // A bank with fewer outputs may listen to fewer messages.
  for (MappedMessage& message : inputs.map.sensor_messages) {
    const auto rate = own->scenario.rates.find(message.name);
    if (rate != own->scenario.rates.end()) message.cycles_per_frame = rate->second;
  }
  inputs.scenario = own->scenario;
  inputs.schedule = own->schedule;
  inputs.is_initial_state_known = own->is_initial_state_known;
  if (!own->scenario.name.empty()) {
    if (options.output) check_is_of_scenario(inputs.bank, *own, source, log);
    inputs.name = own->name;
    for (const RunPart& part : own->parts) {
      if (part.part == "scenario" || part.part == "plant") inputs.parts.push_back(part);
    }
    for (const IncludedText& include : included_texts(own->parts)) {
      inputs.parts.push_back(include_part(include));
    }
  }
  return inputs;
}

}  // namespace

ReplayBanks replay_banks(const ReplayOptions& options, const std::vector<RunPart>& parts,
                         const std::string& log) {
  ReplayBanks banks;
  if (options.scenario) {
    banks.own = of_bench(load_bench_inputs(*options.scenario));
    banks.own_source = options.scenario->string();
  } else {
    banks.own = recorded_inputs(parts, log);
    banks.own_source = "the log";
    banks.is_recorded = banks.own.has_value();
  }
  if (options.bank) {
    banks.other = other_inputs(options, parts, banks.own, log);
    banks.other_source = options.bank->string();
  }
  if (!banks.own && !banks.other) {
    throw InputError(log, {},
                     "found no bank in it, expected one with --scenario FILE, or with --bank FILE "
                     "and --dbc FILE");
  }
  return banks;
}

}  // namespace faultline
