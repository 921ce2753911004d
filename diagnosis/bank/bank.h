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

/// Where a bank was designed.
enum class DesignDomain {
  kContinuous,  ///< filter designed on (A, B), then discretised: y by first-order hold, u by ZOH
  kSampled,     ///< filter designed on the exactly sampled (A_d, B_d)
};

/// The rank decisions behind a filter: how far they are from flipping. Pivots of orthogonal
/// decompositions in balanced coordinates, relative to the data's scale.
struct RankCertificate {
  std::uint32_t dim_w = 0;       ///< dim W*; disturbances taken as constant are states, too
  std::uint32_t dim_s = 0;       ///< dim S*; likewise
  double smallest_kept = 1.0;    ///< smallest pivot that counted as not zero
  double largest_dropped = 0.0;  ///< largest one that counted as zero
  double tolerance_min = 0.0;    ///< both dimensions are the same for all tolerances from here ..
  double tolerance_max = 0.0;    ///< .. to here, of 1e-12 .. 1e-6
};

/// What was proved of one filter on the sampled-data loop as it runs: the plant sampled exactly,
/// inputs, faults and disturbances held over a sample, the filter in its implementation form.
/// Computed by diagnosis/certify from plant and filter alone. Gains are ‖T(e^jωT)‖₂ of the
/// residual, with the plant's own steady state at that frequency (it need not be stable: no loop
/// changes what the plant's inputs and outputs have to do with each other), over a grid of
/// frequencies: DC, Nyquist, 40 between in logarithmic steps, the resonances of plant and filter.
struct FilterCertificate {
  double spectral_radius = 0.0;    ///< of F
  std::vector<double> input_gain;  ///< per input: largest over frequency, per unit; zero but for
                                   ///< rounding where the bank was designed on the sampled plant
  std::vector<double> disturbance_gain;  ///< per disturbance: largest over frequency, per unit; of
                                         ///< those taken as constant: at DC
  std::vector<double> fault_gain;  ///< per fault: largest over frequency, per fault size; of an
                                   ///< ignored one: what leaks
  std::vector<double> dc_gain;     ///< per fault: at DC, per fault size
  std::vector<double> band_gain;   ///< per fault: smallest from DC to band_Hz, per fault size
  double band_Hz = 0.0;  ///< of the filter's slowest pole: -ln ρ(F) / (2π T), at most 1/(2 T)
  /// Per fault, in the plant's coordinates: ‖b_j - Π_S b_j‖ / ‖b_j‖. With an output part
  /// ‖(Π_⊥ (L_j - A s), D_j - C s)‖ / ‖(L_j, D_j)‖, s the shortest in S* with C s nearest to D_j:
  /// moving along S* makes C s and A s, and no residual sees it.
  std::vector<double> margin;
  /// Per fault, in its unit: the smallest constant one that it fires on; 0: it fires on none. τ by
  /// the DC gain; of faults seen in transients τ by the largest value that the step response holds
  /// for `dwell` samples.
  std::vector<double> smallest_fault;
  /// Per fault: from the onset of twice that, with everything at rest, until it fires (exceeds τ
  /// for the `dwell`-th sample); 0 if it fires on none.
  std::vector<double> delay_s;
  RankCertificate rank;
};

/// One residual generator in its implementation form (inputs y, u), discrete time:
///
///   v_k+1 = F v_k - E y_k + G u_k
///   r_k   = M v_k - H y_k + K u_k
///
/// v: d, y: q, u: m, r: rows. First-order hold of y is already folded in: v = w + E_1 y,
/// where w_k+1 = F w_k - E_0 y_k - E_1 y_k+1 + G u_k and E = E_0 + F E_1.
///
/// To faults, held over a sample, it responds (internal form) as
///
///   e_k+1 = F e_k - L m_k
///   r_k   = M e_k - J m_k
///
/// which is exact in the sampled domain; in the continuous one it is exact at DC, and elsewhere but
/// for the hold of y.
struct ResidualFilter {
  std::string name;                  ///< "r12"
  std::vector<std::size_t> ignores;  ///< indices of the faults it is decoupled from
  std::vector<Sensitivity> sees;     ///< per fault: this residual's row of the structure matrix
  Eigen::MatrixXd F, E, G, M, H, K;
  Eigen::MatrixXd L, J;              ///< d×k, rows×k: per fault, in its unit
  double threshold = 0.0;            ///< τ: it fires when its evaluation is > τ
  std::uint32_t forget_samples = 0;  ///< samples a bad sample contaminates it for
  FilterCertificate certificate;
};

/// A disturbance of the plant, and what the bank makes of it.
struct BankDisturbance {
  enum class Treatment {
    kNone,       ///< it reaches the residuals
    kDecoupled,  ///< no residual sees it, whatever its course
    kConstant,   ///< no residual sees it while it is constant
  };
  std::string name;
  Treatment treatment = Treatment::kNone;
};

/// Faults whose columns of the transfer matrix to the outputs are dependent (and no fewer of them
/// are): with the right courses two ways of splitting them look the same for all time.
struct ConfusableFaults {
  std::vector<std::size_t> faults;
  /// Σ weights·(columns) = 0 if that holds with the same weights at all frequencies (largest is 1);
  /// empty if the weights depend on frequency.
  std::vector<double> weights;
};

/// What plant and bank can tell apart.
struct IsolabilityCertificate {
  bool are_signatures_distinct =
      false;                          ///< generic signatures of all sets of up to p faults differ
  bool is_strongly_isolable = false;  ///< any 2p columns are independent: so do all signals
  /// Smallest dependent sets of up to 2p faults.
  std::vector<ConfusableFaults> confusable;
  bool is_list_complete = true;  ///< false: there are more confusable sets than are listed
};

/// How fired residuals become a verdict.
struct DecisionRule {
  std::uint32_t dwell = 3;    ///< samples a residual must exceed, and stay below, its threshold
  std::uint32_t settle = 3;   ///< samples a signature must stand before its verdict is announced
  std::uint32_t window = 50;  ///< samples from which the size of an isolated fault is estimated
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
  DesignDomain domain = DesignDomain::kContinuous;
  double sample_time_s = 0.0;
  std::size_t concurrent = 1;  ///< p: faults at one time that it can isolate
  std::vector<std::string> input_names, output_names, fault_names;
  std::vector<double> fault_sizes;
  std::vector<BankDisturbance> disturbances;  ///< of the plant, in its order
  Eigen::VectorXd u_operating, y_operating;   ///< subtracted from the samples before the filters
  std::vector<ResidualFilter> filters;
  DecisionRule decision;
  IsolabilityCertificate isolability;

  /// Rows of all filters' residuals, stacked in order.
  [[nodiscard]] Eigen::Index residual_rows() const;
};

}  // namespace faultline
