#include "tests/support/random_plant.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <ostream>
#include <string>

#include <Eigen/LU>
#include <Eigen/QR>
#include <Eigen/SVD>

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kRange = 100.0;

std::vector<std::string> numbered(const std::string& letter, Index count) {
  std::vector<std::string> names;
  for (Index i = 1; i <= count; ++i) {
    names.push_back(letter + std::to_string(i));
  }
  return names;
}

PlantModel plant_of(const MatrixXd& A, const MatrixXd& B, const MatrixXd& C) {
  PlantModel plant;
  plant.name = "random";
  plant.A = A;
  plant.B = B;
  plant.C = C;
  plant.D = MatrixXd::Zero(C.rows(), B.cols());
  plant.state_names = numbered("x", A.rows());
  plant.input_names = numbered("u", B.cols());
  plant.output_names = numbered("y", C.rows());
  plant.input_range = VectorXd::Constant(B.cols(), kRange);
  plant.output_range = VectorXd::Constant(C.rows(), kRange);
  plant.x_operating = VectorXd::Zero(A.rows());
  plant.u_operating = VectorXd::Zero(B.cols());
  plant.y_operating = VectorXd::Zero(C.rows());
  return plant;
}

void add_actuator_faults(PlantModel& plant) {
  for (Index j = 0; j < plant.m(); ++j) {
    plant.faults.push_back({plant.input_names[static_cast<std::size_t>(j)], FaultKind::kActuator,
                            plant.B.col(j), plant.D.col(j)});
  }
}

void add_sensor_faults(PlantModel& plant, Index count) {
  for (Index j = 0; j < std::min(count, plant.q()); ++j) {
    plant.faults.push_back({plant.output_names[static_cast<std::size_t>(j)], FaultKind::kSensor,
                            VectorXd::Zero(plant.n()), VectorXd::Unit(plant.q(), j)});
  }
}

void add_fault(PlantModel& plant, const VectorXd& state, const VectorXd& output) {
  const auto components =
      std::count_if(plant.faults.begin(), plant.faults.end(),
                    [](const Fault& fault) { return fault.kind == FaultKind::kComponent; });
  plant.faults.push_back(
      {"f" + std::to_string(components + 1), FaultKind::kComponent, state, output});
}

void add_disturbance(PlantModel& plant, const VectorXd& state, const VectorXd& output) {
  plant.disturbances.push_back(
      {"d" + std::to_string(plant.disturbances.size() + 1), state, output, {}});
}

// Orthogonal projector onto Ker C.
MatrixXd kernel_projector(const MatrixXd& C) {
  return MatrixXd::Identity(C.cols(), C.cols()) -
         C.completeOrthogonalDecomposition().pseudoInverse() * C;
}

PlantModel generic(RandomNumbers& random, const PlantRecipe& recipe) {
  const double scale = 1.0 / std::sqrt(static_cast<double>(recipe.n));
  return plant_of(scale * random.normal(recipe.n, recipe.n), random.normal(recipe.n, recipe.m),
                  random.normal(recipe.q, recipe.n));
}

PlantModel with_unobservable_modes(RandomNumbers& random, const PlantRecipe& recipe) {
  PlantModel plant = generic(random, recipe);
  const Index n = recipe.n;
  const Index hidden = n > 1 ? random.whole(1, std::max<Index>(1, n / 3)) : 0;
  plant.A.topRightCorner(n - hidden, hidden).setZero();
  plant.C.rightCols(hidden).setZero();
  return transformed(plant, random.orthogonal(n));
}

PlantModel of_high_relative_degree(RandomNumbers& random, const PlantRecipe& recipe) {
  PlantModel plant = generic(random, recipe);
  const MatrixXd unseen = kernel_projector(plant.C);
  if (unseen.norm() < 0.5) {
    return plant;  // every state is measured
  }
  for (Index j = 0; j < (recipe.m + 1) / 2; ++j) {
    plant.B.col(j) = (unseen * plant.B.col(j)).normalized();
  }
  const VectorXd b = plant.B.col(0);
  plant.A += (unseen * random.normal(recipe.n, 1) - plant.A * b) * b.transpose();
  return plant;
}

