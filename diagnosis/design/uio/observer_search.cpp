#include "diagnosis/design/uio/observer_search.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <limits>
#include <map>
#include <stdexcept>
#include <utility>

#include <Eigen/LU>
#include <fmt/core.h>

namespace faultline {
namespace {

/// Steps of the descent over v, and of its refinement at the best a_0 of each α.
const double kCoarseStep = 3.0;
const double kFineStep = std::sqrt(3.0);

class Search {
 public:
  Search(const ObserverModel& model, const DecouplingMatrices& decoupling,
         const ObserverOutput& output, const std::optional<FrequencyBand>& band,
         const ObserverSearchOptions& options)
      : model_(model), decoupling_(decoupling), output_(output), band_(band), options_(options) {}

  ObserverSearch run() {
    if (!band_) {
      for (const double alpha : options_.alphas) {
        keep_if_best({attempt({alpha, ReferenceDirection::kFaultInput, 0.0, 0.0})});
      }
    } else if (const std::optional<ObserverMultipliers> start = start_point()) {
      for (const double alpha : options_.alphas) search_alpha(alpha, *start);
    }
    for (auto& [place, candidate] : best_) {
      candidate.bound = analysed(candidate.design);
      result_.candidates.push_back(std::move(candidate));
    }
    return std::move(result_);
  }

 private:
  using Solved = std::optional<ObserverCandidate>;

  static double objective_of(const Solved& solved) {
    return solved ? solved->design.objective : std::numeric_limits<double>::infinity();
  }

  Solved attempt(const ObserverMultipliers& multipliers) {
    ReferenceSystem reference;
    if (band_) {
      reference.a_0 = multipliers.a_0;
      reference.V = -multipliers.v * direction(multipliers.direction);
    }
    ObserverSynthesis design = synthesise_observer(model_, decoupling_, output_, multipliers.alpha,
                                                   band_, reference, options_.weight);
    result_.attempts.push_back({multipliers, design.status, design.reason, design.objective});
    if (options_.on_attempt) options_.on_attempt(result_.attempts.size());
    if (design.status != SynthesisStatus::kSolved) return std::nullopt;
    return ObserverCandidate{multipliers, std::move(design), {}};
  }

  void keep_if_best(Solved solved) {
    if (!solved) return;
    const auto place = std::pair(solved->multipliers.alpha, solved->multipliers.a_0);
    const auto [kept, is_first] = best_.try_emplace(place, *solved);
    if (!is_first && solved->design.objective < kept->second.design.objective) {
      kept->second = std::move(*solved);
    }
  }

  /// Where the descents begin: the best of a coarse scan of v for both directions at the middle α
  /// and a_0; at other α if none is feasible there.
  std::optional<ObserverMultipliers> start_point() {
    const double a_0 = options_.a_0s[options_.a_0s.size() / 2];
    std::vector<double> alphas = options_.alphas;
    std::rotate(alphas.begin(), alphas.begin() + static_cast<std::ptrdiff_t>(alphas.size() / 2),
                alphas.end());
    for (const double alpha : alphas) {
      set_response(alpha);
      Solved best;
      for (const auto direction :
           {ReferenceDirection::kFaultInput, ReferenceDirection::kFaultResponse}) {
        if (this->direction(direction).size() == 0) continue;
        for (double v = options_.smallest_v; v <= options_.largest_v;
             v *= kCoarseStep * kCoarseStep) {
          Solved solved = attempt({alpha, direction, a_0, v});
          keep_if_best(solved);
          if (objective_of(solved) < objective_of(best)) best = std::move(solved);
        }
      }
      if (best) return best->multipliers;
    }
    return std::nullopt;
  }

