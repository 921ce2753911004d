#include "diagnosis/design/uio/design_uio.h"

#include <algorithm>
#include <string>
#include <utility>

#include <fmt/format.h>

#include "diagnosis/design/empty_bank.h"
#include "diagnosis/design/structure.h"
#include "diagnosis/design/uio/observer_choice.h"

namespace faultline {
namespace {

// Every fault but those that only a sensor has: the actuators and components, as the paper detects.
std::vector<std::size_t> faults_to_detect(const PlantModel& plant, const BankRequest& request) {
  if (!request.uio.detect.empty()) {
    return fault_indices(plant, request, "detect", request.uio.detect);
  }
  std::vector<std::size_t> faults;
  for (std::size_t j = 0; j < plant.faults.size(); ++j) {
    if (plant.faults[j].kind != FaultKind::kSensor) faults.push_back(j);
  }
  if (faults.empty()) {
    throw request_error(request, "uio",
                        "found only sensor faults in the plant and no `detect`, expected the names "
                        "of the faults to be detected");
  }
  return faults;
}

void refuse_overlap(const PlantModel& plant, const BankRequest& request, const ObserverTask& task) {
  for (const std::size_t j : task.carry) {
    if (std::find(task.detect.begin(), task.detect.end(), j) != task.detect.end()) {
      throw request_error(request, "uio",
                          fmt::format("carry: found \"{}\", which is to be detected too, expected "
                                      "other faults: what an observer carries as a state fades "
                                      "from its residual",
                                      plant.faults[j].name));
    }
  }
}

class UioDesign {
 public:
  UioDesign(const PlantModel& plant, const BankRequest& request, const DesignProgress& progress)
      : plant_(plant),
        request_(request),
        progress_(progress),
        sampled_(observer_plant(plant, request)) {
    result_.bank = bank_without_filters(plant, request);
    const UioRequest& uio = request.uio;
    total_ = attempt_count(uio.detection, uio.is_h_minus && uio.v.empty());
    if (!uio.estimation.carry.empty()) total_ += attempt_count(uio.estimation, false);
  }

  DesignResult run() {
    const std::vector<std::size_t> detect = faults_to_detect(plant_, request_);
    const bool detects = add_detection(detect);
    const bool estimates = request_.uio.estimation.carry.empty() || add_estimation();
    if (progress_) progress_(total_, total_);
    result_.indistinguishable =
        indistinguishable_sets(lasting_structure(), plant_.faults.size(), request_.concurrent);
    result_.are_signatures_distinct = result_.indistinguishable.empty();
    result_.is_solvable = detects && estimates;
    DecisionRule& decision = result_.bank.decision;
    decision.window = request_.window.value_or(estimate_window(result_.bank.filters));
    // The detecting observer may forget a fault before the estimating one does: what is left then
    // looks like the fault that is estimated.
    if (decision.clearing == 0) decision.clearing = std::max(decision.settle, decision.window);
    return std::move(result_);
  }

 private:
  [[nodiscard]] ObserverTask task_of(const ObserverRequest& asked, const std::string& key,
                                     const std::vector<std::size_t>& detect) const {
    return {fault_indices(plant_, request_, key, asked.carry), detect,
            asked.drift_per_s * request_.sample_time_s};
  }

  [[nodiscard]] ObserverChoice choose(const ObserverTask& task, const ObserverRequest& asked,
                                      ObserverPurpose purpose) {
    return choose_observer(plant_, request_, sampled_, task, asked, purpose, [this] {
      done_ = std::min(done_ + 1, total_ - 1);  // how many there will be is a guess
      if (progress_) progress_(done_, total_);
    });
  }

  // What an observer sees in transients only has faded when its alarm is judged.
  [[nodiscard]] Structure lasting_structure() const {
    Structure structure;
    for (const ResidualFilter& filter : result_.bank.filters) {
      structure.push_back(filter.sees);
      std::replace(structure.back().begin(), structure.back().end(), Sensitivity::kTransient,
                   Sensitivity::kNone);
    }
    return structure;
  }

  bool add_detection(const std::vector<std::size_t>& detect) {
    const ObserverTask task = task_of(request_.uio.detection, "carry", detect);
    refuse_overlap(plant_, request_, task);
    ObserverChoice choice = choose(task, request_.uio.detection, ObserverPurpose::kDetect);
    result_.observers.push_back(std::move(choice.report));
    if (!choice.observer) return false;
    ResidualFilter filter = output_filter(plant_, sampled_, *choice.observer, "detection");
    filter.evaluation =
        request_.uio.is_threshold_quadratic ? Evaluation::kNorm : Evaluation::kComponent;
    note_decoupled(*choice.observer);
    add(std::move(filter));
    return true;
  }

  bool add_estimation() {
    const ObserverTask task = task_of(request_.uio.estimation, "estimate.faults", {});
    ObserverChoice choice = choose(task, request_.uio.estimation, ObserverPurpose::kEstimate);
    result_.observers.push_back(std::move(choice.report));
    if (!choice.observer) return false;
    note_decoupled(*choice.observer);
    for (std::size_t i = 0; i < task.carry.size(); ++i) {
      add(size_filter(plant_, sampled_, *choice.observer, i,
                      fmt::format("size_{}", plant_.faults[task.carry[i]].name)));
    }
    return true;
  }

  // A disturbance counts as decoupled if no residual of the bank sees it.
  void note_decoupled(const DesignedObserver& observer) {
    using Treatment = BankDisturbance::Treatment;
    for (std::size_t i = 0; i < result_.bank.disturbances.size(); ++i) {
      const bool is_decoupled = std::find(observer.decoupled.begin(), observer.decoupled.end(),
                                          i) != observer.decoupled.end();
      Treatment& treatment = result_.bank.disturbances[i].treatment;
      treatment = is_decoupled && (is_first_ || treatment == Treatment::kDecoupled)
                      ? Treatment::kDecoupled
                      : Treatment::kNone;
    }
    is_first_ = false;
  }

  void add(ResidualFilter filter) {
    filter.certificate = empty_certificate(plant_);
    result_.bank.filters.push_back(std::move(filter));
  }

  const PlantModel& plant_;
  const BankRequest& request_;
  const DesignProgress& progress_;
  ObserverPlant sampled_;
  DesignResult result_;
  bool is_first_ = true;  // no observer is in the bank yet
  std::size_t done_ = 0;
  std::size_t total_ = 0;
};

}  // namespace

DesignResult design_uio_bank(const PlantModel& plant, const BankRequest& request,
                             const DesignProgress& progress) {
  const PlantModel rounded = with_rounded_outputs(
      plant, bank_without_filters(plant, request).thresholds.output_resolution);
  DesignResult result = UioDesign(rounded, request, progress).run();
  result.bank.plant_digest = plant_digest(plant);
  return result;
}

}  // namespace faultline
