#include "diagnosis/certify/linear_thresholds.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

#include <Eigen/LU>
#include <fmt/format.h>

#include "diagnosis/certify/forgetting.h"
#include "diagnosis/certify/l1_norm.h"
#include "diagnosis/certify/power_bound.h"
#include "diagnosis/certify/sequential_rates.h"
#include "diagnosis/certify/stationary_noise.h"
#include "diagnosis/model/discretize.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// What is left of the start when the course ends, relative to its last row.
constexpr double kStartFaded = 1e-9;
constexpr Index kMostSamples = 20'000;
// A threshold, or a leak, below this part of what the channels' ranges could do is rounding.
constexpr double kRounding = 1e-10;
// Terms of a late command's effect, by powers of the delay.
constexpr int kMostTerms = 12;
constexpr double kSecondsPerHour = 3600.0;
// Per sample; more have no meaning.
constexpr double kMostAlarms = 0.1;
// A residual is white if its covariance and the sum of its autocovariances are off by no more.
constexpr double kWhite = 1e-3;
constexpr std::size_t kMostLags = 10'000;

enum class Share { kDisturbance, kNoise, kResolution, kLeakage, kJitter };

// Inputs of one stable system, and their bounds.
struct Source {
  Share share;
  StableSystem system;
  VectorXd bound;
};

class Proof {
 public:
  Proof(const PlantModel& plant, const Bank& bank, SampledPlant& loop, const ResidualFilter& filter)
      : plant_(plant), bank_(bank), filter_(filter), loop_(loop, filter) {}

  LinearThresholds run() {
    collect();
    const Index rows = filter_.H.rows();
    MatrixXd shares = MatrixXd::Zero(rows, 5);
    for (const Source& source : sources_) {
      shares.col(static_cast<Index>(source.share)) += l1_norm(source.system) * source.bound;
    }
    add_leaks(shares);
    LinearThresholds result;
    const VectorXd bounded = shares.rowwise().sum();
    const VectorXd gaussian = filter_.test ? VectorXd::Zero(rows) : gaussian_share();
    result.shares = {list(shares.col(0)), list(shares.col(1)), list(shares.col(2)),
                     list(shares.col(3)), list(shares.col(4)), list(gaussian)};
    if (filter_.test) {
      result.offset = bounded;
      result.threshold = test_threshold();
    } else {
      refuse_nothing(bounded + gaussian);
      result.component = course(bounded, gaussian);
    }
    return result;
  }

 private:
  [[noreturn]] void refuse(const std::string& text) const {
    throw std::invalid_argument(fmt::format("{}: certified thresholds: {}", filter_.name, text));
  }

  static std::vector<double> list(const VectorXd& values) { return {values.begin(), values.end()}; }

  [[nodiscard]] double rate_per_sample() const {
    const double rate = bank_.thresholds.false_alarms_per_h * bank_.sample_time_s /
                        kSecondsPerHour / static_cast<double>(bank_.filters.size());
    return std::min(rate, kMostAlarms);
  }

  [[nodiscard]] bool is_gaussian(const Noise& noise) const {
    return bank_.thresholds.false_alarms_per_h > 0.0 && noise.sigma.has_value();
  }

  static StableSystem columns(const StableSystem& system, const std::vector<Index>& chosen) {
    StableSystem result{system.A, MatrixXd(system.B.rows(), std::ssize(chosen)), system.C,
                        MatrixXd(system.D.rows(), std::ssize(chosen))};
    for (Index j = 0; j < std::ssize(chosen); ++j) {
      result.B.col(j) = system.B.col(chosen[static_cast<std::size_t>(j)]);
      result.D.col(j) = system.D.col(chosen[static_cast<std::size_t>(j)]);
    }
    return result;
  }

  // What the ranges of the outputs could do to each row: below 1e-10 of it there is rounding only.
  [[nodiscard]] VectorXd possible() const {
    return l1_norm(output_) * plant_.output_range +
           VectorXd::Constant(filter_.H.rows(), std::numeric_limits<double>::min());
  }

