#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <Eigen/Core>

#include "diagnosis/model/nonlinearity.h"

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
  kEuler,       ///< filter designed on (I + A T, B T): for plants that are stepped like that
};

/// True for the domains in which the design is done on difference equations.
[[nodiscard]] constexpr bool is_sampled(DesignDomain domain) noexcept {
  return domain != DesignDomain::kContinuous;
}

/// "continuous", "sampled", "euler": as in bank files.
[[nodiscard]] std::string_view domain_name(DesignDomain domain) noexcept;

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

/// A Lipschitz term of an observer: adds W (φ(s_k) - c s_k), s_k = a_v v_k + a_y y_k + a_u u_k, to
/// v_k+1.
struct FilterNonlinearity {
  NonlinearFunction function;  ///< φ
  double center = 0.0;         ///< c: the middle of the slopes of φ, which F has in it
  double radius = 0.0;         ///< |slope - c| at most
  Eigen::VectorXd W;           ///< d; the gain is in it
  Eigen::VectorXd a_v;         ///< d (a row of the equation)
  Eigen::VectorXd a_y;         ///< q (likewise)
  Eigen::VectorXd a_u;         ///< m (likewise)
};

/// How a residual is evaluated, and against what.
enum class Evaluation {
  kNorm,       ///< ‖Ω r‖₂ against J(k), or against a constant τ
  kComponent,  ///< max_i |r_i| / r̄_i(k) against 1
};

/// Thresholds that hold from the first sample after start-up or a reset on, whatever the state of
/// the plant is then (within the ranges of its file). Row, or entry, k is that of sample k; the
/// last one holds for all later ones.
struct ThresholdCourse {
  Eigen::MatrixXd weight;     ///< Ω, rows×rows
  Eigen::VectorXd norm;       ///< J(k): the quadratic threshold; > 0, at least one
  Eigen::MatrixXd component;  ///< r̄(k), samples×rows: the componentwise one; > 0, as many
};

/// Where the thresholds of a bank come from, and what certified ones reckon with beyond the plant
/// file.
struct ThresholdBasis {
  enum class Kind {
    kGiven,       ///< a number in bank.toml; of method "uio": from the plant's bounds
    kCertified,   ///< proved by diagnosis/certify
    kCalibrated,  ///< from fault-free logs (`faultline calibrate`)
  };
  Kind kind = Kind::kGiven;
  Eigen::VectorXd output_resolution;  ///< q: one LSB of each; the error is half of it
  double jitter_s = 0.0;              ///< a command acts up to this late within its cycle
  /// Of the whole bank, by noise whose sigma is known; 0: every source has a bound.
  double false_alarms_per_h = 0.0;
};

/// What bounds a residual without a fault, row by row: what each kind of source does at its worst.
struct ThresholdShares {
  std::vector<double> disturbance;  ///< [[disturbance]] that is not decoupled
  std::vector<double> noise;        ///< [[noise]] by its bound
  std::vector<double> resolution;   ///< half an LSB of every signal
  std::vector<double> leakage;      ///< inputs and decoupled disturbances, after discretisation
  std::vector<double> jitter;       ///< commands that act late
  std::vector<double> gaussian;     ///< [[noise]] by its sigma, at the false-alarm rate asked for
};

/// How evaluations become an alarm: beside the plain comparison tests that add up what they see.
///
/// They need a residual that is white, of unit covariance, without a fault: the filter has the
/// whitening in it. With s_k = r_k,i, row by row, and b_i what bounded sources add to it at most,
///
///   kCusum: g±_k = min(max(0, g±_k-1 ± s_k - b_i - κ), 2 h)   Page (1954)
///   kGlr:   g_k = max_j max(0, |s_k-j+1 + .. + s_k| - j b_i)² / (2 j),  1 <= j <= window
///
/// Evaluation signal: the largest over rows and signs; it fires above the threshold h.
enum class TestKind { kComparison, kCusum, kGlr };

