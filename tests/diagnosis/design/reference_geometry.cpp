#include "tests/diagnosis/design/reference_geometry.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include <Eigen/LU>
#include <Eigen/QR>
#include <Eigen/SVD>

namespace faultline::reference {
namespace {

using Eigen::Index;
using Eigen::MatrixXcd;
using Eigen::MatrixXd;

constexpr double kZero = 1e-9;
// Transfer matrices come from solving with a pencil: they are less accurate.
constexpr double kZeroOfTransfer = 1e-8;

MatrixXd with_unit_columns(const MatrixXd& X) {
  MatrixXd unit = X;
  for (Index j = 0; j < X.cols(); ++j) {
    if (const double norm = X.col(j).norm(); norm > 0.0) {
      unit.col(j) /= norm;
    }
  }
  return unit;
}

Index count_above(const Eigen::VectorXd& values, double limit) {
  return (values.array() > limit).count();
}

MatrixXd side_by_side(const MatrixXd& X, const MatrixXd& Y) {
  MatrixXd both(X.rows(), X.cols() + Y.cols());
  both << X, Y;
  return both;
}

MatrixXd stacked(const MatrixXd& X, const MatrixXd& Y) {
  MatrixXd both(X.rows() + Y.rows(), X.cols());
  both << X, Y;
  return both;
}

// Orthonormal basis of Im X for an X of about size one.
MatrixXd span(const MatrixXd& X) {
  if (X.size() == 0) {
    return MatrixXd(X.rows(), 0);
  }
  const Eigen::JacobiSVD<MatrixXd> svd(X, Eigen::ComputeThinU);
  return svd.matrixU().leftCols(count_above(svd.singularValues(), kZero));
}

MatrixXd complement(const MatrixXd& X) { return kernel(X.transpose()); }

MatrixXd intersection(const MatrixXd& U, const MatrixXd& V) {
  return kernel(stacked(complement(U).transpose(), complement(V).transpose()));
}

// From u = 0, y to the residual: -(M (zI - F)⁻¹ E + H).
MatrixXcd output_path(const ResidualFilter& filter, std::complex<double> z) {
  const Index d = filter.F.rows();
  MatrixXcd path = filter.H.cast<std::complex<double>>();
  if (d > 0) {
    const MatrixXcd pencil = z * MatrixXcd::Identity(d, d) - filter.F;
    path += filter.M * pencil.partialPivLu().solve(filter.E.cast<std::complex<double>>());
  }
  return -path;
}

MatrixXcd input_path(const ResidualFilter& filter, std::complex<double> z) {
  const Index d = filter.F.rows();
  MatrixXcd path = filter.K.cast<std::complex<double>>();
  if (d > 0) {
    const MatrixXcd pencil = z * MatrixXcd::Identity(d, d) - filter.F;
    path += filter.M * pencil.partialPivLu().solve(filter.G.cast<std::complex<double>>());
  }
  return path;
}

}  // namespace

MatrixXd image(const MatrixXd& X) { return span(with_unit_columns(X)); }

MatrixXd kernel(const MatrixXd& X) {
  if (X.size() == 0) {
    return MatrixXd::Identity(X.cols(), X.cols());
  }
  const Eigen::JacobiSVD<MatrixXd> svd(X, Eigen::ComputeFullV);
  return svd.matrixV().rightCols(X.cols() - count_above(svd.singularValues(), kZero));
}

double outside(const MatrixXd& basis, const MatrixXd& X, double scale) {
  return X.size() == 0 ? 0.0
                       : (X - basis * (basis.transpose() * X)).colwise().norm().maxCoeff() / scale;
}

double distance(const MatrixXd& U, const MatrixXd& V) {
  return (U * U.transpose() - V * V.transpose()).norm();
}

DualSubspaces dual_unobservability_subspaces(const MatrixXd& A, const MatrixXd& C,
                                             const MatrixXd& L) {
  const MatrixXd At = A.transpose();
  const MatrixXd Ct = C.transpose() / std::max(C.norm(), 1e-300);
  const MatrixXd Lt = image(L).transpose();
  MatrixXd V = kernel(Lt);
  for (;;) {
    const MatrixXd reachable = span(side_by_side(V, Ct));
    const MatrixXd leaves = complement(reachable).transpose() * At / std::max(A.norm(), 1e-300);
    MatrixXd next = kernel(stacked(Lt, leaves));
    if (next.cols() == V.cols()) {
      break;
    }
    V = std::move(next);
  }
  DualSubspaces result;
  result.W = complement(V);
  // Aᵀ V = V X + Cᵀ U: K = -U Vᵀ keeps V.
  Eigen::CompleteOrthogonalDecomposition<MatrixXd> equations;
  equations.setThreshold(kZero);
  equations.compute(side_by_side(V, Ct));
  const MatrixXd solution = equations.solve(At * V);
  const MatrixXd closed = At - Ct * solution.bottomRows(Ct.cols()) * V.transpose();
  const MatrixXd entry = intersection(V, span(Ct));
  MatrixXd R = entry;
  for (;;) {
    MatrixXd next = span(side_by_side(R, closed * R / std::max(1.0, closed.norm())));
    if (next.cols() == R.cols()) {
      break;
    }
    R = std::move(next);
  }
  result.S = complement(R);
  return result;
}

MatrixXd unobservable_subspace(const MatrixXd& H, const MatrixXd& A, double scale) {
  MatrixXd seen = complement(kernel(stacked(H / scale, MatrixXd::Zero(1, A.cols()))));
  for (;;) {
    MatrixXd next = span(side_by_side(seen, A.transpose() * seen / std::max(1.0, A.norm())));
    if (next.cols() == seen.cols()) {
      return complement(seen);
    }
    seen = std::move(next);
  }
}

Transfer transfer(const PlantModel& plant, const Directions& directions,
                  std::complex<double> lambda) {
  const MatrixXcd pencil = lambda * MatrixXcd::Identity(plant.n(), plant.n()) - plant.A;
  const MatrixXcd X = pencil.partialPivLu().solve(directions.state.cast<std::complex<double>>());
  return {plant.C * X + directions.output, plant.C.norm() * X.colwise().norm().transpose() +
                                               directions.output.colwise().norm().transpose()};
}

Index rank(const Transfer& transfer) {
  if (transfer.T.size() == 0) {
    return 0;
  }
  MatrixXcd scaled = transfer.T;
  for (Index j = 0; j < scaled.cols(); ++j) {
    if (transfer.size[j] > 0.0) {
      scaled.col(j) /= transfer.size[j];
    }
  }
  const Eigen::JacobiSVD<MatrixXcd> svd(scaled);
  return count_above(svd.singularValues(), kZeroOfTransfer);
}

Directions fault_directions(const PlantModel& plant, const std::vector<std::size_t>& faults) {
  Directions directions{MatrixXd(plant.n(), std::ssize(faults)),
                        MatrixXd(plant.q(), std::ssize(faults))};
  for (Index i = 0; i < std::ssize(faults); ++i) {
    const Fault& fault = plant.faults[faults[static_cast<std::size_t>(i)]];
    directions.state.col(i) = fault.state;
    directions.output.col(i) = fault.output;
  }
  return directions;
}

Directions disturbance_directions(const PlantModel& plant) {
  const Index count = std::ssize(plant.disturbances);
  Directions directions{MatrixXd(plant.n(), count), MatrixXd(plant.q(), count)};
  for (Index i = 0; i < count; ++i) {
    directions.state.col(i) = plant.disturbances[static_cast<std::size_t>(i)].state;
    directions.output.col(i) = plant.disturbances[static_cast<std::size_t>(i)].output;
  }
  return directions;
}

Directions side_by_side(const Directions& X, const Directions& Y) {
  return {side_by_side(X.state, Y.state), side_by_side(X.output, Y.output)};
}

std::vector<std::size_t> all_faults(const PlantModel& plant) {
  std::vector<std::size_t> faults(plant.faults.size());
  std::iota(faults.begin(), faults.end(), std::size_t{0});
  return faults;
}

Leak leak_of_inputs(const PlantModel& sampled_plant, const ResidualFilter& filter,
                    std::complex<double> z) {
  const Transfer y_of_u = transfer(sampled_plant, {sampled_plant.B, sampled_plant.D}, z);
  const MatrixXcd of_y = output_path(filter, z);
  const MatrixXcd of_u = input_path(filter, z);
  return {(of_y * y_of_u.T + of_u).norm(), of_y.norm() * y_of_u.size.norm() + of_u.norm()};
}

Leak leak_of(const PlantModel& sampled_plant, const ResidualFilter& filter,
             const Directions& directions, std::complex<double> z) {
  const Transfer y_of_m = transfer(sampled_plant, directions, z);
  const MatrixXcd of_y = output_path(filter, z);
  return {(of_y * y_of_m.T).norm(), of_y.norm() * y_of_m.size.norm()};
}

PlantModel sampled(const PlantModel& plant, double sample_time_s) {
  const Directions inputs = side_by_side(
      {plant.B, plant.D},
      side_by_side(fault_directions(plant, all_faults(plant)), disturbance_directions(plant)));
  const Index n = plant.n();
  const Index total = n + inputs.state.cols();
  MatrixXd generator = MatrixXd::Zero(total, total);
  generator.topLeftCorner(n, n) = plant.A * sample_time_s;
  generator.topRightCorner(n, total - n) = inputs.state * sample_time_s;
  // exp(X) = exp(X / 2^h)^(2^h), the series of a matrix of norm below 1/2 in 20 terms.
  const int halvings = std::max(
      0,
      static_cast<int>(std::ceil(std::log2(std::max(plant.A.norm() * sample_time_s, 1e-9)))) + 1);
  const MatrixXd A_part = generator.topLeftCorner(n, n) * std::ldexp(1.0, -halvings);
  const MatrixXd B_part = generator.topRightCorner(n, total - n) * std::ldexp(1.0, -halvings);
  // I + X + X²/2 + .. and the same with one power of A less for B, by Horner.
  MatrixXd A_d = MatrixXd::Identity(n, n);
  MatrixXd integral = MatrixXd::Identity(n, n);
  for (int i = 20; i >= 1; --i) {
    A_d = (MatrixXd::Identity(n, n) + A_part * A_d / i).eval();
    integral = (MatrixXd::Identity(n, n) + A_part * integral / (i + 1)).eval();
  }
  MatrixXd B_d = integral * B_part;
  for (int i = 0; i < halvings; ++i) {
    B_d = (B_d + A_d * B_d).eval();
    A_d = (A_d * A_d).eval();
  }
  PlantModel result = plant;
  result.time = TimeDomain::kDiscrete;
  result.sample_time_s = sample_time_s;
  result.A = A_d;
  result.B = B_d.leftCols(plant.m());
  Index next = plant.m();
  for (Fault& fault : result.faults) {
    fault.state = B_d.col(next++);
  }
  for (Disturbance& disturbance : result.disturbances) {
    disturbance.state = B_d.col(next++);
  }
  return result;
}

}  // namespace faultline::reference
