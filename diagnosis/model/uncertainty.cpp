#include "diagnosis/model/uncertainty.h"

#include <algorithm>
#include <cassert>
#include <optional>
#include <utility>

#include <Eigen/SVD>
#include <fmt/format.h>

#include "diagnosis/model/plant_model.h"
#include "diagnosis/model/toml_reader.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// Directions smaller than this part of the largest are rounding errors of the file's decimals.
constexpr double kRankTolerance = 1e-9;

void check_name(const TomlTable& table, const std::string& name, const PlantModel& plant) {
  std::vector<std::string> taken = plant.fault_names();
  for (const std::vector<std::string>* names :
       {&plant.state_names, &plant.input_names, &plant.output_names}) {
    taken.insert(taken.end(), names->begin(), names->end());
  }
  for (const Disturbance& disturbance : plant.disturbances) {
    taken.push_back(disturbance.name);
  }
  for (const Uncertainty& uncertainty : plant.uncertainties) {
    taken.push_back(uncertainty.name);
  }
  if (name.empty() || name == "all" || std::find(taken.begin(), taken.end(), name) != taken.end()) {
    throw table.error(
        "name",
        fmt::format("found \"{}\", expected a name that nothing else in the plant has", name));
  }
}

struct Pair {
  std::optional<MatrixXd> A, B;
};

Pair read_pair(TomlTable& table, const PlantModel& plant) {
  Pair pair{table.optional_matrix("A", plant.n(), plant.n()),
            table.optional_matrix("B", plant.n(), plant.m())};
  if (!pair.A && !pair.B) {
    throw table.error("", "found neither, expected `A` or `B`");
  }
  return pair;
}

// dA/dp and dB/dp, and how far the parameter may be off.
void read_parameter(TomlTable& table, const PlantModel& plant, Uncertainty& uncertainty) {
  const Pair pair = read_pair(table, plant);
  const double range = table.number("range");
  if (range <= 0.0) {
    throw table.error("range", fmt::format("found {}, expected a positive number: how far the "
                                           "parameter may be off",
                                           range));
  }
  uncertainty.delta_A.push_back(range * pair.A.value_or(MatrixXd::Zero(plant.n(), plant.n())));
  uncertainty.delta_B.push_back(range * pair.B.value_or(MatrixXd::Zero(plant.n(), plant.m())));
}

// Whole matrices of the plant elsewhere.
void read_plants(TomlTable& table, const PlantModel& plant, Uncertainty& uncertainty) {
  for (const char* const key : {"A", "B", "range"}) {
    if (table.has(key)) {
      throw table.error(key,
                        "found it beside [[uncertainty.plant]], expected one of both: a "
                        "parameter's derivatives, or other plants");
    }
  }
  uncertainty.is_parameter = false;
  for (TomlTable& other : table.tables("plant")) {
    const Pair pair = read_pair(other, plant);
    uncertainty.delta_A.push_back(pair.A.value_or(plant.A) - plant.A);
    uncertainty.delta_B.push_back(pair.B.value_or(plant.B) - plant.B);
  }
}

// U, one column per unknown input; the largest entry of each is positive.
MatrixXd directions(const Uncertainty& uncertainty, const PlantModel& plant) {
  const VectorXd x = plant.state_range.value_or(VectorXd::Ones(plant.n()));
  const Index width = plant.n() + plant.m();
  MatrixXd all(plant.n(), width * std::ssize(uncertainty.delta_A));
  for (std::size_t i = 0; i < uncertainty.delta_A.size(); ++i) {
    const Index at = width * static_cast<Index>(i);
    all.middleCols(at, plant.n()) = uncertainty.delta_A[i] * x.asDiagonal();
    all.middleCols(at + plant.n(), plant.m()) =
        uncertainty.delta_B[i] * plant.input_range.asDiagonal();
  }
  const Eigen::JacobiSVD<MatrixXd> svd(all, Eigen::ComputeThinU);
  const VectorXd& values = svd.singularValues();
  const Index rank = (values.array() > kRankTolerance * values[0]).count();
  MatrixXd U = svd.matrixU().leftCols(rank);
  for (Index j = 0; j < rank; ++j) {
    Index largest = 0;
    U.col(j).cwiseAbs().maxCoeff(&largest);
    if (U(largest, j) < 0.0) {
      U.col(j) = -U.col(j);
    }
    // Exact zeros are exact: an uncertainty of one equation is one of no other.
    U.col(j) = (U.col(j).array().abs() > 1e-15).select(U.col(j), 0.0);
  }
  return U;
}

std::optional<double> bound_of(const VectorXd& u, const Uncertainty& uncertainty,
                               const PlantModel& plant) {
  if (!plant.state_range) {
    return std::nullopt;
  }
  double bound = 0.0;
  for (std::size_t i = 0; i < uncertainty.delta_A.size(); ++i) {
    const double here =
        (u.transpose() * uncertainty.delta_A[i]).cwiseAbs().dot(*plant.state_range) +
        (u.transpose() * uncertainty.delta_B[i]).cwiseAbs().dot(plant.input_range);
    bound = std::max(bound, here);
  }
  return bound;
}

}  // namespace

void read_uncertainties(TomlTable& root, PlantModel& plant) {
  for (TomlTable& table : root.tables("uncertainty")) {
    Uncertainty uncertainty;
    uncertainty.name = table.string("name");
    check_name(table, uncertainty.name, plant);
    if (table.has("plant")) {
      read_plants(table, plant, uncertainty);
    } else {
      read_parameter(table, plant, uncertainty);
    }
    const auto is_zero = [](const MatrixXd& delta) { return delta.isZero(0.0); };
    if (std::all_of(uncertainty.delta_A.begin(), uncertainty.delta_A.end(), is_zero) &&
        std::all_of(uncertainty.delta_B.begin(), uncertainty.delta_B.end(), is_zero)) {
      throw table.error("", "found no entry of A or B that it changes, expected one at least");
    }
    const MatrixXd U = directions(uncertainty, plant);
    for (Index j = 0; j < U.cols(); ++j) {
      Disturbance disturbance;
      disturbance.name =
          U.cols() == 1 ? uncertainty.name : fmt::format("{}.{}", uncertainty.name, j + 1);
      disturbance.state = U.col(j);
      disturbance.output = VectorXd::Zero(plant.q());
      disturbance.bound = bound_of(U.col(j), uncertainty, plant);
      disturbance.uncertainty = uncertainty.name;
      plant.disturbances.push_back(std::move(disturbance));
    }
    plant.uncertainties.push_back(std::move(uncertainty));
  }
}

void apply_uncertainty(const Uncertainty& uncertainty, const std::vector<double>& delta,
                       PlantModel& plant) {
  assert(delta.size() == uncertainty.delta_A.size());
  for (std::size_t i = 0; i < delta.size(); ++i) {
    plant.A += delta[i] * uncertainty.delta_A[i];
    plant.B += delta[i] * uncertainty.delta_B[i];
  }
  // What an actuator's fault adds goes through its column of B.
  for (Fault& fault : plant.faults) {
    const auto input = std::find(plant.input_names.begin(), plant.input_names.end(), fault.name);
    if (fault.kind == FaultKind::kActuator && input != plant.input_names.end()) {
      fault.state = plant.B.col(input - plant.input_names.begin());
    }
  }
}

}  // namespace faultline
