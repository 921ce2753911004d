#include "sim/pid.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "drivers/signal/cycle_counter.h"

namespace faultline {
namespace {

/// Weights of D_k = decay D_k-1 - gain (y_k - y_k-1): backward difference over `elapsed_s`.
struct DerivativeWeights {
  double decay = 0.0, gain = 0.0;
};
DerivativeWeights derivative_weights(const PidLoop& loop, double elapsed_s) noexcept {
  if (!loop.T_d_s) return {};
  const double sum_s = *loop.T_d_s + loop.N * elapsed_s;
  return {*loop.T_d_s / sum_s, loop.K_p * *loop.T_d_s * loop.N / sum_s};
}

double tracking_time_s(const PidLoop& loop) noexcept {
  if (loop.T_t_s) return *loop.T_t_s;
  return loop.T_d_s ? std::sqrt(*loop.T_i_s * *loop.T_d_s) : *loop.T_i_s;
}

}  // namespace

LinearController linear_form(const PidLaw& law) {
  const auto p = static_cast<Eigen::Index>(3 * law.loops.size());
  const Eigen::Index m = law.base.feedforward.size(), q = law.reference.start().size();
  LinearController form{Eigen::MatrixXd::Zero(p, p), Eigen::MatrixXd::Zero(p, q),
                        Eigen::MatrixXd::Zero(m, p), Eigen::MatrixXd::Zero(m, q)};
  for (std::size_t i = 0; i < law.loops.size(); ++i) {
    const PidLoop& loop = law.loops[i];
    const auto at = static_cast<Eigen::Index>(3 * i);
    const DerivativeWeights weights = derivative_weights(loop, law.sample_time_s);
    if (loop.T_i_s) {
      form.F(at, at) = 1.0;
      form.F(at, at + 2) = -loop.K_p * law.sample_time_s / *loop.T_i_s;
    }
    form.F(at + 1, at + 1) = weights.decay;
    form.F(at + 1, at + 2) = weights.gain;
    form.G(at + 1, loop.output) = -weights.gain;
    form.G(at + 2, loop.output) = 1.0;
    form.H.row(loop.input) += form.F.row(at) + form.F.row(at + 1);
    form.J(loop.input, loop.output) += -loop.K_p - weights.gain;
  }
  return form;
}

Pid::Pid(PidLaw law)
    : law_(std::move(law)),
      memories_(law_.loops.size()),
      u_(law_.base.feedforward.size()),
      u_asked_(u_.size()),
      y_ref_(law_.reference.start().size()) {}

void Pid::begin(const PidLoop& loop, Memory& memory, double y, double e) const noexcept {
  memory = {.integral = loop.T_i_s ? -loop.K_p * e : 0.0, .y = y, .e = e};
}

void Pid::advance(const PidLoop& loop, Memory& memory, double y, double elapsed_s) noexcept {
  const DerivativeWeights weights = derivative_weights(loop, elapsed_s);
  memory.derivative = weights.decay * memory.derivative - weights.gain * (y - memory.y);
  if (!loop.T_i_s) return;
  const double growth = loop.K_p * elapsed_s / *loop.T_i_s * memory.e;
  if (loop.anti_windup == AntiWindup::kClamping) {
    if (growth * memory.excess <= 0.0) memory.integral += growth;
    return;
  }
  // Leading back further than to the limit would overshoot it.
  const double share = std::min(elapsed_s / tracking_time_s(loop), 1.0);
  memory.integral += growth - share * memory.excess;
}

void Pid::command(std::uint32_t k, std::span<const double> y, std::span<double> u) noexcept {
  const std::int32_t ahead = has_begun_ ? cycles_ahead(k, k_) : 0;
  if (!has_begun_ || ahead != 0) {
    const bool is_anew = !has_begun_ || ahead < 0 || ahead > kMaxMissingCycles;
    law_.reference.at(k, y_ref_);
    law_.base.begin(k, u_asked_);
    for (std::size_t i = 0; i < law_.loops.size(); ++i) {
      const PidLoop& loop = law_.loops[i];
      Memory& memory = memories_[i];
      const double y_i = y[static_cast<std::size_t>(loop.output)];
      const double e = y_ref_[loop.output] - y_i;
      if (is_anew) {
        begin(loop, memory, y_i, e);
      } else {
        advance(loop, memory, y_i, ahead * law_.sample_time_s);
      }
      memory.y = y_i;
      memory.e = e;
      u_asked_[loop.input] += loop.K_p * e + memory.integral + memory.derivative;
    }
    u_ = u_asked_;
    law_.base.limit(u_);
    for (std::size_t i = 0; i < law_.loops.size(); ++i) {
      const Eigen::Index input = law_.loops[i].input;
      memories_[i].excess = u_asked_[input] - u_[input];
    }
    k_ = k;
    has_begun_ = true;
  }
  std::copy(u_.begin(), u_.end(), u.begin());
}

}  // namespace faultline
