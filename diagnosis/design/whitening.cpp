#include "diagnosis/design/whitening.h"

#include <stdexcept>

#include <Eigen/Eigenvalues>
#include <fmt/format.h>

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;

constexpr int kMostSteps = 200'000;
constexpr double kConverged = 1e-14;
// A variance below this part of the largest is none.
constexpr double kNoVariance = 1e-12;
constexpr double kLargestRadius = 1.0 - 1e-6;

[[noreturn]] void refuse(const ResidualFilter& filter, const std::string& text) {
  throw std::invalid_argument(fmt::format("{}: {}", filter.name, text));
}

// N = D_n D_nᵀ of the noises with a sigma.
MatrixXd noise_covariance(const PlantModel& plant) {
  MatrixXd N = MatrixXd::Zero(plant.q(), plant.q());
  for (const Noise& noise : plant.noises) {
    if (noise.sigma) N += *noise.sigma * *noise.sigma * noise.output * noise.output.transpose();
  }
  return N;
}

}  // namespace

void whiten(const PlantModel& plant, ResidualFilter& filter) {
  const MatrixXd N = noise_covariance(plant);
  const MatrixXd Q = filter.E * N * filter.E.transpose();
  const MatrixXd cross = filter.E * N * filter.H.transpose();
  const MatrixXd direct = filter.H * N * filter.H.transpose();
  MatrixXd P = Q;
  MatrixXd S, gain;
  for (int step = 0; step < kMostSteps; ++step) {
    S = filter.M * P * filter.M.transpose() + direct;
    const Eigen::SelfAdjointEigenSolver<MatrixXd> solver(S);
    const double largest = solver.eigenvalues().maxCoeff();
    if (!(largest > 0.0) || solver.eigenvalues().minCoeff() <= kNoVariance * largest) {
      refuse(
          filter,
          "a sequential test takes Gaussian noise in every row of the residual; expected sigma in "
          "[[noise]] of the plant, for enough outputs");
    }
    gain = (filter.F * P * filter.M.transpose() + cross) *
           (solver.eigenvectors() * solver.eigenvalues().cwiseInverse().asDiagonal() *
            solver.eigenvectors().transpose());
    const MatrixXd next = filter.F * P * filter.F.transpose() + Q - gain * S * gain.transpose();
    const double change = (next - P).norm();
    P = 0.5 * (next + next.transpose());
    if (change <= kConverged * P.norm() || P.size() == 0) break;
  }
  filter.F -= gain * filter.M;
  filter.E -= gain * filter.H;
  filter.G -= gain * filter.K;
  filter.L -= gain * filter.J;
  if (!(spectral_radius(filter.F) < kLargestRadius)) {
    refuse(filter,
           "its residual is a derivative of the noise: no stable filter makes it white; expected "
           "test = \"comparison\"");
  }
  const MatrixXd whitening = Eigen::SelfAdjointEigenSolver<MatrixXd>(S).operatorInverseSqrt();
  for (MatrixXd* matrix : {&filter.M, &filter.H, &filter.K, &filter.J}) {
    *matrix = (whitening * *matrix).eval();
  }
}

}  // namespace faultline
