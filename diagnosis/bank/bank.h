#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <Eigen/Core>

namespace faultline {

/// How a residual sees a fault: one cell of the structure matrix.
enum class Sensitivity {
  kNone,       ///< decoupled: the fault never reaches the residual
  kTransient,  ///< seen, but with zero DC gain: a constant fault fades from it
  kSteady,     ///< seen at DC
};

/// What was proved of one filter as implemented, i.e. after discretisation. All relative.
struct FilterCertificate {
  double spectral_radius = 0.0;    ///< of F
  double residual_MP_HC = 0.0;     ///< ‖M P - H C‖ / ‖H C‖
  double residual_FP_PA_EC = 0.0;  ///< ‖F P - P A - E C‖ / ‖P A‖, design domain
  double leakage_decoupled = 0.0;  ///< largest ‖P b_j‖/‖b_j‖ of an ignored fault
  std::vector<double> dc_gain;  ///< per fault: gain of the residual's norm at z = 1, per fault size
  std::vector<double> margin;   ///< per fault: ‖b_j - Π_S b_j‖ / ‖b_j‖
};

/// One residual generator in its implementation form (inputs y, u), discrete time:
///
///   v_k+1 = F v_k - E y_k + G u_k
///   r_k   = M v_k - H y_k + K u_k
///
/// v: d, y: q, u: m, r: rows. First-order hold of y is already folded in: v = w + E_1 y,
/// where w_k+1 = F w_k - E_0 y_k - E_1 y_k+1 + G u_k and E = E_0 + F E_1.
struct ResidualFilter {
  std::string name;                  ///< "r12"
  std::vector<std::size_t> ignores;  ///< indices of the faults it is decoupled from
  std::vector<Sensitivity> sees;     ///< per fault: this residual's row of the structure matrix
  Eigen::MatrixXd F, E, G, M, H, K;
  double threshold = 0.0;            ///< τ: it fires when its evaluation is > τ
  std::uint32_t forget_samples = 0;  ///< samples a bad sample contaminates it for
  FilterCertificate certificate;
};

/// How fired residuals become a verdict.
struct DecisionRule {
  std::uint32_t dwell = 3;   ///< samples a residual must exceed, and stay below, its threshold
  std::uint32_t settle = 3;  ///< samples a signature must stand before its verdict is announced
};

/// Largest decision table a bank may need, in 64-bit words: fault sets of up to p faults times
/// words of a signature. 16 Mi words are 128 MiB, a second of start-up; it bounds hostile files.
inline constexpr std::size_t kMaxDecisionWords = std::size_t{1} << 24;

/// Σ_{i=0..p} C(k, i): how many sets of up to p of k faults there are; saturates at the largest
/// value.
[[nodiscard]] std::size_t fault_set_count(std::size_t fault_count, std::size_t concurrent) noexcept;

/// max |λ(F)|; 0 for an empty F. F d×d, finite.
[[nodiscard]] double spectral_radius(const Eigen::MatrixXd& F);

/// σ(F) of a square F, in no order. Here, and not where it is used, because each use of Eigen's
/// eigenvalue solver costs its file ten seconds of compilation.
[[nodiscard]] Eigen::VectorXcd eigenvalues(const Eigen::MatrixXd& F);

/// A residual bank: all that the run time needs to know about a plant. Indices refer to the name
/// lists here.
struct Bank {
  std::string name;
  std::string method;  ///< "geometric", ...
  std::string plant_name;
  std::string plant_digest;    ///< plant_digest() of the plant it was designed for
  std::string request_digest;  ///< of the bank.toml it was designed from
  double sample_time_s = 0.0;
  std::size_t concurrent = 1;  ///< p: faults at one time that it can isolate
  std::vector<std::string> input_names, output_names, fault_names;
  std::vector<double> fault_sizes;
  Eigen::VectorXd u_operating, y_operating;  ///< subtracted from the samples before the filters
  std::vector<ResidualFilter> filters;
  DecisionRule decision;

  /// Rows of all filters' residuals, stacked in order.
  [[nodiscard]] Eigen::Index residual_rows() const;
};

}  // namespace faultline
