#include "diagnosis/certify/observer_proof.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <limits>
#include <numbers>
#include <stdexcept>
#include <utility>

#include <Eigen/LU>
#include <fmt/format.h>

#include "diagnosis/certify/error_bounds.h"
#include "diagnosis/certify/filter_loop.h"
#include "diagnosis/certify/quadratic_bound.h"
#include "diagnosis/certify/residual_evaluation.h"
#include "diagnosis/certify/spectra.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXcd;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using Complex = std::complex<double>;

// The start is over when what is left of it is as small as rounding errors of the limits.
constexpr double kStartOver = 1e-12;
// A row that nothing reaches in its first samples is zero but for rounding errors: those of terms
// that are up to a thousand times larger stay far below this part of its limit.
constexpr double kLeastThreshold = 1e-6;
constexpr std::size_t kLongestCourse = 20'000;
constexpr std::size_t kLongestFading = 100'000;
// Faults up to so many times their size fade within the times given.
constexpr double kLargestFault = 10.0;
// A step is over when 5 % are left, of the threshold or of the largest error of an estimate; a bad
// sample is forgotten when 1 % of the threshold are.
constexpr double kStepOver = 0.05;
constexpr double kForgotten = 0.01;
// Numbers of samples may be rounded either way when their rule is met this closely.
constexpr double kSlack = 1e-9;
constexpr int kBandPoints = 400;
// Rounding errors of gains, and of the solver that β comes from.
constexpr double kGridSlack = 1e-6;

class Proof {
 public:
  Proof(const PlantModel& plant, const Bank& bank, const ResidualFilter& filter)
      : plant_(plant), filter_(filter), loop_(observer_loop(plant, bank, filter)), bounds_(loop_) {
    weight_ = filter.course && filter.course->weight.size() > 0
                  ? filter.course->weight
                  : MatrixXd(MatrixXd::Identity(loop_.R.rows(), loop_.R.rows()));
    if (filter.observer->P.size() > 0) {
      quadratic_ = quadratic_bound(loop_, *filter.observer, weight_);
    }
  }

  ObserverThresholds thresholds() const {
    check_quadratic();
    ObserverThresholds thresholds;
    thresholds.component_limit = bounds_.limit();
    if (!(thresholds.component_limit.minCoeff() > 0.0)) {
      refuse_zero();
    }
    const std::optional<std::size_t> last = bounds_.faded_after(
        {MatrixXd::Identity(loop_.n(), loop_.n()), loop_.e_bound},
        [&](const VectorXd& rows) {
          return (rows.array() / thresholds.component_limit.array()).maxCoeff();
        },
        kStartOver, kLongestCourse);
    const double quadratic_last = quadratic_ ? quadratic_->start_over_after(kStartOver) : 0.0;
    if (!last || quadratic_last > static_cast<double>(kLongestCourse)) {
      throw std::invalid_argument(fmt::format(
          "start-up takes more than {} samples, expected a faster observer", kLongestCourse));
    }
    const std::size_t end = std::max(*last, static_cast<std::size_t>(quadratic_last));
    thresholds.component = bounds_.course(end + 1);
    for (Index k = 0; k < thresholds.component.rows(); ++k) {
      thresholds.component.row(k) = thresholds.component.row(k).cwiseMax(
          kLeastThreshold * thresholds.component_limit.transpose());
    }
    const auto held = thresholds.component.rows() - 1;
    thresholds.component.row(held) =
        thresholds.component.row(held).cwiseMax(thresholds.component_limit.transpose());
    if (quadratic_) {
      thresholds.norm_limit = quadratic_->limit();
      thresholds.norm = VectorXd(static_cast<Index>(end) + 1);
      for (std::size_t k = 0; k <= end; ++k) {
        thresholds.norm[static_cast<Index>(k)] = quadratic_->at(k);
      }
      thresholds.norm[held] = std::max(thresholds.norm[held], thresholds.norm_limit);
    }
    return thresholds;
  }

