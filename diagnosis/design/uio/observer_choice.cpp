#include "diagnosis/design/uio/observer_choice.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "diagnosis/design/requested_disturbances.h"
#include "diagnosis/design/subspace.h"
#include "diagnosis/design/uio/component_threshold.h"
#include "diagnosis/design/uio/decoupling.h"
#include "diagnosis/design/uio/limit_text.h"
#include "diagnosis/design/uio/observer_search.h"
#include "diagnosis/design/uio/structural_limits.h"
#include "diagnosis/design/with_rows.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

MatrixXd chosen_columns(const MatrixXd& X, const std::vector<std::size_t>& columns) {
  MatrixXd chosen(X.rows(), std::ssize(columns));
  for (std::size_t j = 0; j < columns.size(); ++j) {
    chosen.col(static_cast<Index>(j)) = X.col(static_cast<Index>(columns[j]));
  }
  return chosen;
}

// The plant's outputs, those that carried faults change included.
MatrixXd augmented_outputs(const ObserverPlant& sampled, const ObserverTask& task) {
  MatrixXd C(sampled.C.rows(), sampled.C.cols() + std::ssize(task.carry));
  C << sampled.C, chosen_columns(sampled.fault_outputs, task.carry);
  return C;
}

// Disturbances that act on states only: T takes nothing else out.
std::vector<std::size_t> state_disturbances(const ObserverPlant& sampled) {
  std::vector<std::size_t> indices;
  for (Index j = 0; j < sampled.disturbance_states.cols(); ++j) {
    if (sampled.disturbance_outputs.col(j).isZero(0.0) &&
        !sampled.disturbance_states.col(j).isZero(0.0)) {
      indices.push_back(static_cast<std::size_t>(j));
    }
  }
  return indices;
}

// One way of decoupling, and which disturbances no longer reach the error.
struct DecouplingWay {
  DecouplingMatrices matrices;
  std::vector<std::size_t> decoupled;
};

DecouplingWay way_of(const ObserverPlant& sampled, const ObserverTask& task, const MatrixXd& D_1) {
  const MatrixXd C = augmented_outputs(sampled, task);
  DecouplingWay way{decoupling_matrices(D_1, C), {}};
  const MatrixXd D = with_rows(sampled.disturbance_states, C.cols());
  const std::vector<std::size_t> candidates = state_disturbances(sampled);
  for (const std::size_t j : annihilated_columns(way.matrices.S, D)) {
    if (std::find(candidates.begin(), candidates.end(), j) != candidates.end()) {
      way.decoupled.push_back(j);
    }
  }
  return way;
}

MatrixXd required_directions(const PlantModel& plant, const BankRequest& request,
                             const ObserverPlant& sampled, const ObserverTask& task) {
  const std::vector<std::size_t> required =
      disturbance_indices(plant, request, "decouple", request.decouple);
  const MatrixXd C = augmented_outputs(sampled, task);
  const MatrixXd D = with_rows(chosen_columns(sampled.disturbance_states, required), C.cols());
  const DecouplableDirections split = split_decouplable(D, C);
  const bool acts_on_outputs = !chosen_columns(sampled.disturbance_outputs, required).isZero(0.0);
  if (split.D_2.cols() > 0 || acts_on_outputs) {
    throw request_error(
        request, "decouple",
        fmt::format(
            "found {}, expected disturbances that an unknown-input observer can decouple: {}",
            fmt::join(request.decouple, ", "),
            acts_on_outputs
                ? "one of them acts on the outputs themselves"
                : "rank(C D) must be rank(D), but a part of them reaches no output within "
                  "one sample; leave it out and give it a `bound`"));
  }
  return split.D_1;
}

