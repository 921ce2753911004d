#include "sim/rk4_stepper.h"

#include <algorithm>
#include <utility>
#include <vector>

#include <boost/numeric/odeint/stepper/runge_kutta4.hpp>

namespace faultline {

struct Rk4Stepper::Workspace {
  using State = std::vector<double>;

  PlantDynamics dynamics;
  double step_s;
  int substeps;
  State x;
  Eigen::VectorXd phi;
  boost::numeric::odeint::runge_kutta4<State> method{};
};

Rk4Stepper::Rk4Stepper(PlantDynamics dynamics, double sample_time_s, int substeps) {
  const auto n = static_cast<std::size_t>(dynamics.A.rows());
  Eigen::VectorXd phi(dynamics.E_i.rows());
  workspace_ =
      std::make_unique<Workspace>(Workspace{.dynamics = std::move(dynamics),
                                            .step_s = sample_time_s / static_cast<double>(substeps),
                                            .substeps = substeps,
                                            .x = Workspace::State(n),
                                            .phi = std::move(phi)});
  workspace_->method.adjust_size(workspace_->x);
  // Odeint sizes its memory once more in its first step: that must not be one of a run's.
  Eigen::VectorXd rest = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(n));
  step(rest, rest);
}

Rk4Stepper::Rk4Stepper(Rk4Stepper&&) noexcept = default;
Rk4Stepper& Rk4Stepper::operator=(Rk4Stepper&&) noexcept = default;
Rk4Stepper::~Rk4Stepper() = default;

void Rk4Stepper::step(const Eigen::VectorXd& g, Eigen::VectorXd& x) noexcept {
  Workspace& work = *workspace_;
  using State = Workspace::State;
  const auto slope = [&work, &g](const State& at, State& out, double /*t_s*/) {
    const Eigen::Map<const Eigen::VectorXd> state(at.data(), g.size());
    Eigen::Map<Eigen::VectorXd> derivative(out.data(), g.size());
    derivative = g;
    derivative.noalias() += work.dynamics.A * state;
    work.dynamics.evaluate_nonlinearities(state, work.phi);
    derivative.noalias() += work.dynamics.Phi * work.phi;
  };
  std::copy(x.begin(), x.end(), work.x.begin());
  for (int i = 0; i < work.substeps; ++i) work.method.do_step(slope, work.x, 0.0, work.step_s);
  std::copy(work.x.begin(), work.x.end(), x.begin());
}

}  // namespace faultline
