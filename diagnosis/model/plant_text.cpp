#include "diagnosis/model/plant_text.h"

#include <cmath>
#include <iterator>

#include <fmt/format.h>
#include <fmt/ranges.h>

namespace faultline {
namespace {

using Eigen::VectorXd;

// The shortest decimals that read back to the same bits. TOML's integers have no negative zero.
std::string number(double value) {
  return value == 0.0 && std::signbit(value) ? "-0.0" : fmt::format("{}", value);
}

template <class Numbers>
std::string list(const Numbers& values) {
  std::vector<std::string> texts;
  for (const double value : values) texts.push_back(number(value));
  return fmt::format("[{}]", fmt::join(texts, ", "));
}

std::string matrix(const char* name, const Eigen::MatrixXd& values) {
  std::string text = fmt::format("{} = [", name);
  const std::string indent(text.size(), ' ');
  for (Eigen::Index i = 0; i < values.rows(); ++i) {
    const VectorXd row = values.row(i).transpose();
    text += (i == 0 ? "" : ",\n" + indent) + list(row);
  }
  return text + "]\n";
}

std::string quoted(const std::string& text) {
  std::string result = "\"";
  for (const char character : text) {
    const auto code = static_cast<unsigned char>(character);
    if (character == '"' || character == '\\') {
      result += '\\';
      result += character;
    } else if (code < 0x20 || code == 0x7f) {
      result += fmt::format("\\u{:04x}", code);
    } else {
      result += character;
    }
  }
  return result + '"';
}

std::string quoted(const std::vector<std::string>& texts) {
  std::vector<std::string> all;
  for (const std::string& text : texts) all.push_back(quoted(text));
  return fmt::format("[{}]", fmt::join(all, ", "));
}

std::string channels(const char* table, const std::vector<std::string>& names,
                     const std::vector<std::string>& units, const VectorXd* range) {
  std::string text = fmt::format("\n[{}]\nnames = {}\n", table, quoted(names));
  if (!units.empty()) text += fmt::format("units = {}\n", quoted(units));
  if (range != nullptr) text += fmt::format("range = {}\n", list(*range));
  return text;
}

std::string optional_number(const char* key, const std::optional<double>& value) {
  return value ? fmt::format("{} = {}\n", key, number(*value)) : "";
}

std::string faults(const PlantModel& model) {
  std::vector<std::string> actuators, sensors;
  std::string others;
  for (const Fault& fault : model.faults) {
    if (fault.kind == FaultKind::kActuator) actuators.push_back(fault.name);
    if (fault.kind == FaultKind::kSensor) sensors.push_back(fault.name);
    if (fault.kind != FaultKind::kComponent) continue;
    others +=
        fmt::format("\n[[fault]]\nname = {}\nstate = {}\noutput = {}\nsize = {}\n",
                    quoted(fault.name), list(fault.state), list(fault.output), number(fault.size));
  }
  return fmt::format("\n[faults]\nactuators = {}\nsensors = {}\n", quoted(actuators),
                     quoted(sensors)) +
         others;
}

std::string perturbations(const PlantModel& model) {
  std::string text;
  for (const Disturbance& disturbance : model.disturbances) {
    if (!disturbance.uncertainty.empty()) continue;
    text +=
        fmt::format("\n[[disturbance]]\nname = {}\nstate = {}\noutput = {}\n",
                    quoted(disturbance.name), list(disturbance.state), list(disturbance.output)) +
        optional_number("bound", disturbance.bound);
  }
  for (const Noise& noise : model.noises) {
    text += fmt::format("\n[[noise]]\nname = {}\noutput = {}\n", quoted(noise.name),
                        list(noise.output)) +
            optional_number("bound", noise.bound) + optional_number("sigma", noise.sigma);
  }
  return text;
}

std::string uncertainty(const PlantModel& model, const Uncertainty& unknown) {
  std::string text = fmt::format("\n[[uncertainty]]\nname = {}\n", quoted(unknown.name));
  if (unknown.is_parameter) {
    return text + matrix("A", unknown.delta_A[0]) + matrix("B", unknown.delta_B[0]) + "range = 1\n";
  }
  for (std::size_t i = 0; i < unknown.delta_A.size(); ++i) {
    text += "[[uncertainty.plant]]\n" + matrix("A", model.A + unknown.delta_A[i]) +
            matrix("B", model.B + unknown.delta_B[i]);
  }
  return text;
}

std::string nonlinearity(const Nonlinearity& added) {
  const NonlinearFunction& function = added.function;
  std::string text =
      fmt::format("\n[[nonlinearity]]\nfunction = {}\ngain = {}\nE_o = {}\nE_i = {}\nslope = {}\n",
                  quoted(function_name(function.kind)), number(added.gain), list(added.E_o),
                  list(added.E_i), list(std::vector{added.slope_min, added.slope_max}));
  using enum FunctionKind;
  if (function.kind == kDeadZone || function.kind == kSaturation) {
    text += fmt::format("width = {}\n", number(function.width));
  } else if (function.kind == kPolynomial) {
    text += fmt::format("coefficients = {}\ndomain = {}\n", list(function.coefficients),
                        list(std::vector{function.domain_min, function.domain_max}));
  } else if (function.kind == kTable) {
    text += fmt::format("at = {}\nvalue = {}\n", list(function.at), list(function.value));
  }
  return text;
}

}  // namespace

std::string plant_text(const PlantModel& model, const std::vector<std::string>& head) {
  std::string text;
  for (const std::string& line : head) text += fmt::format("# {}\n", line);
  const bool is_continuous = model.time == TimeDomain::kContinuous;
  text += fmt::format("schema = 1\nname = {}\ntime = \"{}\"\n", quoted(model.name),
                      is_continuous ? "continuous" : "discrete");
  text += optional_number("sample_time_s", model.sample_time_s);
  text += channels("states", model.state_names, model.state_units,
                   model.state_range ? &*model.state_range : nullptr);
  text += channels("inputs", model.input_names, model.input_units, &model.input_range);
  text += channels("outputs", model.output_names, model.output_units, &model.output_range);
  text += "\n[dynamics]\n" + matrix("A", model.A) + matrix("B", model.B) + matrix("C", model.C) +
          matrix("D", model.D);
  text += faults(model) + perturbations(model);
  for (const Uncertainty& unknown : model.uncertainties) text += uncertainty(model, unknown);
  for (const Nonlinearity& added : model.nonlinearities) text += nonlinearity(added);
  text += fmt::format("\n[operating_point]\nx = {}\nu = {}\ny = {}\n", list(model.x_operating),
                      list(model.u_operating), list(model.y_operating));
  return text;
}

}  // namespace faultline