  void collect() {
    output_ = loop_.stacked(FilterLoop::Source::kOutput);
    add_disturbances(loop_.stacked(FilterLoop::Source::kPlant));
    add_noises();
    add_resolution();
    add_jitter();
  }

  void add_disturbances(const StableSystem& plant) {
    using Treatment = BankDisturbance::Treatment;
    const Index first = plant_.m() + std::ssize(plant_.faults);
    std::vector<Index> inputs;
    for (Index i = 0; i < plant_.m(); ++i) inputs.push_back(i);
    sources_.push_back({Share::kLeakage, columns(plant, inputs), plant_.input_range});
    const VectorXd possible_rows = possible();
    for (std::size_t i = 0; i < plant_.disturbances.size(); ++i) {
      const Disturbance& disturbance = plant_.disturbances[i];
      const StableSystem system = columns(plant, {first + static_cast<Index>(i)});
      const Treatment treatment = bank_.disturbances[i].treatment;
      const bool is_constant = treatment == Treatment::kConstant;
      const MatrixXd reach = is_constant ? dc_gain(system).cwiseAbs() : l1_norm(system);
      if (!disturbance.bound) {
        if ((reach.col(0).array() <= kRounding * possible_rows.array()).all()) continue;
        refuse(fmt::format(
            "disturbance {} reaches it{} and has no bound; expected bound in its "
            "[[disturbance]], or the disturbance in decouple",
            disturbance.name,
            treatment == Treatment::kDecoupled ? " (by what the discretisation leaves)" : ""));
      }
      const VectorXd bound = VectorXd::Constant(1, *disturbance.bound);
      if (is_constant) {
        steps_.push_back({Share::kLeakage, system, bound});
      } else {
        sources_.push_back(
            {treatment == Treatment::kDecoupled ? Share::kLeakage : Share::kDisturbance, system,
             bound});
      }
    }
  }

  [[nodiscard]] static MatrixXd dc_gain(const StableSystem& system) {
    const Index n = system.A.rows();
    if (n == 0) return system.D;
    const MatrixXd pencil = MatrixXd::Identity(n, n) - system.A;
    return system.C * pencil.partialPivLu().solve(system.B) + system.D;
  }

  [[nodiscard]] StableSystem output_error(const VectorXd& direction) const {
    return {output_.A, output_.B * direction, output_.C, output_.D * direction};
  }

  void add_noises() {
    for (const Noise& noise : plant_.noises) {
      if (is_gaussian(noise)) {
        gaussian_.conservativeResize(plant_.q(), gaussian_.cols() + 1);
        gaussian_.rightCols(1) = noise.output * *noise.sigma;
      } else if (noise.bound) {
        sources_.push_back(
            {Share::kNoise, output_error(noise.output), VectorXd::Constant(1, *noise.bound)});
      } else {
        refuse(
            fmt::format("{} has no bound; expected bound in its [[noise]], or "
                        "false_alarms_per_h in [decision], which takes its sigma",
                        noise.name));
      }
    }
  }

  void add_resolution() {
    if (bank_.thresholds.output_resolution.size() == 0) return;
    sources_.push_back({Share::kResolution, output_, 0.5 * bank_.thresholds.output_resolution});
  }

  // ∫_0^δ e^(A (T - s)) B ds = Σ_i e^(A T) (-A)^(i-1) B δ^i / i!
  void add_jitter() {
    const double jitter_s = bank_.thresholds.jitter_s;
    if (jitter_s == 0.0) return;
    MatrixXd term = plant_.B;
    if (bank_.domain != DesignDomain::kEuler) {
      // e^(A T) B: A_d of the plant, times B.
      term = discretize_zoh(plant_.A, plant_.B, bank_.sample_time_s).A * plant_.B;
    }
    const StableSystem state = loop_.stacked(FilterLoop::Source::kState);
    double factor = jitter_s;
    const double size = jitter_s * term.norm();
    for (int i = 1; i <= kMostTerms; ++i) {
      sources_.push_back({Share::kJitter,
                          {state.A, state.B * term * factor, state.C, state.D * term},
                          2.0 * plant_.input_range});
      term = (-plant_.A * term).eval();
      factor *= jitter_s / (i + 1);
      if (bank_.domain == DesignDomain::kEuler || factor * term.norm() <= kRounding * size) return;
    }
    refuse(fmt::format("jitter_s of {:g} s is too long for the plant's fastest mode", jitter_s));
  }