std::vector<DecouplingWay> ways_of(const PlantModel& plant, const BankRequest& request,
                                   const ObserverPlant& sampled, const ObserverTask& task,
                                   const ObserverRequest& asked) {
  const MatrixXd required = required_directions(plant, request, sampled, task);
  const MatrixXd C = augmented_outputs(sampled, task);
  const MatrixXd all =
      with_rows(chosen_columns(sampled.disturbance_states, state_disturbances(sampled)), C.cols());
  const MatrixXd full = split_decouplable(all, C).D_1;
  if (asked.decoupling == DecouplingChoice::kFull && full.cols() == 0) {
    throw request_error(
        request, "uio",
        "decoupling: found \"full\", expected \"best\" or \"none\": no direction of "
        "the plant's disturbances reaches the outputs within one sample "
        "(rank(C D) = 0), so none can be decoupled");
  }
  std::vector<DecouplingWay> ways;
  if (asked.decoupling != DecouplingChoice::kNone && full.cols() > 0) {
    ways.push_back(way_of(sampled, task, full));
  }
  if (asked.decoupling == DecouplingChoice::kNone || full.cols() == 0 ||
      (asked.decoupling == DecouplingChoice::kBest && required.cols() < full.cols())) {
    ways.push_back(way_of(sampled, task, required));
  }
  return ways;
}

// τ without the drifts of carried faults, the last entries of w: without a fault there is none.
double healthy_tau(const ObserverSynthesis& synthesis, const ObserverModel& model, Index carried) {
  const Index others = model.w_bound.size() - carried;
  const VectorXd mu = synthesis.mu_now + synthesis.mu_next + synthesis.mu_direct;
  return mu.head(others).dot(model.w_bound.head(others).cwiseAbs2());
}

// A trial and, if it came to something, its observer.
struct Outcome {
  ObserverTrial trial;
  std::optional<DesignedObserver> observer;
  double rank = std::numeric_limits<double>::infinity();  // the smallest is the best
};

class Chooser {
 public:
  Chooser(const PlantModel& plant, const BankRequest& request, const ObserverPlant& sampled,
          const ObserverTask& task, const ObserverRequest& asked, ObserverPurpose purpose)
      : plant_(plant),
        request_(request),
        sampled_(sampled),
        task_(task),
        asked_(asked),
        purpose_(purpose),
        band_{request.uio.band_low_rad, request.uio.band_high_rad} {}

  void run(const std::function<void()>& step) {
    for (const DecouplingWay& way : ways_of(plant_, request_, sampled_, task_, asked_)) {
      const ObserverModel model = observer_model(plant_, request_, sampled_, task_, way.decoupled);
      const std::string limit = structural_limit(model, way);
      if (!limit.empty()) {
        Outcome refused{trial_of(way, 0.0), {}};
        refused.trial.status = SynthesisStatus::kInfeasible;
        refused.trial.reason = limit;
        outcomes_.push_back(std::move(refused));
        continue;
      }
      attempt_all(model, way, step);
    }
  }

  ObserverChoice take(std::string name) {
    ObserverChoice choice;
    choice.report.name = std::move(name);
    const auto best =
        std::min_element(outcomes_.begin(), outcomes_.end(),
                         [](const Outcome& a, const Outcome& b) { return a.rank < b.rank; });
    if (best != outcomes_.end() && best->observer) {
      best->trial.is_chosen = true;
      choice.observer = std::move(best->observer);
      choice.report.exists = true;
    }
    for (Outcome& outcome : outcomes_) choice.report.trials.push_back(std::move(outcome.trial));
    return choice;
  }

 private:
  [[nodiscard]] bool uses_h_minus() const {
    return purpose_ == ObserverPurpose::kDetect && request_.uio.is_h_minus;
  }

  [[nodiscard]] ObserverTrial trial_of(const DecouplingWay& way, double alpha) const {
    ObserverTrial trial;
    trial.alpha = alpha;
    for (const std::size_t j : way.decoupled) {
      trial.decoupled.push_back(plant_.disturbances[j].name);
    }
    return trial;
  }

  [[nodiscard]] std::string structural_limit(const ObserverModel& model,
                                             const DecouplingWay& way) const {
    const bool is_decoupling = way.matrices.D_1.cols() > 0;
    if (const auto mode = fixed_mode(model, way.matrices)) {
      return fixed_mode_text(*mode, is_decoupling);
    }
    if (purpose_ == ObserverPurpose::kEstimate) return "";
    if (is_decoupling && !(way.matrices.T * model.F_y).isZero(kRankTolerance)) {
      return "decoupling takes in outputs that a fault to be detected acts on: leave that fault "
             "out "
             "of `detect`, or do not decouple";
    }
    if (!uses_h_minus()) return "";
    if (const auto hidden = hidden_fault(model, way.matrices, band_)) {
      return hidden_fault_text(plant_, task_, *hidden, is_decoupling);
    }
    return "";
  }