  ObserverProof run() {
    ObserverProof proof;
    proof.form = observer_form(plant_, loop_);
    proof.thresholds = thresholds();
    threshold_.emplace(filter_.evaluation, weight_,
                       proof.thresholds.component.bottomRows(1).transpose(),
                       proof.thresholds.norm_limit);
    for (Index vertex = 0; vertex < loop_.vertex_count(); ++vertex) {
      proof.vertex_radius.push_back(spectral_radius(loop_.at_vertex(vertex)));
      if (!(proof.vertex_radius.back() < 1.0)) {
        throw std::invalid_argument(
            fmt::format("spectral radius {:.6g} at corner {} of the slopes, expected a stable "
                        "observer (below 1)",
                        proof.vertex_radius.back(), vertex));
      }
    }
    find_faults(proof);
    if (filter_.observer->beta != 0.0) proof.beta = beta();
    if (filter_.estimation) {
      const std::size_t fault = filter_.estimation->fault;
      const double part = kStepOver * bounds_.limit()[0];
      proof.estimation_bound = bounds_.limit()[0] + part;
      const std::optional<SampleCount> settle = count(
          onset(fault, 1.0), [](const VectorXd& rows) { return rows[0]; }, part);
      if (!settle) {
        throw std::invalid_argument(
            fmt::format("its estimate takes more than {} samples to settle, "
                        "expected a faster observer",
                        kLongestFading));
      }
      proof.settle = *settle;
    }
    proof.transient = transient();
    proof.forget = forget();
    return proof;
  }

 private:
  void check_quadratic() const {
    if (!quadratic_) {
      if (filter_.evaluation == Evaluation::kNorm) {
        throw std::invalid_argument(
            "found no P, expected one: its residual is evaluated by its norm");
      }
      return;
    }
    if (!quadratic_->is_proved()) {
      throw std::invalid_argument(
          fmt::format("P does not prove its bound: largest eigenvalue {:.9g} of the inequality of "
                      "the error, {:.9g} of that of the residual, expected at most 1",
                      quadratic_->dynamic_eigenvalue, quadratic_->output_eigenvalue));
    }
    if (!(quadratic_->limit() > 0.0)) refuse_zero();
  }

  [[noreturn]] static void refuse_zero() {
    throw std::invalid_argument(
        "a threshold would be 0, and rounding errors exceed that: no noise and no disturbance "
        "reaches a row of its residual, expected a [[noise]] with a bound on it");
  }

  // Zero if it is but a rounding error.
  [[nodiscard]] VectorXd rest_gain(const MatrixXd& N, Index fault) const {
    const MatrixXd inverse = (MatrixXd::Identity(N.rows(), N.cols()) - N).inverse();
    const VectorXd column = loop_.F_now.col(fault) + loop_.F_next.col(fault);
    VectorXd gain = loop_.R * (inverse * column) + loop_.J.col(fault);
    const double possible =
        loop_.R.norm() * inverse.norm() * column.norm() + loop_.J.col(fault).norm();
    if (gain.norm() <= rounding_error(possible)) gain.setZero();
    return gain;
  }

  void find_faults(ObserverProof& proof) const {
    const std::size_t k = plant_.faults.size();
    proof.nominal_fault.assign(k, 0.0);
    for (std::size_t j = 0; j < k; ++j) {
      double smallest = std::numeric_limits<double>::infinity();
      for (Index vertex = 0; vertex < loop_.vertex_count(); ++vertex) {
        const VectorXd gain = rest_gain(loop_.at_vertex(vertex), static_cast<Index>(j));
        smallest = std::min(smallest, threshold_->of(gain));
      }
      const double nominal = threshold_->threshold() / smallest;
      proof.nominal_fault[j] = smallest > 0.0 && std::isfinite(nominal) ? nominal : 0.0;
    }
  }