PlantModel with_invariant_zeros(RandomNumbers& random, const PlantRecipe& recipe) {
  PlantModel plant = generic(random, recipe);
  const Index count = std::min({recipe.m, recipe.n - 1, Index{3}});
  // (A - zI) x + b = 0 and C x = 0: the input -e^zt into b shows in no output.
  const MatrixXd X = random.normal(recipe.n, count);
  plant.C = (plant.C * kernel_projector(X.transpose())).eval();
  for (Index j = 0; j < count; ++j) {
    const double zero = random.uniform(-2.0, 2.0);
    plant.B.col(j) = zero * X.col(j) - plant.A * X.col(j);
  }
  return plant;
}

PlantModel with_integrators(RandomNumbers& random, const PlantRecipe& recipe) {
  PlantModel plant = generic(random, recipe);
  const Index n = recipe.n;
  const Index chain = random.whole(1, std::max<Index>(1, n / 2));
  plant.A.topLeftCorner(chain, n).setZero();
  for (Index i = 0; i + 1 < chain; ++i) {
    plant.A(i, i + 1) = 1.0;
  }
  if (chain < n) {
    plant.A(chain - 1, chain) = 1.0;
  }
  plant.A.bottomLeftCorner(n - chain, chain).setZero();
  return plant;
}

PlantModel of_whole_numbers(RandomNumbers& random, const PlantRecipe& recipe) {
  const Index n = recipe.n;
  const Index rank = random.whole(1, n);
  MatrixXd A = random.whole(n, rank, 1) * random.whole(rank, n, 1);
  if (random.whole(0, 1) == 1) {
    A = random.whole(n, n, 2);
  }
  // Few entries: coincidences are frequent.
  const auto sparse = [&](Index rows, Index cols) -> MatrixXd {
    return random.whole(rows, cols, 2).cwiseProduct(random.whole(rows, cols, 1).cwiseAbs());
  };
  return plant_of(A, sparse(n, recipe.m), sparse(recipe.q, n));
}

PlantModel of_whole_numbers_with_zeros(RandomNumbers& random, const PlantRecipe& recipe) {
  const Index n = recipe.n;
  const Index count = std::min({recipe.m, n - 1, Index{3}});
  MatrixXd A = random.whole(n, n, 1);
  MatrixXd B = random.whole(n, recipe.m, 1);
  MatrixXd C = random.whole(recipe.q, n, 1);
  // Zero directions are the last states; (A - zI) x + b = 0, C x = 0.
  C.rightCols(count).setZero();
  for (Index j = 0; j < count; ++j) {
    B.col(j) =
        static_cast<double>(random.whole(-1, 1)) * VectorXd::Unit(n, n - 1 - j) - A.col(n - 1 - j);
  }
  return plant_of(A, B, C);
}

// Directions that are zero are no faults: they get an entry.
void refuse_zero_columns(PlantModel& plant) {
  for (Index j = 0; j < plant.m(); ++j) {
    if (plant.B.col(j).isZero(0.0)) {
      plant.B(j % plant.n(), j) = 1.0;
    }
  }
}

void add_dependent_faults(PlantModel& plant) {
  const VectorXd none = VectorXd::Zero(plant.q());
  add_fault(plant, plant.B.col(0), none);
  add_fault(plant, plant.B.col(0) - 2.0 * plant.B.col(plant.m() - 1), none);
  if (plant.faults.back().state.isZero(0.0)) {
    plant.faults.back().state = 3.0 * plant.B.col(0);
  }
}

}  // namespace

const std::vector<PlantKind>& plant_kinds() {
  static const std::vector<PlantKind> kinds = {
      PlantKind::kGeneric,          PlantKind::kUnobservableModes, PlantKind::kHighRelativeDegree,
      PlantKind::kInvariantZeros,   PlantKind::kDependentFaults,   PlantKind::kSensorFaults,
      PlantKind::kMixedFaults,      PlantKind::kDisturbances,      PlantKind::kIntegrators,
      PlantKind::kWholeNumbers,     PlantKind::kWholeZeros,        PlantKind::kWholeMixed,
      PlantKind::kWholeDisturbances};
  return kinds;
}