  [[nodiscard]] ObserverOutput output_of(const ObserverModel& model) const {
    if (purpose_ == ObserverPurpose::kDetect) return output_error(model);
    const Index carried = std::ssize(task_.carry);
    ObserverOutput output{MatrixXd::Zero(carried, model.n()),
                          MatrixXd::Zero(carried, model.M.cols()),
                          MatrixXd::Zero(carried, model.F_x.cols())};
    output.R.rightCols(carried).setIdentity();
    return output;
  }

  // One outcome per alpha: the best of the candidates there, by what decides at run time.
  void attempt_all(const ObserverModel& model, const DecouplingWay& way,
                   const std::function<void()>& step) {
    const ObserverOutput output = output_of(model);
    const ObserverSearch search = search_with_multipliers(model, way, output, step);
    for (const double alpha : asked_.alpha) {
      Outcome best{trial_of(way, alpha), {}};
      for (const ObserverCandidate& candidate : search.candidates) {
        if (candidate.multipliers.alpha != alpha) continue;
        Outcome outcome = judged(model, way, output, candidate);
        if (!best.observer || outcome.rank < best.rank) best = std::move(outcome);
      }
      if (best.trial.status != SynthesisStatus::kSolved) explain(search, best.trial);
      outcomes_.push_back(std::move(best));
    }
  }

  // Multipliers that were asked for are tried, all of them; else they are searched.
  [[nodiscard]] ObserverSearch search_with_multipliers(const ObserverModel& model,
                                                       const DecouplingWay& way,
                                                       const ObserverOutput& output,
                                                       const std::function<void()>& step) const {
    const UioRequest& uio = request_.uio;
    ObserverSearchOptions options;
    options.alphas = asked_.alpha;
    if (!uio.a_0.empty()) options.a_0s = uio.a_0;
    options.weight = uio.is_weight_full ? ResidualWeight::kFull : ResidualWeight::kScalar;
    options.on_attempt = [&](std::size_t) { step(); };
    const auto band = uses_h_minus() ? std::optional(band_) : std::nullopt;
    if (!uses_h_minus() || uio.v.empty()) {
      return search_observer(model, way.matrices, output, band, options);
    }
    ObserverSearch all;
    for (const double v : uio.v) {
      options.smallest_v = options.largest_v = v;
      ObserverSearch found = search_observer(model, way.matrices, output, band, options);
      std::move(found.candidates.begin(), found.candidates.end(),
                std::back_inserter(all.candidates));
      std::move(found.attempts.begin(), found.attempts.end(), std::back_inserter(all.attempts));
    }
    return all;
  }

  [[nodiscard]] Outcome judged(const ObserverModel& model, const DecouplingWay& way,
                               const ObserverOutput& output,
                               const ObserverCandidate& candidate) const {
    Outcome outcome{trial_of(way, candidate.multipliers.alpha), {}};
    ObserverTrial& trial = outcome.trial;
    trial.status = SynthesisStatus::kSolved;
    trial.multipliers = candidate.multipliers;
    trial.objective = candidate.design.objective;
    trial.beta = candidate.design.beta;
    DesignedObserver observer{task_, model, way.matrices, way.decoupled, candidate.bound, band_};
    observer.synthesis.beta = candidate.design.beta;
    trial.j_th = std::sqrt(purpose_ == ObserverPurpose::kDetect
                               ? healthy_tau(observer.synthesis, model, std::ssize(task_.carry))
                               : observer.synthesis.tau);
    judge(observer, output, outcome);
    if (std::isfinite(outcome.rank)) outcome.observer = std::move(observer);
    return outcome;
  }