  [[nodiscard]] double beta() const {
    const ObserverCertificate& claims = *filter_.observer;
    if (claims.detects.empty() ||
        *std::max_element(claims.detects.begin(), claims.detects.end()) >= plant_.faults.size()) {
      throw std::invalid_argument(fmt::format(
          "found beta = {:g} of faults that are not in the plant, or of none", claims.beta));
    }
    const double low = claims.band_low_rad, high = claims.band_high_rad;
    if (!(0.0 <= low && low <= high && high <= std::numbers::pi)) {
      throw std::invalid_argument(
          fmt::format("found a band from {:g} to {:g} rad per sample, expected 0 <= low <= high <= "
                      "pi",
                      low, high));
    }
    const auto count = std::ssize(claims.detects);
    if (count > loop_.R.rows()) return 0.0;  // some course of theirs is not seen
    MatrixXd F_now(loop_.n(), count), F_next(loop_.n(), count), J(loop_.R.rows(), count);
    for (Index j = 0; j < count; ++j) {
      const auto fault = static_cast<Index>(claims.detects[static_cast<std::size_t>(j)]);
      F_now.col(j) = loop_.F_now.col(fault);
      F_next.col(j) = loop_.F_next.col(fault);
      J.col(j) = loop_.J.col(fault);
    }
    double smallest = std::numeric_limits<double>::infinity();
    for (Index vertex = 0; vertex < loop_.vertex_count(); ++vertex) {
      const MatrixXd N = loop_.at_vertex(vertex);
      for (int i = 0; i < kBandPoints; ++i) {
        const Complex z = std::polar(1.0, low + (high - low) * i / (kBandPoints - 1));
        const MatrixXcd pencil = z * MatrixXcd::Identity(loop_.n(), loop_.n()) - N;
        const MatrixXcd e = pencil.partialPivLu().solve(F_now + z * F_next);
        smallest = std::min(smallest, smallest_singular_value(weight_ * (loop_.R * e + J)));
      }
    }
    return smallest;
  }

  // What the onset of a fault of so many times its size leaves: the error less what it is in the
  // end (with the slopes in the middle).
  [[nodiscard]] ErrorBounds::Start onset(std::size_t fault, double sizes) const {
    const auto column = static_cast<Index>(fault);
    const std::optional<Index> state = carried_state(fault);
    const VectorXd error = state ? VectorXd(loop_.S.col(*state))
                                 : VectorXd(loop_.F_next.col(column) - rest_error(column));
    return {error, VectorXd::Constant(1, sizes * plant_.faults[fault].size)};
  }

  // The state that is the size of this fault, if it is carried.
  [[nodiscard]] std::optional<Index> carried_state(std::size_t fault) const {
    const std::vector<std::size_t>& carried = filter_.observer->fault_states;
    const auto place = std::find(carried.begin(), carried.end(), fault);
    if (place == carried.end()) return std::nullopt;
    return plant_.n() + std::distance(carried.begin(), place);
  }

  [[nodiscard]] VectorXd rest_error(Index fault) const {
    const MatrixXd pencil = MatrixXd::Identity(loop_.n(), loop_.n()) - loop_.N;
    return pencil.partialPivLu().solve(loop_.F_now.col(fault) + loop_.F_next.col(fault));
  }

  // Whether a constant fault that the residual does not see at rest moves none of the Lipschitz
  // terms for ever.
  [[nodiscard]] bool fades(std::size_t fault) const {
    if (carried_state(fault) || loop_.radius.isZero(0.0)) return true;
    const VectorXd error = rest_error(static_cast<Index>(fault));
    return (loop_.E_i * error).norm() <= rounding_error(loop_.E_i.norm() * error.norm());
  }

  [[nodiscard]] static ErrorBounds::Measure part_of(const ResidualEvaluation& evaluation) {
    return [&evaluation](const VectorXd& rows) {
      return evaluation.largest(rows) / evaluation.threshold();
    };
  }

  [[nodiscard]] std::optional<SampleCount> count(const ErrorBounds::Start& start,
                                                 const ErrorBounds::Measure& measure,
                                                 double part) const {
    const auto after = [&](double limit) {
      return bounds_.faded_after(start, measure, limit, kLongestFading);
    };
    const std::optional<std::size_t> value = after(part);
    if (!value) return std::nullopt;
    // Just within the longest time all three are: at most that.
    const auto samples = [](std::optional<std::size_t> found) {
      return static_cast<std::uint32_t>(found.value_or(kLongestFading));
    };
    return SampleCount{samples(value), samples(after((1.0 + kSlack) * part)),
                       samples(after((1.0 - kSlack) * part))};
  }

