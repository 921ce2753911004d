#include "sim/fault_schedule.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <set>

#include <fmt/format.h>

#include "diagnosis/model/toml_reader.h"

namespace faultline {
namespace {

constexpr double kSlackSeconds = 0.5e-9;  // of is_between

std::optional<Eigen::Index> index_of(const std::vector<std::string>& names,
                                     const std::string& name) {
  const auto found = std::find(names.begin(), names.end(), name);
  if (found == names.end()) return std::nullopt;
  return found - names.begin();
}

std::vector<std::string> component_names(const PlantModel& plant) {
  std::vector<std::string> names;
  for (const Fault& fault : plant.faults) {
    if (fault.kind == FaultKind::kComponent) names.push_back(fault.name);
  }
  return names;
}

std::string unknown_target(const PlantModel& plant, const std::string& target) {
  std::vector<std::string> known = plant.input_names;
  known.insert(known.end(), plant.output_names.begin(), plant.output_names.end());
  for (const std::string& name : component_names(plant)) known.push_back(name);
  std::string text = fmt::format(
      "found \"{}\", expected an input, an output or a fault of "
      "plant \"{}\" ({})",
      target, plant.name, fmt::join(known, ", "));
  if (const auto near = nearest_name(target, known)) {
    text += fmt::format("; did you mean \"{}\"?", *near);
  }
  return text;
}

}  // namespace

std::string_view injection_kind_name(InjectionKind kind) noexcept {
  switch (kind) {
    case InjectionKind::kBias:
      return "bias";
    case InjectionKind::kGain:
      return "gain";
    case InjectionKind::kSinusoid:
      return "sinusoid";
  }
  return "";
}

bool is_between(double t_s, double at_s, const std::optional<double>& until_s) noexcept {
  if (t_s - at_s + kSlackSeconds < 0.0) return false;
  return !(until_s && t_s + kSlackSeconds >= *until_s);
}

double sinusoid(double since_s, double frequency_Hz, double phase_rad) noexcept {
  return std::sin(2.0 * std::numbers::pi * frequency_Hz * since_s + phase_rad);
}

double activity(const Injection& injection, double t_s) noexcept {
  if (!is_between(t_s, injection.at_s, injection.until_s)) return 0.0;
  const double since_s = t_s - injection.at_s + kSlackSeconds;
  if (injection.period_s && std::fmod(since_s, *injection.period_s) >= 0.5 * *injection.period_s) {
    return 0.0;
  }
  if (injection.ramp_s > 0.0) return std::min(1.0, since_s / injection.ramp_s);
  return 1.0;
}

double injected_value(const Injection& injection, double t_s) noexcept {
  const double a = activity(injection, t_s);
  switch (injection.kind) {
    case InjectionKind::kBias:
      return a * injection.value;
    case InjectionKind::kGain:
      return 1.0 + a * (injection.value - 1.0);
    case InjectionKind::kSinusoid:
      return a * injection.value *
             sinusoid(t_s - injection.at_s, injection.frequency_Hz, injection.phase_rad);
  }
  return 0.0;
}

FaultSchedule::FaultSchedule(const PlantModel& plant, std::vector<Injection> injections)
    : injections_(std::move(injections)),
      input_count_(plant.m()),
      output_count_(plant.q()),
      component_count_(static_cast<Eigen::Index>(component_names(plant).size())) {
  const std::vector<std::string> components = component_names(plant);
  for (std::size_t i = 0; i < injections_.size(); ++i) {
    const Injection& injection = injections_[i];
    if (const auto input = index_of(plant.input_names, injection.target)) {
      resolved_.push_back({Target::kInput, *input});
    } else if (const auto output = index_of(plant.output_names, injection.target)) {
      resolved_.push_back({Target::kOutput, *output});
    } else if (const auto component = index_of(components, injection.target)) {
      if (injection.kind == InjectionKind::kGain) {
        throw ScheduleError(
            i, "kind",
            fmt::format("found \"{}\", expected \"bias\" or \"sinusoid\": \"{}\" is a fault of the "
                        "plant file, not a channel",
                        injection_kind_name(injection.kind), injection.target));
      }
      resolved_.push_back({Target::kComponent, *component});
    } else {
      throw ScheduleError(i, "target", unknown_target(plant, injection.target));
    }
  }
}

ActiveFaults FaultSchedule::none() const {
  return {Eigen::VectorXd::Ones(input_count_), Eigen::VectorXd::Zero(input_count_),
          Eigen::VectorXd::Ones(output_count_), Eigen::VectorXd::Zero(output_count_),
          Eigen::VectorXd::Zero(component_count_)};
}

void FaultSchedule::evaluate(double t_s, ActiveFaults& out) const noexcept {
  out.input_gain.setOnes();
  out.input_bias.setZero();
  out.output_gain.setOnes();
  out.output_bias.setZero();
  out.component.setZero();
  for (std::size_t i = 0; i < injections_.size(); ++i) {
    const Injection& injection = injections_[i];
    if (activity(injection, t_s) == 0.0) continue;
    const Eigen::Index channel = resolved_[i].index;
    const bool is_gain = injection.kind == InjectionKind::kGain;
    const double value = injected_value(injection, t_s);
    switch (resolved_[i].target) {
      case Target::kInput:
        if (is_gain) {
          out.input_gain[channel] *= value;
        } else {
          out.input_bias[channel] += value;
        }
        break;
      case Target::kOutput:
        if (is_gain) {
          out.output_gain[channel] *= value;
        } else {
          out.output_bias[channel] += value;
        }
        break;
      case Target::kComponent:
        out.component[channel] += value;
        break;
    }
  }
}

std::vector<std::string> FaultSchedule::active_names(double t_s) const {
  std::set<std::string> names;
  for (const Injection& injection : injections_) {
    if (activity(injection, t_s) > 0.0) names.insert(injection.target);
  }
  return {names.begin(), names.end()};
}

}  // namespace faultline
