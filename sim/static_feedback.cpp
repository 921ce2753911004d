#include "sim/static_feedback.h"

#include <algorithm>
#include <stdexcept>
#include <utility>

#include <Eigen/QR>
#include <fmt/format.h>

#include "diagnosis/model/discretize.h"
#include "diagnosis/model/riccati.h"

namespace faultline {

ControlLaw state_feedback(const PlantModel& model, const Eigen::MatrixXd& K,
                          const Eigen::VectorXd& feedforward) {
  const Eigen::ColPivHouseholderQR<Eigen::MatrixXd> decomposition(model.C);
  if (decomposition.rank() < model.n()) {
    throw std::invalid_argument(fmt::format(
        "state feedback acts on C^+ y: found C of rank {}, expected {} (every state measured)",
        decomposition.rank(), model.n()));
  }
  if (!model.D.isZero(0.0)) {
    throw std::invalid_argument(
        "state feedback acts on C^+ y: found a plant with D, expected one without");
  }
  const Eigen::MatrixXd left_inverse =
      decomposition.solve(Eigen::MatrixXd::Identity(model.q(), model.q()));
  return {K * left_inverse, CommandBase(model.u_operating + feedforward),
          Reference(model.y_operating)};
}

ControlLaw open_loop(const PlantModel& model, const Eigen::VectorXd& feedforward) {
  return {Eigen::MatrixXd::Zero(model.m(), model.q()), CommandBase(model.u_operating + feedforward),
          Reference(model.y_operating)};
}

Eigen::MatrixXd lqr_gain(const PlantModel& model, double sample_time_s, const Eigen::MatrixXd& Q,
                         const Eigen::MatrixXd& R) {
  if (model.time == TimeDomain::kDiscrete) return lqr_gain(model.A, model.B, Q, R);
  const SampledSystem sampled = discretize_zoh(model.A, model.B, sample_time_s);
  return lqr_gain(sampled.A, sampled.B, Q, R);
}

StaticFeedback::StaticFeedback(ControlLaw law)
    : law_(std::move(law)), dy_(law_.gain.cols()), y_ref_(law_.gain.cols()), u_(law_.gain.rows()) {}

void StaticFeedback::command(std::uint32_t k, std::span<const double> y,
                             std::span<double> u) noexcept {
  law_.reference.at(k, y_ref_);
  dy_ = Eigen::Map<const Eigen::VectorXd>(y.data(), dy_.size()) - y_ref_;
  law_.base.begin(k, u_);
  u_.noalias() -= law_.gain * dy_;
  law_.base.limit(u_);
  std::copy(u_.begin(), u_.end(), u.begin());
}

}  // namespace faultline
