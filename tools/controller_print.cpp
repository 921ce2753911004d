#include "tools/controller_print.h"

#include <cmath>
#include <complex>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <nlohmann/json.hpp>

#include "diagnosis/bank/bank_file.h"
#include "diagnosis/design/bank_request.h"
#include "diagnosis/model/plant_file.h"
#include "tools/bench/controller_plan.h"

namespace faultline {
namespace {

using Json = nlohmann::ordered_json;
using Poles = std::vector<std::complex<double>>;

std::string matrix_text(const Eigen::MatrixXd& matrix) {
  std::vector<std::string> rows;
  for (Eigen::Index i = 0; i < matrix.rows(); ++i) {
    const Eigen::RowVectorXd row = matrix.row(i);
    std::vector<std::string> cells;
    for (const double cell : row) cells.push_back(fmt::format("{:.6g}", cell));
    rows.push_back(fmt::format("[{}]", fmt::join(cells, ", ")));
  }
  return fmt::format("[{}]", fmt::join(rows, ", "));
}

Json matrix_json(const Eigen::MatrixXd& matrix) {
  Json json = Json::array();
  for (Eigen::Index i = 0; i < matrix.rows(); ++i) {
    const Eigen::RowVectorXd row = matrix.row(i);
    json.push_back(std::vector<double>(row.begin(), row.end()));
  }
  return json;
}

std::string poles_text(const Poles& poles) {
  std::vector<std::string> texts;
  for (const std::complex<double>& pole : poles) {
    texts.push_back(pole.imag() == 0.0 ? fmt::format("{:.6g}", pole.real())
                                       : fmt::format("{:.6g}{:+.6g}i", pole.real(), pole.imag()));
  }
  return fmt::format("{}", fmt::join(texts, ", "));
}

Json poles_json(const Poles& poles) {
  Json json = Json::array();
  for (const std::complex<double>& pole : poles) json.push_back({pole.real(), pole.imag()});
  return json;
}

double sample_time_s(const Scenario& scenario) {
  if (scenario.bank.extension() == ".json") return read_bank(scenario.bank).sample_time_s;
  return read_bank_request(scenario.bank).sample_time_s;
}

void print_loops(std::FILE* out, const ControllerSpec& spec, Json& json) {
  for (const PidLoopSpec& named : spec.loops) {
    const PidLoop& loop = named.loop;
    fmt::print(out, "    loop {} -> {}: K_p {:g}{}{}\n", named.output, named.input, loop.K_p,
               loop.T_i_s ? fmt::format(", T_i {:g} s", *loop.T_i_s) : "",
               loop.T_d_s ? fmt::format(", T_d {:g} s, N {:g}", *loop.T_d_s, loop.N) : "");
    json["loops"].push_back({{"output", named.output},
                             {"input", named.input},
                             {"K_p", loop.K_p},
                             {"T_i_s", loop.T_i_s ? Json(*loop.T_i_s) : Json(nullptr)},
                             {"T_d_s", loop.T_d_s ? Json(*loop.T_d_s) : Json(nullptr)}});
  }
}

void print_wishes(std::FILE* out, const ControllerSpec& spec, Json& json) {
  for (const auto& [output, value] : spec.reference) {
    fmt::print(out, "    reference {} = {:g}\n", output, value);
    json["reference"].push_back({{"output", output}, {"at_s", 0.0}, {"value", value}});
  }
  for (const ReferenceStepSpec& wish : spec.reference_steps) {
    fmt::print(out, "    reference {} = {:g} from {:g} s\n", wish.output, wish.step.value,
               wish.step.at_s);
    json["reference"].push_back(
        {{"output", wish.output}, {"at_s", wish.step.at_s}, {"value", wish.step.value}});
  }
  for (const auto& [input, range] : spec.limits) {
    fmt::print(out, "    limits {} from {:g} to {:g}\n", input, range[0], range[1]);
    json["limits"][input] = {range[0], range[1]};
  }
}

void print_plan(std::FILE* out, const ControllerPlan& plan, Json& json) {
  if (plan.K.size() > 0) {
    fmt::print(out, "    K = {}\n", matrix_text(plan.K));
    json["K"] = matrix_json(plan.K);
  }
  if (plan.L.size() > 0) {
    fmt::print(out, "    L = {}\n    observer poles {}\n", matrix_text(plan.L),
               poles_text(plan.observer_poles));
    json["L"] = matrix_json(plan.L);
    json["observer_poles"] = poles_json(plan.observer_poles);
  }
  if (!plan.closed_loop_poles.empty()) {
    const double radius = std::abs(plan.closed_loop_poles.front());
    fmt::print(out, "    closed loop: largest pole {:.6g} per sample\n", radius);
    json["closed_loop_poles"] = poles_json(plan.closed_loop_poles);
    json["closed_loop_radius"] = radius;
  }
  for (const std::string& warning : plan.warnings) fmt::print(out, "    WARNING  {}\n", warning);
  json["warnings"] = plan.warnings;
}

}  // namespace

Json print_controller(std::FILE* out, const Scenario& scenario) {
  const ControllerSpec& spec = scenario.controller;
  const std::string kind(controller_kind_name(spec.kind));
  fmt::print(out, "  controller {}{}\n", kind,
             spec.kind == ControllerKind::kRecorded ? " " + spec.commands.string() : "");
  Json json{{"kind", kind}};
  print_loops(out, spec, json);
  print_wishes(out, spec, json);
  std::error_code error;
  if (!std::filesystem::is_regular_file(scenario.plant, error) ||
      !std::filesystem::is_regular_file(scenario.bank, error)) {
    return json;
  }
  const PlantModel plant = read_plant(scenario.plant);
  std::optional<NamedText> commands;
  if (const auto part = read_commands(scenario)) {
    commands = {part->text, spec.commands.string()};
  }
  print_plan(out, plan_controller(scenario, plant, sample_time_s(scenario), commands), json);
  return json;
}

}  // namespace faultline