struct SequentialTest {
  TestKind kind = TestKind::kCusum;
  double reference = 0.0;      ///< κ, in standard deviations: half of the shift it is tuned to
  std::uint32_t window = 0;    ///< of kGlr, samples
  std::vector<double> offset;  ///< b, rows
};

/// Longest window of a GLR test.
inline constexpr std::uint32_t kMaxGlrWindow = 10'000;

/// Where a calibrated threshold comes from: a generalised Pareto tail, fitted to what the
/// evaluation signal exceeded for `dwell` samples in fault-free logs.
struct Calibration {
  double hours = 0.0;               ///< of the fault-free record that was fitted
  std::uint32_t exceedances = 0;    ///< independent ones (clusters) above `level`
  double level = 0.0;               ///< u
  double scale = 0.0;               ///< σ > 0
  double shape = 0.0;               ///< ξ
  double false_alarms_per_h = 0.0;  ///< of this residual at its threshold
  double rate_low_per_h = 0.0;      ///< 95 % confidence interval of that
  double rate_high_per_h = 0.0;
  double held_out_hours = 0.0;     ///< of the record that was not fitted
  double held_out_expected = 0.0;  ///< exceedances of `level` in it
  std::uint32_t held_out_found = 0;
};

/// Its residual is an estimate of the size of a fault. Proved, with all noises, disturbances and
/// slopes within their bounds: if no fault but this one acts, and it has been constant for
/// `settle_samples` since it began, up to its size, then |r - m| <= bound (once the part of the
/// start-up is over, in which the course of thresholds is above its last row). `bound` is the
/// largest error without a fault and 5 % of that for what is left of the step.
struct FaultEstimation {
  std::size_t fault = 0;
  double bound = 0.0;                ///< in the fault's unit
  std::uint32_t settle_samples = 0;  ///< of a step of its size
};

/// An observer x̂_k = v_k + T (y_k - D u_k) of x_k = (state; sizes of the faults that it carries as
/// states, m_k+1 = m_k + drift), and what was proved of its error e = x - x̂. With
///
///   S = I - T C,   N = S A - Γ C   (A, C: plant in the bank's domain, faults that are states
///   behind
///                                   the plant's own, slopes of φ at their middle in A)
///   Λ = Σ E_o δ_i E_i,   |δ_i| <= radius of φ_i times its gain
///   w = (disturbances; noises; drifts): x_k+1 = .. + M w_k, y_k = .. + W w_k, |w_i| <= w̄_i
///
///   e_k+1 = (N + S Λ_k) e_k + (S M - Γ W) w_k - T W w_k+1 + (faults)
///   r_k   = R e_k + Q w_k + (faults):   y - ŷ (R = C, Q = W), or the estimate m̂ itself
///
/// Quadratic bound: with V = eᵀPe, at every vertex of Λ,
///
///   [A_e B_e]ᵀ P [A_e B_e] <= diag(α P, (1 - α) diag(μ_now, μ_next))
///   [R Q]ᵀ ΩᵀΩ [R Q] <= diag(P, diag(μ_direct))
///
/// hence ‖Ω r_k‖² <= J(k)² = α^k λ_max(P) ‖e_0‖² + (1 - α^k) Σ (μ_now + μ_next) w̄² + Σ μ_direct w̄².
/// A filter that is evaluated row by row may do without P; then it has no J. Thresholds are those
/// of the plant without a fault: drifts count as 0 in them, and |e_0| <= |S| x̄ + |T W| w̄.
/// docs/decisions say where this differs from Ma, Gao, Guo (2024).
struct ObserverCertificate {
  std::vector<std::size_t> fault_states;  ///< indices of the faults it carries as states
  Eigen::VectorXd drift_bound;  ///< per fault state: largest change per sample that P allows
  Eigen::MatrixXd T;            ///< (n + fault states)×q
  Eigen::MatrixXd gain;         ///< Γ, (n + fault states)×q
  double alpha = 0.0;           ///< α
  Eigen::MatrixXd P;            ///< symmetric, to the bit
  Eigen::VectorXd mu_now, mu_next, mu_direct;  ///< per entry of w; zero where it does not enter
  /// Smallest gain ‖Ω r‖₂ / ‖m‖₂ of the `detects` over the band, with Λ constant; 0: none was asked
  /// for.
  double beta = 0.0;
  std::vector<std::size_t> detects;  ///< indices of the faults that β is about
  double band_low_rad = 0.0;         ///< per sample, 0 .. π
  double band_high_rad = 0.0;
  std::vector<double>
      vertex_radius;  ///< ρ(N + S Λ) per vertex: bit i of its number: δ_i at its largest
  /// Per fault, in its unit, of a constant one, worst over the vertices: where the residual's value
  /// at rest reaches the threshold, and twice that, which no disturbance can hide; 0: it never
  /// does.
  std::vector<double> nominal_fault, guaranteed_fault;
};

