#include "diagnosis/design/uio/component_threshold.h"

#include <Eigen/LU>

#include "diagnosis/bank/bank.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// What is left of the first term when the sums are cut, and the most terms there may be.
constexpr double kNegligible = 1e-14;
constexpr int kMostTerms = 200'000;

}  // namespace

std::optional<VectorXd> component_threshold(const ObserverModel& model,
                                            const DecouplingMatrices& decoupling,
                                            const ObserverOutput& output, const MatrixXd& gain,
                                            Index carried) {
  const ErrorDynamics error = error_dynamics(model, decoupling, gain);
  if (!(spectral_radius(error.N) < 1.0)) return std::nullopt;
  VectorXd bound = model.w_bound;
  bound.tail(carried).setZero();
  const Index rows = output.R.rows();
  const Index terms = model.E_i.rows();
  MatrixXd R(rows + terms, model.n());
  R << output.R, model.E_i;
  MatrixXd Q = MatrixXd::Zero(rows + terms, output.Q.cols());
  Q.topRows(rows) = output.Q;
  const MatrixXd S_E = decoupling.S * model.E_o * model.slope_radius.asDiagonal();

  VectorXd b = (Q + R * error.B_next).cwiseAbs() * bound;
  MatrixXd g = MatrixXd::Zero(rows + terms, terms);
  MatrixXd power = R;  // R' N^(j-1)
  const double scale = R.norm();
  for (int j = 1; j < kMostTerms && power.norm() > kNegligible * scale; ++j) {
    const MatrixXd next = power * error.N;
    b += (power * error.B_now + next * error.B_next).cwiseAbs() * bound;
    g += (power * S_E).cwiseAbs();
    power = next;
  }
  if (terms == 0) return b;
  const MatrixXd g_q = g.bottomRows(terms);
  if (!(spectral_radius(g_q) < 1.0)) return std::nullopt;
  const VectorXd q = (MatrixXd::Identity(terms, terms) - g_q).partialPivLu().solve(b.tail(terms));
  return b.head(rows) + g.topRows(rows) * q;
}

}  // namespace faultline
