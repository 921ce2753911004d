#pragma once

#include <functional>
#include <random>
#include <vector>

#include <Eigen/Core>

#include "diagnosis/bank/bank.h"
#include "diagnosis/model/plant_model.h"

namespace faultline {

/// A plant and the filter of an observer in its implementation form, sample by sample, in the
/// bank's domain. The Lipschitz functions of both have the slope that is asked for at that sample,
/// so that any course of slopes within the bounds can be played. Plain arithmetic; inputs are zero.
class ObserverSimulation {
 public:
  ObserverSimulation(const PlantModel& plant, const Bank& bank, const ResidualFilter& filter);

  struct Sample {
    Eigen::VectorXd unknown;  ///< disturbances, then noises
    Eigen::VectorXd fault;    ///< per fault
    Eigen::VectorXd slope;    ///< per Lipschitz term
  };
  void start(const Eigen::VectorXd& x);
  /// The residual of this sample; then on to the next. `y_error` is added to what the filter gets.
  Eigen::VectorXd step(const Sample& sample, const Eigen::VectorXd& y_error = {});

  /// Unknown inputs within their bounds (decoupled disturbances: within 1), at the bounds with
  /// probability one half; slopes likewise; no fault.
  [[nodiscard]] Sample random_sample(std::mt19937_64& engine) const;
  [[nodiscard]] Eigen::VectorXd random_state(std::mt19937_64& engine) const;

 private:
  const PlantModel& plant_;
  const Bank& bank_;
  const ResidualFilter& filter_;
  Eigen::MatrixXd A_, B_f_, B_d_, E_o_;
  Eigen::VectorXd x_, v_;
};

/// The course of unknown inputs and slopes, and the start, for which row `row` of the residual at
/// the last of `samples` is largest (nearly: ascent in turns).
struct WorstCourse {
  Eigen::VectorXd x;
  std::vector<ObserverSimulation::Sample> samples;
};
[[nodiscard]] WorstCourse worst_course(const PlantModel& plant, const Bank& bank,
                                       const ResidualFilter& filter, Eigen::Index row,
                                       std::size_t samples);

}  // namespace faultline
