#pragma once

#include <complex>
#include <vector>

#include <Eigen/Core>

#include "diagnosis/design/eigenstructure/compromise.h"

namespace faultline {

/// Frequency responses of a compromise's task for one D_1, on a grid that holds the filter's own
/// rates, two decades around them and DC.
///
///   T_d(λ) = M (λ I - F)⁻¹ (b_d + D_1 h_d) + h_d,   F = A_0 + D_1 M;   T_j likewise
class UnknownInputResponse {
 public:
  /// @pre A_0 + D_1 M is stable
  UnknownInputResponse(const CompromiseTask& task, const Eigen::MatrixXd& D_1);

  /// T_d(λ), q×l.
  [[nodiscard]] Eigen::MatrixXcd at(std::complex<double> lambda) const;
  [[nodiscard]] const std::vector<Eigen::MatrixXcd>& on_grid() const { return on_grid_; }

  /// T_j(λ_j) per wanted fault, q×k: λ_j is DC, or where ‖T_j‖ is largest if it is zero at DC.
  [[nodiscard]] const Eigen::MatrixXcd& wanted() const { return wanted_; }

  struct Peak {
    double gain = 0.0;
    std::complex<double> lambda;
  };
  /// Largest singular value of Θ T_d over frequency: the grid's, refined by golden sections around
  /// its three largest maxima.
  [[nodiscard]] Peak peak(const Eigen::MatrixXd& Theta) const;

  /// Stationary covariance of T_d driven by white noise of intensity one (per second, per sample):
  ///
  ///   X = M Y Mᵀ + h hᵀ,  Y = F Y Fᵀ + b bᵀ  (sampled);   0 = F Y + Y Fᵀ + b bᵀ  (continuous)
  ///
  /// q×q. Not finite in continuous time if h_d is not zero.
  [[nodiscard]] Eigen::MatrixXd covariance() const;

 private:
  [[nodiscard]] std::complex<double> lambda_of(double rate) const;
  void find_wanted(const CompromiseTask& task, const Eigen::MatrixXd& D_1);

  bool is_sampled_;
  Eigen::MatrixXd F_, M_, b_, h_;
  std::vector<double> rates_;  ///< rad/s, or rad per sample
  std::vector<Eigen::MatrixXcd> on_grid_;
  Eigen::MatrixXcd wanted_;
};

}  // namespace faultline