  // What does not come through the stable part: constant disturbances, and modes that stay.
  void add_leaks(MatrixXd& shares) {
    auto leakage = shares.col(static_cast<Index>(Share::kLeakage));
    for (const Source& step : steps_) leakage += dc_gain(step.system).cwiseAbs() * step.bound;
    const MatrixXd modes = loop_.uncancelled().cwiseAbs();
    if (modes.size() == 0 || modes.maxCoeff() == 0.0) return;
    if (!plant_.state_range) {
      refuse(
          "the plant has a mode that is not stable, of which the hold of y between samples leaves "
          "something in it; expected range in [states], or domain = \"sampled\", where nothing "
          "is left");
    }
    leakage += modes * *plant_.state_range;
  }

  [[nodiscard]] StableSystem noise_system() const {
    return {filter_.F, -filter_.E * gaussian_, filter_.M, -filter_.H * gaussian_};
  }

  [[nodiscard]] VectorXd gaussian_share() const {
    const Index rows = filter_.H.rows();
    if (gaussian_.cols() == 0) return VectorXd::Zero(rows);
    const auto R = autocovariances(noise_system(), bank_.decision.dwell);
    const VectorXd variance = R.front().diagonal();
    if (variance.maxCoeff() <= 0.0) return VectorXd::Zero(rows);
    if ((variance.array() <= 0.0).any()) {
      refuse("noise reaches some of its rows only; expected all of them, or none");
    }
    return exceedance_factor(R, bank_.decision.dwell, rate_per_sample()) * variance.cwiseSqrt();
  }

  // White: R(0) = I, and nothing that adds up.
  void refuse_coloured() const {
    const Index rows = filter_.H.rows();
    if (gaussian_.cols() == 0) {
      refuse(
          "a sequential test takes Gaussian noise in the residual; expected sigma in a [[noise]] "
          "of the plant");
    }
    const auto R = autocovariances(noise_system(), kMostLags);
    double off = (R.front() - MatrixXd::Identity(rows, rows)).cwiseAbs().maxCoeff();
    double correlated = 0.0;
    for (std::size_t j = 1; j < R.size(); ++j) correlated += 2.0 * R[j].cwiseAbs().maxCoeff();
    off = std::max(off, correlated);
    if (!(off <= kWhite)) {
      refuse(
          fmt::format("its noise is not white, of unit covariance (off by {:.2g}); a sequential "
                      "test takes such",
                      off));
    }
  }

  [[nodiscard]] double test_threshold() const {
    refuse_coloured();
    const double rows = static_cast<double>(filter_.H.rows());
    return filter_.test->kind == TestKind::kCusum
               ? cusum_threshold(filter_.test->reference, rate_per_sample() / (2.0 * rows))
               : glr_threshold(filter_.test->window, rate_per_sample() / rows);
  }

  void refuse_nothing(const VectorXd& threshold) const {
    const VectorXd least = kRounding * possible();
    if ((threshold.array() > least.array()).all()) return;
    refuse(
        "it would be zero: no disturbance, noise or rounding that the plant file or [decision] "
        "resolution bounds reaches it; expected one, as an ideal residual has no threshold");
  }