std::string_view plant_kind_name(PlantKind kind) {
  switch (kind) {
    case PlantKind::kGeneric:
      return "generic";
    case PlantKind::kUnobservableModes:
      return "unobservable modes";
    case PlantKind::kHighRelativeDegree:
      return "high relative degree";
    case PlantKind::kInvariantZeros:
      return "invariant zeros";
    case PlantKind::kDependentFaults:
      return "dependent faults";
    case PlantKind::kSensorFaults:
      return "sensor faults";
    case PlantKind::kMixedFaults:
      return "mixed faults";
    case PlantKind::kDisturbances:
      return "disturbances";
    case PlantKind::kIntegrators:
      return "integrators";
    case PlantKind::kWholeNumbers:
      return "whole numbers";
    case PlantKind::kWholeZeros:
      return "whole numbers, invariant zeros";
    case PlantKind::kWholeMixed:
      return "whole numbers, mixed faults";
    case PlantKind::kWholeDisturbances:
      return "whole numbers, disturbances";
  }
  return "?";
}

std::ostream& operator<<(std::ostream& out, const PlantRecipe& recipe) {
  return out << "{" << plant_kind_name(recipe.kind) << ", n = " << recipe.n << ", m = " << recipe.m
             << ", q = " << recipe.q << ", seed = " << recipe.seed << "}";
}

std::ostream& operator<<(std::ostream& out, const BenchPlantRecipe& recipe) {
  return out << "{" << (recipe.time == TimeDomain::kContinuous ? "continuous" : "discrete")
             << ", n = " << recipe.n << ", m = " << recipe.m << ", q = " << recipe.q
             << ", sensor faults = " << recipe.sensor_faults
             << ", disturbances = " << recipe.disturbances
             << (recipe.has_washout ? ", washout" : "") << ", seed = " << recipe.seed << "}";
}

double RandomNumbers::uniform(double from, double to) {
  return from + (to - from) * std::ldexp(static_cast<double>(engine_() >> 11), -53);
}

double RandomNumbers::normal() {
  // Box, Muller, Ann. Math. Stat. 29 (1958); 1 - uniform is never 0.
  const double radius = std::sqrt(-2.0 * std::log(1.0 - uniform(0.0, 1.0)));
  return radius * std::cos(uniform(0.0, 2.0 * std::numbers::pi));
}

std::int64_t RandomNumbers::whole(std::int64_t from, std::int64_t to) {
  return from + static_cast<std::int64_t>(engine_() % static_cast<std::uint64_t>(to - from + 1));
}

MatrixXd RandomNumbers::normal(Index rows, Index cols) {
  MatrixXd X(rows, cols);
  std::generate(X.data(), X.data() + X.size(), [this] { return normal(); });
  return X;
}

MatrixXd RandomNumbers::whole(Index rows, Index cols, std::int64_t largest) {
  MatrixXd X(rows, cols);
  std::generate(X.data(), X.data() + X.size(),
                [&] { return static_cast<double>(whole(-largest, largest)); });
  return X;
}

MatrixXd RandomNumbers::orthogonal(Index n) {
  return Eigen::HouseholderQR<MatrixXd>(normal(n, n)).householderQ();
}

PlantModel random_plant(const PlantRecipe& recipe) {
  RandomNumbers random(recipe.seed);
  PlantModel plant;
  switch (recipe.kind) {
    case PlantKind::kUnobservableModes:
      plant = with_unobservable_modes(random, recipe);
      break;
    case PlantKind::kHighRelativeDegree:
      plant = of_high_relative_degree(random, recipe);
      break;
    case PlantKind::kInvariantZeros:
      plant = with_invariant_zeros(random, recipe);
      break;
    case PlantKind::kIntegrators:
      plant = with_integrators(random, recipe);
      break;
    case PlantKind::kWholeNumbers:
    case PlantKind::kWholeMixed:
    case PlantKind::kWholeDisturbances:
      plant = of_whole_numbers(random, recipe);
      break;
    case PlantKind::kWholeZeros:
      plant = of_whole_numbers_with_zeros(random, recipe);
      break;
    default:
      plant = generic(random, recipe);
  }
  refuse_zero_columns(plant);
  add_actuator_faults(plant);
  const Index n = recipe.n;
  const Index q = recipe.q;
  switch (recipe.kind) {
    case PlantKind::kDependentFaults:
      add_dependent_faults(plant);
      break;
    case PlantKind::kSensorFaults:
      add_sensor_faults(plant, 2);
      break;
    case PlantKind::kMixedFaults:
      add_fault(plant, random.normal(n, 1), random.normal(q, 1));
      add_fault(plant, random.normal(n, 1), random.normal(q, 1));
      break;
    case PlantKind::kDisturbances:
      add_disturbance(plant, random.normal(n, 1), VectorXd::Zero(q));
      if (q > 2) {
        add_disturbance(plant, VectorXd::Zero(n), random.normal(q, 1));
      }
      break;
    case PlantKind::kWholeMixed:
    case PlantKind::kWholeDisturbances: {
      add_sensor_faults(plant, 1);
      VectorXd output = random.whole(q, 1, 1);
      output[0] = 1.0;
      add_fault(plant, random.whole(n, 1, 2), output);
      if (recipe.kind == PlantKind::kWholeMixed) {
        break;
      }
      VectorXd state = random.whole(n, 1, 1);
      state[n - 1] = 1.0;
      add_disturbance(plant, state, random.whole(q, 1, 1));
      break;
    }
    default:
      break;
  }
  return plant;
}

