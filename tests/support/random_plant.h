#pragma once

#include <cstdint>
#include <iosfwd>
#include <random>
#include <string_view>
#include <vector>

#include <Eigen/Core>

#include "diagnosis/model/plant_model.h"

namespace faultline {

/// What is special about a random plant.
enum class PlantKind {
  kGeneric,             ///< normally distributed entries, faults on all inputs
  kUnobservableModes,   ///< some modes never reach the outputs
  kHighRelativeDegree,  ///< input columns b with C b = 0; the first also with C A b = 0
  kInvariantZeros,      ///< zeros from single inputs to all outputs, stable and unstable ones
  kDependentFaults,     ///< repeated and dependent fault directions
  kSensorFaults,        ///< faults on inputs and outputs
  kMixedFaults,         ///< fault directions with a state and an output part
  kDisturbances,        ///< a state and (from three outputs on) an output disturbance, to decouple
  kIntegrators,         ///< A has zero eigenvalues, in chains
  kWholeNumbers,        ///< A, B, C of small whole numbers; A often singular
  kWholeZeros,          ///< the same with invariant zeros
  kWholeMixed,          ///< the same with a sensor fault and a mixed fault
  kWholeDisturbances,   ///< the same with a mixed disturbance too
};

/// All kinds, and the names failures show them by.
[[nodiscard]] const std::vector<PlantKind>& plant_kinds();
[[nodiscard]] std::string_view plant_kind_name(PlantKind kind);

/// A random plant in full: equal recipes give equal plants.
struct PlantRecipe {
  PlantKind kind = PlantKind::kGeneric;
  Eigen::Index n = 1;  ///< states
  Eigen::Index m = 1;  ///< inputs
  Eigen::Index q = 1;  ///< outputs
  std::uint64_t seed = 0;
};
std::ostream& operator<<(std::ostream& out, const PlantRecipe& recipe);

/// Random numbers that do not depend on the standard library (its distributions do).
class RandomNumbers {
 public:
  explicit RandomNumbers(std::uint64_t seed) : engine_(seed) {}
  double uniform(double from, double to);
  double normal();
  std::int64_t whole(std::int64_t from, std::int64_t to);  ///< both included
  Eigen::MatrixXd normal(Eigen::Index rows, Eigen::Index cols);
  Eigen::MatrixXd whole(Eigen::Index rows, Eigen::Index cols, std::int64_t largest);
  Eigen::MatrixXd orthogonal(Eigen::Index n);

 private:
  std::mt19937_64 engine_;
};

/// A continuous plant with D = 0. Faults: "u1".. on the inputs, "y1".. on outputs, "f1".. others;
/// disturbances "d1"...
[[nodiscard]] PlantModel random_plant(const PlantRecipe& recipe);

/// The same plant as a discrete one of sample time 1, with A scaled to spectral norm 0.9.
[[nodiscard]] PlantModel as_discrete(PlantModel plant);

/// The plant in the coordinates z, x = T z: A -> T⁻¹ A T, and so on.
[[nodiscard]] PlantModel transformed(const PlantModel& plant, const Eigen::MatrixXd& T);
/// T = diag(10^[-decades, decades]).
[[nodiscard]] Eigen::MatrixXd random_scaling(Eigen::Index n, double decades, std::uint64_t seed);

/// A plant for the bench: stable (no loop needed), time constants of 0.1 .. 0.5 s, gains of about
/// one. Discrete ones have sample time 0.01 s.
struct BenchPlantRecipe {
  Eigen::Index n = 3, m = 3, q = 3;
  Eigen::Index sensor_faults = 0;  ///< on the first outputs
  Eigen::Index disturbances = 0;   ///< state disturbances "d1"..
  bool has_washout = false;        ///< a constant first input shows in no output (needs q < n)
  TimeDomain time = TimeDomain::kContinuous;
  std::uint64_t seed = 0;
};
std::ostream& operator<<(std::ostream& out, const BenchPlantRecipe& recipe);
[[nodiscard]] PlantModel random_bench_plant(const BenchPlantRecipe& recipe);

}  // namespace faultline
