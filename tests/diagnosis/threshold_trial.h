#pragma once

#include <cstdint>
#include <random>
#include <vector>

#include <Eigen/Core>

#include "diagnosis/bank/bank.h"
#include "diagnosis/model/plant_model.h"
#include "diagnosis/runtime/residual_bank.h"

namespace faultline {

/// A plant under state feedback, without a fault, and its bank: unknown inputs within their bounds,
/// played to cross the thresholds. Sampled as the bank's domain says; Lipschitz terms held over a
/// sample.
class ThresholdTrial {
 public:
  /// `plant` and `bank` must outlive the trial. Every disturbance and noise needs a bound.
  ThresholdTrial(const PlantModel& plant, const Bank& bank, std::uint64_t seed);

  struct Result {
    std::uint64_t samples = 0;
    std::uint64_t crossings = 0;  ///< samples at which some evaluation was above its threshold
    double largest = 0.0;         ///< largest evaluation, in thresholds
    std::vector<double> largest_of_worst;  ///< per filter: under its own worst course
  };
  /// Segments of 400 samples, by turns: noise-like courses, courses at the bounds, square waves,
  /// constants, a start anywhere in the states' range and, for linear plants, the course that is
  /// worst for one row of one filter.
  Result run(std::uint64_t samples);

 private:
  enum class Course { kUniform, kExtreme, kSquare, kConstant, kStart, kWorst };
  struct Unknown {  // in bounds: all within ±1
    Eigen::VectorXd disturbance, noise, rounding, lateness;
  };
  void find_responses();
  void begin(Course course);
  void choose(Course course, std::size_t k);
  void step(const Unknown& unknown);
  void advance(const Unknown& unknown);

  const PlantModel& plant_;
  const Bank& bank_;
  ResidualBank filters_;
  std::mt19937_64 draw_;
  Eigen::MatrixXd A_, B_, E_, N_, Eo_, K_;  ///< sampled; columns E_, N_ scaled by their bounds
  Eigen::MatrixXd late_;                    ///< of a change of u: ∫_0^jitter e^(A (T - s)) B ds
  Eigen::VectorXd half_lsb_;
  Eigen::VectorXd x_, u_, u_before_, y_, next_, wanted_;
  Unknown unknown_;
  Eigen::VectorXd square_phase_;
  double square_period_ = 10.0;
  // Per filter row: response to each unknown, sample by sample.
  std::vector<std::vector<Eigen::VectorXd>> response_;  // [row][k]: all unknowns stacked
  std::vector<std::size_t> filter_of_row_;
  std::size_t row_ = 0;
};

}  // namespace faultline
