#pragma once

#include <cstddef>
#include <functional>
#include <optional>
#include <vector>

#include <Eigen/Core>

#include "diagnosis/certify/observer_loop.h"

namespace faultline {

/// Componentwise bounds of the residual of an observer, for any courses of w and of the slopes
/// within their bounds (l1 norms of impulse responses, small gain). With R' = [R; E_i], Q' = [Q; 0]
///
///   h_0 = Q' + R' B_next,   h_j = R' N^(j-1) B_now + R' N^j B_next     (one course per entry of w:
///   G_j = |R' N^(j-1) S_E| diag(radius)                   its responses add up before | | is
///   taken)
///
/// the rows of R' e + Q' w stay within
///
///   b_0 = |R'| ē + |Q'| w̄
///   b_k = |R' N^k| ē + (Σ_{j<k} |h_j| + |R' N^(k-1) B_now|) w̄ + Σ_{j=1..k} G_j q_k-j
///
/// where q are the rows of E_i in b: a Lipschitz term is at most its radius times them. In the
/// limit b = Σ_j |h_j| w̄ + Σ_j G_j q, which has a solution if ρ(Σ_j (rows E_i of G_j)) < 1.
///
/// Without Lipschitz terms the limit is attained; with them the bound is that of the small gain.
class ErrorBounds {
 public:
  /// `loop` must outlive the bounds.
  /// @throws std::invalid_argument N is not stable, or forgets too slowly; ρ >= 1.
  explicit ErrorBounds(const ObserverLoop& loop);

  /// Of the residual in the long run; rows.
  [[nodiscard]] const Eigen::VectorXd& limit() const { return limit_; }

  /// Of the residual sample by sample, from |e_0| <= e_bound of the loop; samples×rows.
  [[nodiscard]] Eigen::MatrixXd course(std::size_t samples) const;

  /// An error at sample 0: |directions·m|, |m_i| <= size_i.
  struct Start {
    Eigen::MatrixXd directions;  ///< n×c
    Eigen::VectorXd size;        ///< c
  };

  /// What a start alone (w = 0) makes of |R e|, sample by sample; samples×rows.
  [[nodiscard]] Eigen::MatrixXd fading(const Start& start, std::size_t samples) const;

  /// A norm of bounds, positively homogeneous: how much of the threshold they make up.
  using Measure = std::function<double(const Eigen::VectorXd&)>;

  /// The first sample from which on, for ever, the measure of fading() is at most `part` > 0.
  /// Nothing if that is not within `most` samples.
  [[nodiscard]] std::optional<std::size_t> faded_after(const Start& start, const Measure& measure,
                                                       double part, std::size_t most) const;

 private:
  // Closes the loop of the Lipschitz terms, sample by sample.
  class Recursion;

  // Bounds that fall like σ^-k: Σ_k |R' (σN)^k| and Σ_k |R' (σN)^k σS_E|.
  struct Decay {
    double sigma = 1.0;
    Eigen::MatrixXd first, gains;
  };
  void find_decays(double radius);
  [[nodiscard]] std::optional<std::size_t> horizon(const Start& start, const Measure& measure,
                                                   double part) const;
  [[nodiscard]] std::optional<Eigen::VectorXd> close(const Eigen::VectorXd& direct,
                                                     const Eigen::MatrixXd& gains) const;

  const ObserverLoop& loop_;
  Eigen::MatrixXd rows_, Q_;  // R', Q'
  Eigen::MatrixXd G_;         // [G_1 G_2 ..]; what is left out is below rounding
  Eigen::VectorXd limit_;
  std::vector<Decay> decays_;
};

}  // namespace faultline
