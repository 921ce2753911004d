#include "sim/command_base.h"

#include <cmath>
#include <limits>
#include <utility>

namespace faultline {

CommandBase::CommandBase(Eigen::VectorXd start)
    : feedforward(std::move(start)),
      amplitude(Eigen::VectorXd::Zero(feedforward.size())),
      omega_rad(Eigen::VectorXd::Zero(feedforward.size())),
      lower(
          Eigen::VectorXd::Constant(feedforward.size(), -std::numeric_limits<double>::infinity())),
      upper(-lower) {}

void CommandBase::begin(std::uint32_t k, Eigen::VectorXd& u) const noexcept {
  u = feedforward;
  for (Eigen::Index i = 0; i < u.size(); ++i) u[i] += amplitude[i] * std::sin(omega_rad[i] * k);
}

void CommandBase::limit(Eigen::VectorXd& u) const noexcept {
  u = u.cwiseMax(lower).cwiseMin(upper);
}

}  // namespace faultline