  /// F_e as the error of the L∞ observer shows it; none if there is no such observer.
  void set_response(double alpha) {
    response_.resize(0, 0);
    const ObserverSynthesis observer =
        synthesise_observer(model_, decoupling_, output_, alpha, std::nullopt, {}, options_.weight);
    if (observer.status != SynthesisStatus::kSolved) return;
    const ErrorDynamics dynamics = error_dynamics(model_, decoupling_, observer.gain);
    Eigen::MatrixXcd resolvent = -dynamics.N.cast<std::complex<double>>();
    resolvent.diagonal().array() += std::polar(1.0, 0.5 * (band_->low_rad + band_->high_rad));
    Eigen::MatrixXcd response = Eigen::PartialPivLU<Eigen::MatrixXcd>(resolvent).solve(
        dynamics.F_e.cast<std::complex<double>>());
    for (Eigen::Index j = 0; j < response.cols(); ++j) {
      const std::complex<double> square = response.col(j).cwiseProduct(response.col(j)).sum();
      response.col(j) *= std::polar(1.0, -0.5 * std::arg(square));
    }
    if (response.allFinite()) response_ = response.real();
  }

  [[nodiscard]] const Eigen::MatrixXd& direction(ReferenceDirection direction) const {
    return direction == ReferenceDirection::kFaultInput ? model_.F_x : response_;
  }

  void search_alpha(double alpha, ObserverMultipliers start) {
    start.alpha = alpha;
    for (const double a_0 : options_.a_0s) {
      start.a_0 = a_0;
      const Solved found = descend(start, attempt(start), kCoarseStep);
      if (found) start.v = found->multipliers.v;
    }
    Solved best;
    for (const auto& [place, candidate] : best_) {
      if (place.first == alpha && candidate.design.objective < objective_of(best)) best = candidate;
    }
    if (best) descend(best->multipliers, best, kFineStep);
  }

  /// Goes along v, by factors of `step`, as long as the objective falls.
  Solved descend(const ObserverMultipliers& start, Solved best, double step) {
    keep_if_best(best);
    for (const double factor : {1.0 / step, step}) {
      bool has_moved = false;
      ObserverMultipliers next = start;
      while (true) {
        next.v *= factor;
        if (next.v < options_.smallest_v || next.v > options_.largest_v) break;
        Solved solved = attempt(next);
        // Without a start anything solved is progress, and one step further may be the first.
        const bool is_better = objective_of(solved) < objective_of(best);
        if (!is_better &&
            (best || next.v / start.v > step * step || start.v / next.v > step * step)) {
          break;
        }
        keep_if_best(solved);
        if (is_better) best = std::move(solved);
        has_moved = has_moved || is_better;
      }
      if (has_moved) break;  // downhill was this way
    }
    return best;
  }

  [[nodiscard]] ObserverSynthesis analysed(const ObserverSynthesis& design) const {
    ObserverSynthesis bound =
        analyse_observer(model_, decoupling_, output_, design.gain, design.alpha, design.weight);
    if (bound.status != SynthesisStatus::kSolved || bound.tau > design.tau) return design;
    bound.beta = design.beta;
    return bound;
  }

  const ObserverModel& model_;
  const DecouplingMatrices& decoupling_;
  const ObserverOutput& output_;
  const std::optional<FrequencyBand>& band_;
  const ObserverSearchOptions& options_;
  Eigen::MatrixXd response_;
  std::map<std::pair<double, double>, ObserverCandidate> best_;  // by α, a_0
  ObserverSearch result_;
};

}  // namespace

ObserverSearch search_observer(const ObserverModel& model, const DecouplingMatrices& decoupling,
                               const ObserverOutput& output,
                               const std::optional<FrequencyBand>& band,
                               const ObserverSearchOptions& options) {
  if (options.alphas.empty() || options.a_0s.empty()) {
    throw std::invalid_argument("observer search: no alpha or no a_0; expected at least one each");
  }
  if (!(options.smallest_v > 0.0 && options.largest_v >= options.smallest_v)) {
    throw std::invalid_argument(
        fmt::format("observer search: v from {} to {}; expected 0 < from <= to", options.smallest_v,
                    options.largest_v));
  }
  return Search(model, decoupling, output, band, options).run();
}

}  // namespace faultline
