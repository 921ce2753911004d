#include "tools/bench/endpoints.h"

#include <stdexcept>
#include <vector>

#include <fmt/format.h>

#include "drivers/can/socketcan_bus.h"

namespace faultline {
namespace {

constexpr std::string_view kLoop = "loop";
constexpr std::string_view kCanPrefix = "can:";

std::vector<IdFilter> plant_filters(const SignalMap& map) {
  std::vector<IdFilter> filters;
  for (const MappedMessage& message : map.command_messages) {
    filters.push_back({message.id, message.is_extended});
  }
  return filters;
}

std::vector<IdFilter> controller_filters(const SignalMap& map) {
  std::vector<IdFilter> filters;
  if (map.sync) filters.push_back({map.sync->id, map.sync->is_extended});
  for (const MappedMessage& message : map.sensor_messages) {
    filters.push_back({message.id, message.is_extended});
  }
  return filters;
}

}  // namespace

bool is_bus_name(const std::string& bus) noexcept {
  return bus == kLoop || (bus.starts_with(kCanPrefix) && bus.size() > kCanPrefix.size());
}

Endpoints open_endpoints(const std::string& bus, const SignalMap& map) {
  if (!is_bus_name(bus)) {
    throw std::invalid_argument(
        fmt::format("bus: found \"{}\", expected \"loop\" or \"can:IFACE\", e.g. can:vcan0", bus));
  }
  Endpoints endpoints;
  if (bus == kLoop) {
    endpoints.loop = std::make_unique<LoopBus>();
    endpoints.plant = endpoints.loop->attach();
    endpoints.controller = endpoints.loop->attach();
    endpoints.diagnosis = endpoints.loop->attach();
  } else {
    const std::string interface_name = bus.substr(kCanPrefix.size());
    endpoints.plant = open_socketcan(interface_name);
    endpoints.controller = open_socketcan(interface_name);
    endpoints.diagnosis = open_socketcan(interface_name);
  }
  endpoints.plant->set_filters(plant_filters(map));
  endpoints.controller->set_filters(controller_filters(map));
  endpoints.diagnosis->set_filters(map.filters());
  return endpoints;
}

}  // namespace faultline
