#pragma once

#include <vector>

#include <Eigen/Core>

namespace faultline {

/// How white process noise w (covariance Q) and output noise v (R) show in an innovation
///
///   x̃_k+1 = F x̃_k + w_k - L v_k,   e_k = C x̃_k + v_k
///
/// F n×n stable, L n×q, C q×n, R q×q.
struct InnovationModel {
  Eigen::MatrixXd F, L, C, R;
};

/// The cross spectrum of a record of innovations, averaged over windowed segments (Welch), and the
/// directions E of unknown inputs that make it most likely. With z = e^jω, w = E d, d of unknown
/// spectrum s(ω) >= 0 (one number per band of frequencies), the same for all its entries,
///
///   Σ(ω) = s G E Eᵀ Gᴴ + V R Vᴴ,   G = C (z I - F)⁻¹,   V = I - G L
///   log-likelihood = -windows/2 · Σ_ω log det Σ + tr(Σ⁻¹ S(ω))           (Whittle)
class InnovationSpectrum {
 public:
  /// @param segments innovations, q×samples each; those shorter than a window are left out
  InnovationSpectrum(const InnovationModel& model, const std::vector<Eigen::MatrixXd>& segments);

  /// Windows that were averaged, overlapping ones counted half; 0: the record is too short.
  [[nodiscard]] double windows() const noexcept { return windows_; }

  struct Fit {
    Eigen::MatrixXd E;  ///< n×rank
    Eigen::VectorXd s;  ///< per frequency
    double log_likelihood = 0.0;
    /// Mean spectrum times E Eᵀ: the covariance of w.
    [[nodiscard]] Eigen::MatrixXd covariance() const;
  };
  /// No unknown input.
  [[nodiscard]] Fit without() const;
  /// The most likely fit from E on, E n×rank: the BFGS method for E, with s by
  /// minorisation-maximisation in between. @pre windows() > 0; E has no zero column
  [[nodiscard]] Fit most_likely(const Eigen::MatrixXd& E) const;
  /// Where a column more would raise the likelihood fastest: the eigenvector of the largest
  /// eigenvalue of its second derivative there.
  [[nodiscard]] Eigen::VectorXd steepest(const Fit& fit) const;

 private:
  struct Value {
    double log_likelihood = 0.0;
    Eigen::MatrixXd gradient;  ///< by E
  };
  [[nodiscard]] Value value(const Eigen::MatrixXd& E, const Eigen::VectorXd& s) const;
  void improve_spectrum(Fit& fit) const;
  void improve_directions(Fit& fit) const;

  Eigen::Index n_ = 0;
  double windows_ = 0.0;
  std::vector<Eigen::MatrixXcd> G_, noise_, S_;  ///< per frequency: G, V R Vᴴ, S
};

}  // namespace faultline
