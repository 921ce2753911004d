#include "sim/equation_plant.h"

#include <algorithm>
#include <cmath>
#include <exception>
#include <limits>
#include <span>
#include <stdexcept>
#include <string_view>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "diagnosis/model/toml_reader.h"

namespace faultline {
namespace {

std::vector<std::string> names_of(const faultline_plant_signal* signals, std::size_t count) {
  std::vector<std::string> names;
  for (const faultline_plant_signal& signal : std::span(signals, count)) {
    names.emplace_back(signal.name);
  }
  return names;
}

std::optional<std::size_t> place_of(std::string_view name, const std::vector<std::string>& names) {
  const auto found = std::find(names.begin(), names.end(), name);
  if (found == names.end()) return std::nullopt;
  return static_cast<std::size_t>(found - names.begin());
}

std::invalid_argument unknown(std::string_view what, std::string_view name,
                              std::string_view expected, const std::vector<std::string>& names) {
  const auto near = nearest_name(name, names);
  return std::invalid_argument(fmt::format(
      "{}: found \"{}\", expected {} ({}){}", what, name, expected, fmt::join(names, ", "),
      near ? fmt::format("; did you mean \"{}\"?", *near) : ""));
}

/// The table's place of each name of the file; both must have the same names.
std::vector<std::size_t> match(const char* what, const std::vector<std::string>& file,
                               const std::vector<std::string>& table, const std::string& plant) {
  std::vector<std::size_t> places;
  for (const std::string& name : file) {
    const auto place = place_of(name, table);
    if (!place) throw unknown(what, name, fmt::format("one of plant \"{}\"", plant), table);
    places.push_back(*place);
  }
  for (const std::string& name : table) {
    if (!place_of(name, file)) {
      throw unknown(what, name,
                    fmt::format("only what the plant file has beside plant \"{}\"", plant), file);
    }
  }
  return places;
}

void check_states(const std::vector<std::string>& file, const std::vector<std::string>& table,
                  const std::string& plant) {
  static_cast<void>(match("states", file, table, plant));
  if (file == table) return;
  throw std::invalid_argument(
      fmt::format("states: found {}, expected them in the order of plant "
                  "\"{}\": {}",
                  fmt::join(file, ", "), plant, fmt::join(table, ", ")));
}

/// Calls what a table gives. What it throws is noted in `thrown`, and its result is then not a
/// number.
template <class Call>
void call(std::span<char> thrown, std::span<double> result, const Call& function) noexcept {
  const auto note = [&](std::string_view what) {
    if (thrown.front() == '\0') {
      thrown[what.copy(thrown.data(), thrown.size() - 1)] = '\0';
    }
    std::fill(result.begin(), result.end(), std::numeric_limits<double>::quiet_NaN());
  };
  try {
    function();
  } catch (const std::exception& exception) {
    note(*exception.what() == '\0' ? "an exception" : exception.what());
  } catch (...) {
    note("an exception that is no std::exception");
  }
}

}  // namespace

std::vector<double> parameter_values(const faultline_plant_table& table,
                                     const PlantParameters& parameters) {
  const std::vector<std::string> names = names_of(table.parameters, table.parameter_count);
  std::vector<double> values;
  for (const auto& parameter : std::span(table.parameters, table.parameter_count)) {
    values.push_back(parameter.nominal);
  }
  for (const auto& [name, value] : parameters) {
    const auto place = place_of(name, names);
    if (!place) {
      throw unknown("parameters", name, fmt::format("one of plant \"{}\"", table.name), names);
    }
    values[*place] = value;
  }
  return values;
}

EquationPlant::EquationPlant(const faultline_plant_table& table, const PlantModel& file,
                             double sample_time_s, const Integration& integration,
                             const PlantParameters& parameters)
    : table_(&table),
      state_names_(names_of(table.states, table.state_count)),
      x_(file.x_operating),
      u_(table.input_count),
      p_(parameter_values(table, parameters)),
      d_(table.disturbance_count),
      y_(table.output_count) {
  if (!(sample_time_s > 0.0)) {
    throw std::invalid_argument(
        fmt::format("sample time: found {} s, expected a positive number", sample_time_s));
  }
  check_states(file.state_names, state_names_, table.name);
  input_ = match("inputs", file.input_names, names_of(table.inputs, table.input_count), table.name);
  output_ =
      match("outputs", file.output_names, names_of(table.outputs, table.output_count), table.name);
  const std::vector<std::string> disturbances =
      names_of(table.disturbances, table.disturbance_count);
  for (std::size_t i = 0; i < file.disturbances.size(); ++i) {
    if (!file.disturbances[i].uncertainty.empty()) continue;  // no input of the equations
    const std::string& name = file.disturbances[i].name;
    const auto place = place_of(name, disturbances);
    if (!place) {
      throw unknown("disturbances", name, fmt::format("one of plant \"{}\"", table.name),
                    disturbances);
    }
    disturbance_.push_back({i, *place});
  }
  F_ = Eigen::MatrixXd::Zero(file.q(), std::ssize(file.noises));
  for (std::size_t i = 0; i < file.noises.size(); ++i) {
    if (const auto place = place_of(file.noises[i].name, disturbances)) {
      noise_.push_back({i, *place});
    } else {
      F_.col(static_cast<Eigen::Index>(i)) = file.noises[i].output;
    }
  }
  noise_part_ = Eigen::VectorXd::Zero(file.q());
  for (std::size_t i = 0; i < p_.size(); ++i) {
    components_.push_back({table.parameters[i].name, p_[i]});
  }
  HeldEquations equations{.state_count = table.state_count,
                          .derivative =
                              [](void* self, const double* x, double* dx) {
                                EquationPlant& plant = *static_cast<EquationPlant*>(self);
                                call(plant.thrown_, {dx, plant.table_->state_count}, [&] {
                                  plant.table_->derivative(x, plant.u_.data(), plant.p_.data(),
                                                           plant.d_.data(), dx);
                                });
                              },
                          .event_count = table.event_count};
  if (table.event_count > 0) {
    equations.events = [](void* self, const double* x, double* g) {
      EquationPlant& plant = *static_cast<EquationPlant*>(self);
      call(plant.thrown_, {g, plant.table_->event_count},
           [&] { plant.table_->events(x, plant.u_.data(), plant.p_.data(), plant.d_.data(), g); });
    };
    equations.on_event = [](void* self, std::size_t event, double* x) {
      EquationPlant& plant = *static_cast<EquationPlant*>(self);
      call(plant.thrown_, {x, plant.table_->state_count}, [&] {
        plant.table_->on_event(event, plant.u_.data(), plant.p_.data(), plant.d_.data(), x);
      });
    };
  }
  integrator_ =
      make_integrator(equations, sample_time_s, method_for_equations(integration), integration);
}

void EquationPlant::reset(const Eigen::VectorXd& x) noexcept {
  x_ = x;
  result_ = {};
  thrown_.fill('\0');
  integrator_->reset();
}

void EquationPlant::take(const PlantDrive& drive) noexcept {
  for (std::size_t j = 0; j < u_.size(); ++j) u_[input_[j]] = drive.u[j];
  for (std::size_t i = 0; i < p_.size(); ++i) {
    p_[i] = components_[i].nominal + drive.component[i];
  }
  const ActivePerturbations& acting = drive.perturbations;
  std::fill(d_.begin(), d_.end(), 0.0);
  if (acting.disturbance.size() > 0) {
    for (const auto& [from, to] : disturbance_) {
      d_[to] = acting.disturbance[static_cast<Eigen::Index>(from)];
    }
  }
  if (acting.noise.size() > 0) {
    for (const auto& [from, to] : noise_) d_[to] = acting.noise[static_cast<Eigen::Index>(from)];
  }
}

void EquationPlant::measure(const PlantDrive& drive, std::span<double> y) noexcept {
  take(drive);
  call(thrown_, y_,
       [&] { table_->measure(x_.data(), u_.data(), p_.data(), d_.data(), y_.data()); });
  noise_part_.setZero();
  if (drive.perturbations.noise.size() > 0) noise_part_.noalias() = F_ * drive.perturbations.noise;
  for (std::size_t i = 0; i < y_.size(); ++i) {
    y[i] = y_[output_[i]] + noise_part_[static_cast<Eigen::Index>(i)];
  }
}

void EquationPlant::step(const PlantDrive& drive) noexcept {
  take(drive);
  result_ = integrator_->advance(this, x_.data());
}

std::string EquationPlant::failure() const {
  if (thrown_.front() != '\0') {
    return fmt::format("its equations have thrown \"{}\"", thrown_.data());
  }
  for (Eigen::Index i = 0; i < x_.size(); ++i) {
    if (!std::isfinite(x_[i])) {
      return fmt::format("{} is not finite", state_names_[static_cast<std::size_t>(i)]);
    }
  }
  return trouble_text(result_, state_names_);
}

}  // namespace faultline