  // Why no attempt at this alpha came to anything.
  static void explain(const ObserverSearch& search, ObserverTrial& trial) {
    if (!trial.reason.empty()) return;
    std::size_t count = 0;
    for (const ObserverAttempt& attempt : search.attempts) {
      if (attempt.multipliers.alpha != trial.alpha) continue;
      ++count;
      // "No gain" counts only if it is so for all multipliers.
      if (count == 1 || attempt.status != SynthesisStatus::kInfeasible) {
        trial.status = attempt.status;
        trial.reason = attempt.reason;
      }
    }
    if (count > 1) trial.reason += fmt::format(" (the same for all of {} multipliers)", count);
    if (trial.status == SynthesisStatus::kInfeasible) {
      trial.reason += "; a larger alpha asks for less speed, narrower slopes for less robustness";
    }
  }

  void judge(const DesignedObserver& observer, const ObserverOutput& output,
             Outcome& outcome) const {
    ObserverTrial& trial = outcome.trial;
    const ObserverModel& model = observer.model;
    const MatrixXd N = observer.decoupling.S * model.A - observer.synthesis.gain * model.C;
    for (Index v = 0; v < model.vertex_count(); ++v) {
      trial.radius.push_back(spectral_radius(N + observer.decoupling.S * model.vertex(v)));
    }
    const std::optional<VectorXd> component = component_threshold(
        model, observer.decoupling, output, observer.synthesis.gain, std::ssize(task_.carry));
    if (!component) {
      trial.reason =
          "its error may grow through the Lipschitz terms (small gain): narrow the slopes";
      trial.status = SynthesisStatus::kInfeasible;
      return;
    }
    trial.component = *component;
    if (purpose_ == ObserverPurpose::kEstimate) {
      trial.guaranteed = component->maxCoeff();
      outcome.rank = trial.j_th;
      return;
    }
    trial.guaranteed = guaranteed_fault(observer, *component, trial.j_th);
    if (trial.guaranteed > 0.0) {
      outcome.rank = trial.guaranteed;
    } else {
      trial.reason = "a constant fault fades from its residual";
      trial.status = SynthesisStatus::kInfeasible;
    }
  }

  // The largest, over the faults to be detected, of the smallest size that is detected for sure; 0
  // if one of them never is.
  [[nodiscard]] double guaranteed_fault(const DesignedObserver& observer, const VectorXd& component,
                                        double j_th) const {
    const ResidualFilter filter = output_filter(plant_, sampled_, observer, "detection");
    double largest = 0.0;
    for (Index v = 0; v < observer.model.vertex_count(); ++v) {
      const MatrixXd gains = rest_gains(filter, sampled_, observer, v);
      for (const std::size_t j : task_.detect) {
        if (filter.sees[j] != Sensitivity::kSteady) return 0.0;
        const VectorXd g = gains.col(static_cast<Index>(j)) * plant_.faults[j].size;
        const double smallest = request_.uio.is_threshold_quadratic
                                    ? j_th / (observer.synthesis.weight * g).norm()
                                    : component.cwiseQuotient(g.cwiseAbs()).minCoeff();
        largest = std::max(largest, 2.0 * smallest);
      }
    }
    return largest;
  }

  const PlantModel& plant_;
  const BankRequest& request_;
  const ObserverPlant& sampled_;
  const ObserverTask& task_;
  const ObserverRequest& asked_;
  ObserverPurpose purpose_;
  FrequencyBand band_;
  std::vector<Outcome> outcomes_;
};

}  // namespace

std::size_t attempt_count(const ObserverRequest& asked, bool is_searched) {
  // Two ways of decoupling; along v some five attempts for each of three a_0.
  constexpr std::size_t kWays = 2;
  constexpr std::size_t kAttemptsPerAlpha = 15;
  return kWays * asked.alpha.size() * (is_searched ? kAttemptsPerAlpha : 1);
}

ObserverChoice choose_observer(const PlantModel& plant, const BankRequest& request,
                               const ObserverPlant& sampled, const ObserverTask& task,
                               const ObserverRequest& asked, ObserverPurpose purpose,
                               const std::function<void()>& step) {
  Chooser chooser(plant, request, sampled, task, asked, purpose);
  chooser.run(step);
  return chooser.take(purpose == ObserverPurpose::kDetect ? "detection" : "estimation");
}

}  // namespace faultline
