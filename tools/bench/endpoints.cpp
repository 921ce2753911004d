#include "tools/bench/endpoints.h"

#include <stdexcept>
#include <vector>

#include <fmt/format.h>

#include "drivers/can/open_bus.h"

namespace faultline {
namespace {

constexpr std::string_view kLoop = "loop";

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
  if (bus == kLoop) return true;
  try {
    check_bus_names(bus);
    return true;
  } catch (...) {
    return false;
  }
}

Endpoints open_endpoints(const std::string& bus, const SignalMap& map, bool has_probe) {
  if (!is_bus_name(bus)) {
    throw std::invalid_argument(
        fmt::format("bus: found \"{}\", expected {}, e.g. can:vcan0", bus, kBusNamesHelp));
  }
  Endpoints endpoints;
  if (bus == kLoop) {
    endpoints.loop = std::make_unique<LoopBus>();
    endpoints.plant = endpoints.loop->attach();
    endpoints.controller = endpoints.loop->attach();
    endpoints.diagnosis = endpoints.loop->attach();
    if (has_probe) endpoints.probe = endpoints.loop->attach();
  } else {
    endpoints.plant = open_bus(bus);
    endpoints.controller = open_bus(bus);
    endpoints.diagnosis = open_bus(bus);
    if (has_probe) endpoints.probe = open_bus(bus);
  }
  endpoints.plant->set_filters(plant_filters(map));
  endpoints.controller->set_filters(controller_filters(map));
  endpoints.diagnosis->set_filters(map.filters());
  if (endpoints.probe) endpoints.probe->set_filters(map.filters());
  return endpoints;
}

std::unique_ptr<CanBus> open_node(const std::string& bus, const SignalMap& map, BenchNode node) {
  if (bus == kLoop || !is_bus_name(bus)) {
    throw std::invalid_argument(
        fmt::format("--bus: found \"{}\", expected can:IFACE, udp:GROUP:PORT or several of them "
                    "with commas between, where other processes can be",
                    bus));
  }
  std::unique_ptr<CanBus> endpoint = open_bus(bus);
  endpoint->set_filters(node == BenchNode::kPlant ? plant_filters(map) : controller_filters(map));
  return endpoint;
}

}  // namespace faultline