PlantModel as_discrete(PlantModel plant) {
  const double norm = Eigen::JacobiSVD<MatrixXd>(plant.A).singularValues()[0];
  if (norm > 0.0) {
    plant.A *= 0.9 / norm;
  }
  plant.time = TimeDomain::kDiscrete;
  plant.sample_time_s = 1.0;
  return plant;
}

PlantModel transformed(const PlantModel& plant, const MatrixXd& T) {
  const Eigen::PartialPivLU<MatrixXd> lu(T);
  PlantModel moved = plant;
  moved.A = lu.solve(plant.A * T);
  moved.B = lu.solve(plant.B);
  moved.C = plant.C * T;
  for (Fault& fault : moved.faults) {
    fault.state = lu.solve(fault.state).eval();
  }
  for (Disturbance& disturbance : moved.disturbances) {
    disturbance.state = lu.solve(disturbance.state).eval();
  }
  return moved;
}

MatrixXd random_scaling(Index n, double decades, std::uint64_t seed) {
  RandomNumbers random(seed);
  VectorXd scale(n);
  std::generate(scale.data(), scale.data() + n,
                [&] { return std::pow(10.0, random.uniform(-decades, decades)); });
  return scale.asDiagonal();
}

PlantModel random_bench_plant(const BenchPlantRecipe& recipe) {
  RandomNumbers random(recipe.seed);
  const Index n = recipe.n;
  // Poles from -2 to -10 1/s on the diagonal of a triangular matrix, then turned: stable whatever
  // the coupling.
  MatrixXd A = random.normal(n, n).triangularView<Eigen::StrictlyUpper>();
  for (Index i = 0; i < n; ++i) {
    A(i, i) = -random.uniform(2.0, 10.0);
  }
  const MatrixXd Q = random.orthogonal(n);
  A = (Q.transpose() * A * Q).eval();
  MatrixXd B = 4.0 * random.normal(n, recipe.m);
  const MatrixXd C = random.normal(recipe.q, n);
  VectorXd disturbed = random.normal(n, 1);
  if (recipe.time == TimeDomain::kDiscrete) {
    // Some discrete plant with these rates: nothing depends on its being a sampled one.
    constexpr double kSampleTime_s = 0.01;
    A = (MatrixXd::Identity(n, n) + kSampleTime_s * A + 0.5 * kSampleTime_s * kSampleTime_s * A * A)
            .eval();
    B *= kSampleTime_s;
    disturbed *= kSampleTime_s;
  }
  if (recipe.has_washout) {
    // Its steady state k is in Ker C.
    const MatrixXd k = kernel_projector(C) * random.normal(n, 1);
    B.col(0) = recipe.time == TimeDomain::kDiscrete ? MatrixXd(k - A * k) : MatrixXd(-A * k);
  }
  PlantModel plant = plant_of(A, B, C);
  if (recipe.time == TimeDomain::kDiscrete) {
    plant.time = TimeDomain::kDiscrete;
    plant.sample_time_s = 0.01;
  }
  add_actuator_faults(plant);
  add_sensor_faults(plant, recipe.sensor_faults);
  for (Index i = 0; i < recipe.disturbances; ++i) {
    add_disturbance(plant, disturbed, VectorXd::Zero(recipe.q));
    disturbed = random.normal(n, 1) * disturbed.norm();
  }
  return plant;
}

}  // namespace faultline
