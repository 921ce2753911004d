#include "diagnosis/model/plant_file.h"

#include <algorithm>
#include <iterator>

#include <fmt/format.h>

#include "diagnosis/model/nonlinearity_file.h"
#include "diagnosis/model/toml_reader.h"

namespace faultline {
namespace {

// Largest |deviation| of a channel whose file names none: wide enough for anything scaled to be
// handled at all; it only lengthens, by ln(100)/|pole|, how long a bad sample is distrusted.
constexpr double kDefaultRange = 100.0;

struct Channels {
  std::vector<std::string> names;
  std::vector<std::string> units;
};

void refuse_duplicates(const TomlTable& table, std::string_view key,
                       const std::vector<std::string>& names) {
  for (auto name = names.begin(); name != names.end(); ++name) {
    if (name->empty()) {
      throw table.error(key, "found an empty name, expected a name");
    }
    if (std::find(names.begin(), name, *name) != name) {
      throw table.error(key, fmt::format("found \"{}\" twice, expected different names", *name));
    }
  }
}

Channels read_channels(TomlTable& table) {
  Channels channels;
  channels.names = table.strings("names");
  if (channels.names.empty()) {
    throw table.error("names", "found no name, expected at least one");
  }
  refuse_duplicates(table, "names", channels.names);
  channels.units = table.optional_strings("units").value_or(std::vector<std::string>());
  if (!channels.units.empty() && channels.units.size() != channels.names.size()) {
    throw table.error("units", fmt::format("found {} units, expected one for each of the {} names",
                                           channels.units.size(), channels.names.size()));
  }
  return channels;
}

Eigen::VectorXd read_range(TomlTable& table, std::size_t count) {
  const auto size = static_cast<Eigen::Index>(count);
  const Eigen::VectorXd range =
      table.optional_vector("range", size).value_or(Eigen::VectorXd::Constant(size, kDefaultRange));
  if ((range.array() <= 0.0).any()) {
    throw table.error("range",
                      fmt::format("found {}, expected positive numbers", range.minCoeff()));
  }
  return range;
}

double read_positive(TomlTable& table, std::string_view key) {
  const double value = table.number(key);
  if (value <= 0.0) {
    throw table.error(key, fmt::format("found {}, expected a positive number", value));
  }
  return value;
}

std::optional<double> read_optional_positive(TomlTable& table, std::string_view key) {
  return table.has(key) ? std::optional(read_positive(table, key)) : table.optional_number(key);
}

Eigen::VectorXd read_direction(TomlTable& table, std::string_view key, Eigen::Index size) {
  return table.optional_vector(key, size).value_or(Eigen::VectorXd::Zero(size));
}

void refuse_zero_direction(const TomlTable& table, const Eigen::VectorXd& state,
                           const Eigen::VectorXd& output) {
  if (state.isZero(0.0) && output.isZero(0.0)) {
    throw table.error("", "found no direction, expected a nonzero `state` or `output`");
  }
}

void read_time(TomlTable& root, PlantModel& plant) {
  if (root.choice("time", {"continuous", "discrete"}) == "discrete") {
    plant.time = TimeDomain::kDiscrete;
    plant.sample_time_s = read_positive(root, "sample_time_s");
  } else if (root.has("sample_time_s")) {
    throw root.error("sample_time_s",
                     "found it in a continuous plant, expected it with time = \"discrete\" only");
  }
}

void read_names(TomlTable& root, PlantModel& plant) {
  TomlTable states = root.table("states");
  Channels channels = read_channels(states);
  plant.state_names = channels.names;
  plant.state_units = channels.units;
  if (states.has("range")) {
    plant.state_range = read_range(states, channels.names.size());
  }
  TomlTable inputs = root.table("inputs");
  channels = read_channels(inputs);
  plant.input_names = channels.names;
  plant.input_units = channels.units;
  plant.input_range = read_range(inputs, channels.names.size());
  TomlTable outputs = root.table("outputs");
  channels = read_channels(outputs);
  plant.output_names = channels.names;
  plant.output_units = channels.units;
  plant.output_range = read_range(outputs, channels.names.size());
}

void read_dynamics(TomlTable& root, PlantModel& plant) {
  TomlTable dynamics = root.table("dynamics");
  const auto n = std::ssize(plant.state_names);
  const auto m = std::ssize(plant.input_names);
  const auto q = std::ssize(plant.output_names);
  plant.A = dynamics.matrix("A", n, n);
  plant.B = dynamics.matrix("B", n, m);
  plant.C = dynamics.matrix("C", q, n);
  plant.D = dynamics.optional_matrix("D", q, m).value_or(Eigen::MatrixXd::Zero(q, m));
}

// Positions in `channel_names` of the channels that `key` lists; "all": every one.
std::vector<Eigen::Index> read_selection(TomlTable& table, std::string_view key,
                                         const std::vector<std::string>& channel_names) {
  std::vector<std::string> selected;
  if (table.is_string(key)) {
    if (const std::string word = table.string(key); word != "all") {
      throw table.error(key,
                        fmt::format("found \"{}\", expected \"all\" or a list of names", word));
    }
    selected = channel_names;
  } else {
    selected = table.optional_strings(key).value_or(std::vector<std::string>());
  }
  refuse_duplicates(table, key, selected);
  std::vector<Eigen::Index> indices;
  for (const std::string& name : selected) {
    const auto found = std::find(channel_names.begin(), channel_names.end(), name);
    if (found == channel_names.end()) {
      const std::optional<std::string> near = nearest_name(name, channel_names);
      throw table.error(key, fmt::format("found \"{}\", expected names of {}{}", name, key,
                                         near ? fmt::format("; did you mean \"{}\"?", *near) : ""));
    }
    indices.push_back(found - channel_names.begin());
  }
  return indices;
}

void read_channel_faults(TomlTable& root, PlantModel& plant) {
  std::optional<TomlTable> faults = root.optional_table("faults");
  if (!faults) {
    return;
  }
  for (const Eigen::Index j : read_selection(*faults, "actuators", plant.input_names)) {
    plant.faults.push_back({plant.input_names[static_cast<std::size_t>(j)], FaultKind::kActuator,
                            plant.B.col(j), plant.D.col(j)});
  }
  for (const Eigen::Index j : read_selection(*faults, "sensors", plant.output_names)) {
    const std::string& name = plant.output_names[static_cast<std::size_t>(j)];
    const std::vector<std::string> taken = plant.fault_names();
    if (std::find(taken.begin(), taken.end(), name) != taken.end()) {
      throw faults->error("sensors",
                          fmt::format("found \"{}\", expected a name no other fault has", name));
    }
    plant.faults.push_back({name, FaultKind::kSensor, Eigen::VectorXd::Zero(plant.n()),
                            Eigen::VectorXd::Unit(plant.q(), j)});
  }
}

void read_component_faults(TomlTable& root, PlantModel& plant) {
  for (TomlTable& table : root.tables("fault")) {
    Fault fault;
    fault.name = table.string("name");
    const std::vector<std::string> taken = plant.fault_names();
    if (fault.name.empty() || std::find(taken.begin(), taken.end(), fault.name) != taken.end()) {
      throw table.error(
          "name", fmt::format("found \"{}\", expected a name no other fault has", fault.name));
    }
    fault.state = read_direction(table, "state", plant.n());
    fault.output = read_direction(table, "output", plant.q());
    refuse_zero_direction(table, fault.state, fault.output);
    fault.size = read_optional_positive(table, "size").value_or(1.0);
    plant.faults.push_back(std::move(fault));
  }
}

// Of a disturbance or a noise source; "all" is how a scenario speaks of every one.
void check_source_name(const TomlTable& table, std::string_view what, const std::string& name,
                       const std::vector<std::string>& taken) {
  if (name.empty() || std::find(taken.begin(), taken.end(), name) != taken.end()) {
    throw table.error("name",
                      fmt::format("found \"{}\", expected a name no other {} has", name, what));
  }
  if (name == "all") {
    throw table.error("name", fmt::format("found \"all\", expected another name: scenarios mean "
                                          "every {} by it",
                                          what));
  }
}

void read_disturbances(TomlTable& root, PlantModel& plant) {
  std::vector<std::string> names;
  for (TomlTable& table : root.tables("disturbance")) {
    Disturbance disturbance;
    disturbance.name = table.string("name");
    check_source_name(table, "disturbance", disturbance.name, names);
    names.push_back(disturbance.name);
    disturbance.state = read_direction(table, "state", plant.n());
    disturbance.output = read_direction(table, "output", plant.q());
    refuse_zero_direction(table, disturbance.state, disturbance.output);
    disturbance.bound = read_optional_positive(table, "bound");
    plant.disturbances.push_back(std::move(disturbance));
  }
}

void read_noises(TomlTable& root, PlantModel& plant) {
  std::vector<std::string> names;
  for (TomlTable& table : root.tables("noise")) {
    Noise noise;
    noise.name = table.optional_string("name").value_or(fmt::format("noise{}", names.size() + 1));
    check_source_name(table, "noise source", noise.name, names);
    names.push_back(noise.name);
    noise.output = table.vector("output", plant.q());
    noise.bound = read_optional_positive(table, "bound");
    noise.sigma = read_optional_positive(table, "sigma");
    if (!noise.bound && !noise.sigma) {
      throw table.error("", "found neither, expected `bound` or `sigma`");
    }
    plant.noises.push_back(std::move(noise));
  }
}

void read_operating_point(TomlTable& root, PlantModel& plant) {
  plant.x_operating = Eigen::VectorXd::Zero(plant.n());
  plant.u_operating = Eigen::VectorXd::Zero(plant.m());
  plant.y_operating = Eigen::VectorXd::Zero(plant.q());
  if (std::optional<TomlTable> point = root.optional_table("operating_point")) {
    plant.x_operating = read_direction(*point, "x", plant.n());
    plant.u_operating = read_direction(*point, "u", plant.m());
    plant.y_operating = read_direction(*point, "y", plant.q());
  }
}

PlantModel read_model(TomlTable root) {
  PlantModel plant;
  if (const std::int64_t schema = root.integer("schema"); schema != 1) {
    throw root.error("schema", fmt::format("found {}, expected 1", schema));
  }
  plant.name = root.string("name");
  read_time(root, plant);
  read_names(root, plant);
  read_dynamics(root, plant);
  read_channel_faults(root, plant);
  read_component_faults(root, plant);
  read_disturbances(root, plant);
  read_uncertainties(root, plant);
  read_noises(root, plant);
  plant.nonlinearities = read_nonlinearities(root, plant.n());
  read_operating_point(root, plant);
  root.finish();
  return plant;
}

}  // namespace

PlantModel read_plant(const std::filesystem::path& file) {
  return read_model(TomlTable::read_file(file));
}

PlantModel parse_plant(std::string_view text, const std::string& source) {
  return read_model(TomlTable::parse(text, source));
}

}  // namespace faultline