  // From the first sample on.
  [[nodiscard]] MatrixXd course(const VectorXd& bounded, const VectorXd& gaussian) const {
    if (!plant_.state_range) {
      refuse(
          "they hold from the first sample on and need the states' ranges; expected range in "
          "[states] of the plant file");
    }
    const VectorXd limit = bounded + gaussian;
    const StableSystem start = loop_.stacked(FilterLoop::Source::kState);
    const double largest = largest_power(start.A);
    const double entry = (start.B * plant_.state_range->asDiagonal()).norm();
    const VectorXd modes = loop_.uncancelled().cwiseAbs() * *plant_.state_range;
    // Sums of the impulse responses so far, in the order of sources_.
    VectorXd sum = modes + gaussian;
    for (const Source& source : sources_) sum += source.system.D.cwiseAbs() * source.bound;
    std::vector<MatrixXd> steps;
    for (const Source& step : steps_) steps.push_back(step.system.D);
    double step_rest = 0.0;  // Σ_j ‖A^j B‖ at most: what steps still change is that times ‖C A^k‖
    for (const Source& step : steps_) {
      step_rest += power_sum_bound(start.A).value_or(std::numeric_limits<double>::infinity()) *
                   step.system.B.norm() * step.bound[0];
    }
    MatrixXd left = start.C;  // C A^k
    std::vector<VectorXd> rows;
    for (Index k = 0; k < kMostSamples; ++k) {
      const VectorXd initial = (left * start.B).cwiseAbs() * *plant_.state_range;
      VectorXd row = sum.cwiseMin(limit) + initial;
      VectorXd constant = VectorXd::Zero(limit.size());
      for (std::size_t i = 0; i < steps_.size(); ++i) {
        constant += steps[i].cwiseAbs() * steps_[i].bound;
      }
      row += constant;
      // All that can still come: the start, and steps on their way to rest.
      const double rest = left.norm() * (largest * entry + step_rest);
      if (rest <= kStartFaded * limit.minCoeff()) {
        rows.push_back(limit + VectorXd::Constant(limit.size(), rest));
        MatrixXd result(std::ssize(rows), limit.size());
        for (std::size_t i = 0; i < rows.size(); ++i) {
          result.row(static_cast<Index>(i)) = rows[i].transpose();
        }
        return result;
      }
      rows.push_back(row);
      for (const Source& source : sources_) {
        sum += (left * source.system.B).cwiseAbs() * source.bound;
      }
      for (std::size_t i = 0; i < steps_.size(); ++i) steps[i] += left * steps_[i].system.B;
      left = (left * start.A).eval();
    }
    refuse(fmt::format("its start-up takes longer than {} samples; expected faster poles",
                       kMostSamples));
  }

  const PlantModel& plant_;
  const Bank& bank_;
  const ResidualFilter& filter_;
  FilterLoop loop_;
  StableSystem output_;
  std::vector<Source> sources_, steps_;
  MatrixXd gaussian_;  // columns: Gaussian noises, times sigma
};

}  // namespace

LinearThresholdProof::LinearThresholdProof(const PlantModel& plant, const Bank& bank,
                                           SampledPlant& loop)
    : plant_(plant), bank_(bank), loop_(loop) {}

LinearThresholds LinearThresholdProof::prove(const ResidualFilter& filter) const {
  return Proof(plant_, bank_, loop_, filter).run();
}

std::uint32_t certified_forget_samples(const PlantModel& plant, const ResidualFilter& filter,
                                       double threshold_factor) {
  ResidualFilter relative = filter;
  relative.threshold = 1.0;
  if (filter.course) {
    const VectorXd last = filter.course->component.bottomRows(1).transpose();
    relative.M = last.cwiseInverse().asDiagonal() * filter.M;
  }
  // A sequential test adds up what is left: relative to its own standard deviation.
  return samples_to_forget(plant, relative, threshold_factor);
}

void certify_linear_thresholds(const PlantModel& plant, const LinearThresholdProof& proof,
                               ResidualFilter& filter) {
  const LinearThresholds found = proof.prove(filter);
  filter.shares = found.shares;
  filter.threshold = found.threshold;
  if (filter.test) {
    filter.test->offset.assign(found.offset.begin(), found.offset.end());
  } else {
    const Index rows = filter.H.rows();
    filter.evaluation = Evaluation::kComponent;
    filter.course = ThresholdCourse{MatrixXd::Identity(rows, rows),
                                    found.component.rowwise().norm(), found.component};
  }
  filter.forget_samples = certified_forget_samples(plant, filter);
}

}  // namespace faultline