/// One residual generator in its implementation form (inputs y, u), discrete time:
///
///   v_k+1 = F v_k - E y_k + G u_k + Σ W_i (φ_i(s_i) - c_i s_i)
///   r_k   = M v_k - H y_k + K u_k
///
/// (the sum is an observer's; other filters are linear.) v: d, y: q, u: m, r: rows. First-order
/// hold of y is already folded in: v = w + E_1 y, where w_k+1 = F w_k - E_0 y_k - E_1 y_k+1 + G u_k
/// and E = E_0 + F E_1.
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
  Eigen::MatrixXd L, J;    ///< d×k, rows×k: per fault, in its unit
  double threshold = 0.0;  ///< τ: it fires when its evaluation is > τ; with a course the
                           ///< one that holds in the end: the last J(k), or 1
  std::uint32_t forget_samples = 0;  ///< samples a bad sample contaminates it for
  /// A constant fault that it sees only in transients, up to 10 times its size, makes it fire for
  /// so long at most: what fires longer is not explained by such a fault. Proved for observers:
  /// from then on the fault adds at most 5 % of the threshold, so that to fire takes 95 % of it
  /// from noise and disturbances. 0: not known, or there is no such fault.
  std::uint32_t transient_samples = 0;
  std::vector<FilterNonlinearity> nonlinearities{};
  Evaluation evaluation = Evaluation::kNorm;    ///< kComponent: only with a course
  std::optional<ThresholdCourse> course{};      ///< absent: τ at all times
  std::optional<FaultEstimation> estimation{};  ///< if its residual is an estimate
  std::optional<ObserverCertificate> observer{};
  std::optional<SequentialTest> test{};     ///< absent: plain comparison
  std::optional<ThresholdShares> shares{};  ///< of certified thresholds of linear filters
  std::optional<Calibration> calibration{};
  FilterCertificate certificate;
};

/// A disturbance of the plant, and what the bank makes of it.
struct BankDisturbance {
  enum class Treatment {
    kNone,       ///< it reaches the residuals
    kDecoupled,  ///< no residual sees it, whatever its course
    kConstant,   ///< no residual sees it while it is constant
    kWeakened,   ///< it reaches residuals, as little as can be against the faults they are to see
  };
  /// No residual sees it, whatever its course or while it is constant.
  [[nodiscard]] bool is_ignored() const {
    return treatment == Treatment::kDecoupled || treatment == Treatment::kConstant;
  }
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
  std::uint32_t dwell = 3;   ///< samples a residual must exceed, and stay below, its threshold
  std::uint32_t settle = 3;  ///< samples a signature must stand before its verdict is announced
  /// The same where residuals have only cleared since the last announcement and yet other faults
  /// would be named: residuals that clear one after the other. 0: as `settle`.
  std::uint32_t clearing = 0;
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
  std::string method;  ///< "geometric", "eigenstructure", "uio"
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
  ThresholdBasis thresholds;
  IsolabilityCertificate isolability;

  /// Rows of all filters' residuals, stacked in order.
  [[nodiscard]] Eigen::Index residual_rows() const;
};

}  // namespace faultline
