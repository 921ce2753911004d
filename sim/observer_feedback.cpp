#include "sim/observer_feedback.h"

#include <algorithm>
#include <utility>

#include "drivers/signal/cycle_counter.h"

namespace faultline {

LinearController linear_form(const ObserverLaw& law) {
  const Eigen::MatrixXd A_L = law.plant.A - law.L * law.plant.C;
  const Eigen::MatrixXd B_L = law.plant.B - law.L * law.plant.D;
  const Eigen::Index n = A_L.rows(), m = B_L.cols();
  LinearController form;
  form.H.resize(m, n + m);
  form.H << -law.K * A_L, -law.K * B_L;
  form.J = -law.K * law.L;
  form.F.resize(n + m, n + m);
  form.F << A_L, B_L, form.H;
  form.G.resize(n + m, law.L.cols());
  form.G << law.L, form.J;
  return form;
}

ObserverFeedback::ObserverFeedback(ObserverLaw law)
    : law_(std::move(law)),
      C_inverse_(pseudo_inverse(law_.plant.C)),
      x_(Eigen::VectorXd::Zero(law_.plant.A.rows())),
      x_next_(x_.size()),
      u_(Eigen::VectorXd::Zero(law_.plant.B.cols())),
      du_(-law_.u_operating),
      dy_(law_.plant.C.rows()),
      innovation_(dy_.size()),
      y_ref_(dy_.size()),
      dx_(x_.size()) {}

void ObserverFeedback::begin() noexcept {
  innovation_ = dy_;
  innovation_.noalias() -= law_.plant.D * du_;
  x_.noalias() = C_inverse_ * innovation_;
}

void ObserverFeedback::predict() noexcept {
  x_next_.noalias() = law_.plant.A * x_;
  x_next_.noalias() += law_.plant.B * du_;
}

void ObserverFeedback::choose_command(std::uint32_t k) noexcept {
  law_.reference.at(k, y_ref_);
  y_ref_ -= law_.y_operating;
  dx_ = x_;
  dx_.noalias() -= law_.target.N_x * y_ref_;
  law_.base.begin(k, u_);
  u_.noalias() += law_.target.N_u * y_ref_;
  u_.noalias() -= law_.K * dx_;
  law_.base.limit(u_);
  du_ = u_ - law_.u_operating;
}

void ObserverFeedback::command(std::uint32_t k, std::span<const double> y,
                               std::span<double> u) noexcept {
  const std::int32_t ahead = has_begun_ ? cycles_ahead(k, k_) : 0;
  const bool is_repeated = has_begun_ && ahead == 0;
  if (!is_repeated) {
    dy_ = Eigen::Map<const Eigen::VectorXd>(y.data(), dy_.size()) - law_.y_operating;
    if (ahead < 0) du_ = -law_.u_operating;
    if (!has_begun_ || ahead < 0 || ahead > kMaxMissingCycles) begin();
    for (std::int32_t i = 1; i < ahead && ahead <= kMaxMissingCycles; ++i) {
      predict();
      x_.swap(x_next_);
    }
    innovation_ = dy_;
    innovation_.noalias() -= law_.plant.C * x_;
    innovation_.noalias() -= law_.plant.D * du_;
    predict();
    x_next_.noalias() += law_.L * innovation_;
    x_.swap(x_next_);
    choose_command(k);
    k_ = k;
    has_begun_ = true;
  }
  std::copy(u_.begin(), u_.end(), u.begin());
}

}  // namespace faultline