  [[nodiscard]] SampleCount transient() const {
    SampleCount longest;
    for (std::size_t j = 0; j < plant_.faults.size(); ++j) {
      if (filter_.sees[j] != Sensitivity::kTransient) continue;
      if (!fades(j)) return {};
      const std::optional<SampleCount> own =
          count(onset(j, kLargestFault), part_of(*threshold_), kStepOver);
      if (!own) return {};
      // At least one: none would say that nothing is known.
      longest = {std::max({longest.value, own->value, 1u}),
                 std::max({longest.smallest, own->smallest, 1u}),
                 std::max({longest.largest, own->largest, 1u})};
    }
    return longest;
  }

  [[nodiscard]] SampleCount forget() const {
    const VectorXd& y = plant_.output_range;
    const VectorXd& u = plant_.input_range;
    VectorXd left = filter_.E.cwiseAbs() * y + filter_.G.cwiseAbs() * u;
    for (const FilterNonlinearity& term : filter_.nonlinearities) {
      const double moved = term.a_y.cwiseAbs().dot(y) + term.a_u.cwiseAbs().dot(u);
      left += term.radius * moved * term.W.cwiseAbs();
    }
    const std::optional<SampleCount> after =
        count({MatrixXd::Identity(loop_.n(), loop_.n()), left}, part_of(*threshold_), kForgotten);
    if (!after) {
      throw std::invalid_argument(
          fmt::format("it takes more than {} samples to forget a bad one, "
                      "expected a faster observer",
                      kLongestFading));
    }
    return {after->value + 1, after->smallest + 1, after->largest + 1};  // itself
  }

  const PlantModel& plant_;
  const ResidualFilter& filter_;
  ObserverLoop loop_;
  ErrorBounds bounds_;
  MatrixXd weight_;
  std::optional<QuadraticBound> quadratic_;
  std::optional<ResidualEvaluation> threshold_;
};

}  // namespace

ObserverThresholds observer_thresholds(const PlantModel& plant, const Bank& bank,
                                       const ResidualFilter& filter) {
  const PlantModel rounded = with_rounded_outputs(plant, bank.thresholds.output_resolution);
  return Proof(rounded, bank, filter).thresholds();
}

ObserverProof prove_observer(const PlantModel& plant, const Bank& bank,
                             const ResidualFilter& filter) {
  const PlantModel rounded = with_rounded_outputs(plant, bank.thresholds.output_resolution);
  try {
    return Proof(rounded, bank, filter).run();
  } catch (const std::invalid_argument& error) {
    throw std::invalid_argument(fmt::format("residual {}: {}", filter.name, error.what()));
  }
}

bool is_beta_true(double claimed, double on_grid) {
  return claimed >= 0.0 && claimed <= (1.0 + kGridSlack) * on_grid;
}

void certify_observer(const PlantModel& plant, const Bank& bank, ResidualFilter& filter) {
  const ObserverProof proof = prove_observer(plant, bank, filter);
  ObserverCertificate& certificate = *filter.observer;
  if (proof.beta && !is_beta_true(certificate.beta, *proof.beta)) {
    throw std::invalid_argument(
        fmt::format("residual {}: found beta = {:g}, expected at most {:g}, its least gain in the "
                    "band",
                    filter.name, certificate.beta, *proof.beta));
  }
  certificate.vertex_radius = proof.vertex_radius;
  certificate.nominal_fault = proof.nominal_fault;
  certificate.guaranteed_fault = proof.nominal_fault;
  for (double& size : certificate.guaranteed_fault) size *= 2.0;
  if (!filter.course) filter.course.emplace();
  if (filter.course->weight.size() == 0) {
    const auto rows = proof.thresholds.component.cols();
    filter.course->weight = Eigen::MatrixXd::Identity(rows, rows);
  }
  filter.course->component = proof.thresholds.component;
  filter.course->norm = proof.thresholds.norm;
  filter.threshold =
      filter.evaluation == Evaluation::kComponent ? 1.0 : *(proof.thresholds.norm.end() - 1);
  if (filter.estimation) {
    filter.estimation->bound = proof.estimation_bound;
    filter.estimation->settle_samples = proof.settle.value;
  }
  filter.transient_samples = proof.transient.value;
  filter.forget_samples = proof.forget.value;
}

}  // namespace faultline
