#include "tests/diagnosis/geometric_oracle.h"

#include <fstream>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Json = nlohmann::json;

Json load(const std::string& name) {
  std::ifstream stream(std::string(FAULTLINE_GOLDEN_DIR) + "/geometric/" + name);
  return Json::parse(stream);
}

MatrixXd matrix(const Json& rows) {
  const auto row_count = static_cast<Index>(rows.size());
  const auto col_count = rows.empty() ? 0 : static_cast<Index>(rows.front().size());
  MatrixXd result(row_count, col_count);
  for (Index i = 0; i < row_count; ++i) {
    for (Index j = 0; j < col_count; ++j) {
      result(i, j) = rows[static_cast<std::size_t>(i)][static_cast<std::size_t>(j)].get<double>();
    }
  }
  return result;
}

std::vector<std::size_t> from_zero(const Json& numbers) {
  std::vector<std::size_t> indices;
  for (const Json& number : numbers) {
    indices.push_back(number.get<std::size_t>() - 1);
  }
  return indices;
}

OracleResidual residual(const Json& json) {
  return {from_zero(json.at("decouple")), json.at("dimW").get<Index>(),
          json.at("dimS").get<Index>(),   json.value("quotient_dim", Index{0}),
          json.value("rankH", Index{0}),  matrix(json.at("projW")),
          matrix(json.at("projS")),       json.at("dist_b_to_S").get<std::vector<double>>(),
          from_zero(json.at("responds")), from_zero(json.value("washout_only_ct", Json::array()))};
}

OracleCase oracle_case(const Json& json) {
  OracleCase result;
  result.name = json.at("name").get<std::string>();
  result.A = matrix(json.at("A"));
  result.B = matrix(json.at("B"));
  result.C = matrix(json.at("C"));
  result.Df = json.at("Df").is_null() ? MatrixXd(result.C.rows(), 0) : matrix(json.at("Df"));
  result.concurrent = json.at("p").get<std::size_t>();
  result.poles = json.at("poles").get<std::vector<double>>();
  const Json& expected = json.at("expected");
  result.is_solvable = expected.at("solvable").get<bool>();
  result.are_signatures_distinct = expected.at("signatures_distinct").get<bool>();
  result.is_strongly_isolable = expected.at("strongly_isolable").get<bool>();
  for (const Json& set : expected.at("confusable_2p_sets")) {
    result.confusable_2p_sets.push_back(from_zero(set));
  }
  for (const Json& failure : expected.at("failing")) {
    for (const std::size_t fault : from_zero(failure.at("undetectable"))) {
      result.failing.emplace_back(from_zero(failure.at("decouple")), fault);
    }
  }
  for (const Json& entry : expected.at("residuals")) {
    result.residuals.push_back(residual(entry));
  }
  return result;
}

std::vector<std::string> numbered(char letter, Index count) {
  std::vector<std::string> names;
  for (Index i = 1; i <= count; ++i) {
    names.push_back(fmt::format("{}{}", letter, i));
  }
  return names;
}

}  // namespace

PlantModel OracleCase::plant() const {
  PlantModel plant;
  plant.name = name;
  plant.state_names = numbered('x', A.rows());
  plant.input_names = numbered('u', B.cols());
  plant.output_names = numbered('y', C.rows());
  plant.A = A;
  plant.B = B;
  plant.C = C;
  plant.D = MatrixXd::Zero(C.rows(), B.cols());
  plant.input_range = Eigen::VectorXd::Constant(B.cols(), 100.0);
  plant.output_range = Eigen::VectorXd::Constant(C.rows(), 100.0);
  plant.x_operating = Eigen::VectorXd::Zero(A.rows());
  plant.u_operating = Eigen::VectorXd::Zero(B.cols());
  plant.y_operating = Eigen::VectorXd::Zero(C.rows());
  for (Index j = 0; j < B.cols(); ++j) {
    plant.faults.push_back({plant.input_names[static_cast<std::size_t>(j)], FaultKind::kActuator,
                            B.col(j), Eigen::VectorXd::Zero(C.rows())});
  }
  for (Index j = 0; j < Df.cols(); ++j) {
    plant.disturbances.push_back(
        {fmt::format("d{}", j + 1), Eigen::VectorXd::Zero(A.rows()), Df.col(j), {}});
  }
  return plant;
}

BankRequest OracleCase::request() const {
  BankRequest request;
  request.name = name;
  request.concurrent = concurrent;
  request.poles.assign(poles.begin(), poles.end());
  request.sample_time_s = 0.01;
  request.decouple = numbered('d', Df.cols());
  request.threshold = 0.05;
  return request;
}

std::vector<OracleCase> oracle_cases() {
  std::vector<OracleCase> cases = {oracle_case(load("hou_reference.json"))};
  for (const Json& json : load("geometric_cases.json")) {
    cases.push_back(oracle_case(json));
  }
  return cases;
}

std::map<std::string, ExactGenerator> exact_hou_generators() {
  const Json reference = load("hou_reference.json");
  std::map<std::string, ExactGenerator> generators;
  for (const auto& [name, json] : reference.at("exact_generators_paper_sign").items()) {
    generators[name] = {matrix(json.at("P")), matrix(json.at("F")), matrix(json.at("E")),
                        matrix(json.at("G")), matrix(json.at("M")), matrix(json.at("H"))};
  }
  return generators;
}

std::vector<OracleProjection> oracle_projections(const std::string& disturbance) {
  const Json reference = load("hou_reference.json");
  std::vector<OracleProjection> projections;
  for (const Json& json : reference.at("disturbance").at(disturbance).at("projection")) {
    projections.push_back({from_zero(json.at("decouple")), json.at("dimS").get<Index>(),
                           matrix(json.at("projS")), from_zero(json.at("responds"))});
  }
  return projections;
}

std::vector<OracleConstantBias> oracle_constant_bias(const std::string& disturbance) {
  const Json reference = load("hou_reference.json");
  std::vector<OracleConstantBias> biases;
  for (const Json& json : reference.at("disturbance").at(disturbance).at("constant_bias")) {
    OracleConstantBias bias{from_zero(json.at("decouple")),
                            json.at("dimS").get<Index>(),
                            from_zero(json.at("responds")),
                            {}};
    for (const Json& gain : json.at("dc")) {
      bias.has_dc.push_back(std::abs(gain.get<double>()) > 1e-9);
    }
    biases.push_back(bias);
  }
  return biases;
}

std::vector<OracleScenario> oracle_scenarios() {
  const Json simulation = load("hou_simulation.json");
  std::vector<OracleScenario> scenarios;
  for (const auto& [name, json] : simulation.items()) {
    if (!json.contains("residuals") || !json.at("gains").empty() || !json.at("kw").empty()) {
      continue;
    }
    OracleScenario scenario;
    scenario.name = name;
    for (const Json& step : json.at("faults")) {
      scenario.steps.push_back(
          {step[0].get<std::size_t>() - 1, step[1].get<double>(), step[2].get<double>()});
    }
    for (const auto& [residual_name, entry] : json.at("residuals").items()) {
      OracleScenario::Residual residual;
      if (!entry.at("first_cross").is_null()) {
        residual.first_crossing_s = entry.at("first_cross").get<double>();
      }
      residual.final_value = entry.at("r_final").get<double>();
      scenario.residuals[residual_name] = residual;
    }
    scenarios.push_back(std::move(scenario));
  }
  return scenarios;
}

}  // namespace faultline
