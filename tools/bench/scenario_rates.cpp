#include <algorithm>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "drivers/signal/sampler.h"
#include "tools/bench/scenario_tables.h"

namespace faultline {

std::map<std::string, std::uint32_t, std::less<>> read_rates(TomlTable table) {
  std::map<std::string, std::uint32_t, std::less<>> rates;
  for (const std::string& message : table.keys()) {
    const std::int64_t cycles = table.integer(message);
    // What is farther apart the sampler would take for a gap.
    if (cycles < 1 || cycles > std::int64_t{Sampler::kMaxGap}) {
      throw table.error(message, fmt::format("found {}, expected 1 to {} cycles per frame", cycles,
                                             Sampler::kMaxGap));
    }
    rates.emplace(message, static_cast<std::uint32_t>(cycles));
  }
  return rates;
}

void set_rates(const Scenario& scenario, SignalMap& map) {
  std::vector<std::string> names;
  for (const MappedMessage& message : map.sensor_messages) names.push_back(message.name);
  const auto wrong = [&](const std::string& message, const std::string& text) {
    return scenario_error(scenario, "rates", message, "rates: " + text);
  };
  for (const auto& [name, cycles] : scenario.rates) {
    const auto found = std::find(names.begin(), names.end(), name);
    if (found != names.end()) {
      map.sensor_messages[static_cast<std::size_t>(found - names.begin())].cycles_per_frame =
          cycles;
      continue;
    }
    const auto is_it = [&wanted = name](const MappedMessage& message) {
      return message.name == wanted;
    };
    const char* why = "";
    if (map.sync && map.sync->name == name) {
      why = ", not SYNC: it begins each cycle";
    } else if (std::any_of(map.command_messages.begin(), map.command_messages.end(), is_it)) {
      why = ", not one with commands: each cycle has its own";
    }
    const auto near = *why == '\0' ? nearest_name(name, names) : std::nullopt;
    throw wrong(name, fmt::format("found \"{}\", expected a message that carries outputs ({}){}{}",
                                  name, fmt::join(names, ", "), why,
                                  near ? fmt::format("; did you mean \"{}\"?", *near) : ""));
  }
  const auto is_slow = [](const MappedMessage& message) { return message.cycles_per_frame > 1; };
  if (scenario.rates.empty() ||
      !std::all_of(map.sensor_messages.begin(), map.sensor_messages.end(), is_slow)) {
    return;
  }
  throw wrong(scenario.rates.begin()->first,
              "found every message with outputs slower than the cycle, expected one that comes in "
              "each: it is what the controller answers");
}

}  // namespace faultline
