#include "tools/observer_print.h"

#include <algorithm>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <nlohmann/json.hpp>

#include "tools/bank_print.h"
#include "tools/wrapped_text.h"

namespace faultline {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::size_t kNameWidth = 20;

std::string decoupled_text(const ObserverTrial& trial) {
  return trial.decoupled.empty() ? "nothing" : fmt::format("{}", fmt::join(trial.decoupled, ", "));
}

std::string status_text(SynthesisStatus status) {
  switch (status) {
    case SynthesisStatus::kSolved:
      return "solved";
    case SynthesisStatus::kInfeasible:
      return "infeasible";
    case SynthesisStatus::kUnbounded:
      return "unbounded";
    case SynthesisStatus::kInaccurate:
      return "undecided";
  }
  return "";
}

// What `guaranteed` says of the observer's kind.
const char* guarantee_heading(const ObserverReport& report) {
  return report.name == "estimation" ? "bound" : "sure from";
}

void print_trial(std::FILE* out, const ObserverTrial& trial) {
  fmt::print(out, "  {} {:<{}} ", trial.is_chosen ? '>' : ' ', decoupled_text(trial), kNameWidth);
  const std::string alpha = trial.alpha > 0.0 ? fmt::format("{:g}", trial.alpha) : "any";
  if (trial.status != SynthesisStatus::kSolved) {
    fmt::print(out, "{:>6}   {}:\n", alpha, status_text(trial.status));
    print_wrapped(out, trial.reason);
    return;
  }
  fmt::print(out, "{:>6} {:>10.4g} {:>10} {:>10.4g} {:>9.4f} {:>10.4g}\n", alpha, trial.objective,
             trial.beta > 0.0 ? fmt::format("{:.4g}", trial.beta) : "-", trial.j_th,
             *std::max_element(trial.radius.begin(), trial.radius.end()), trial.guaranteed);
}

std::vector<double> numbers(const Eigen::VectorXd& values) {
  return {values.begin(), values.end()};
}

Json trial_json(const ObserverTrial& trial) {
  Json json{{"decouples", trial.decoupled},
            {"alpha", trial.alpha > 0.0 ? Json(trial.alpha) : Json(nullptr)},
            {"status", status_text(trial.status)},
            {"chosen", trial.is_chosen}};
  if (trial.status != SynthesisStatus::kSolved) {
    json["reason"] = trial.reason;
    return json;
  }
  json["objective"] = trial.objective;
  json["beta"] = trial.beta;
  json["j_th"] = trial.j_th;
  json["radius"] = trial.radius;
  json["component_threshold"] = numbers(trial.component);
  json["guaranteed"] = trial.guaranteed;
  if (trial.beta > 0.0) {
    const bool is_response = trial.multipliers.direction == ReferenceDirection::kFaultResponse;
    json["multipliers"] = {{"a_0", trial.multipliers.a_0},
                           {"v", trial.multipliers.v},
                           {"direction", is_response ? "fault_response" : "fault_input"}};
  }
  return json;
}

void print_sizes(std::FILE* out, const char* what, const Bank& bank,
                 const std::vector<double>& sizes) {
  std::vector<std::string> parts;
  for (std::size_t j = 0; j < sizes.size(); ++j) {
    if (sizes[j] > 0.0) parts.push_back(fmt::format("{} {:.4g}", bank.fault_names[j], sizes[j]));
  }
  fmt::print(out, "    {:<26} {}\n", what,
             parts.empty() ? "none" : fmt::format("{}", fmt::join(parts, ", ")));
}

void print_proof(std::FILE* out, const Bank& bank, const ResidualFilter& filter) {
  const ObserverCertificate& proof = *filter.observer;
  fmt::print(out, "\n  {}: proved\n", filter.name);
  fmt::print(out, "    {:<26} {}\n", "spectral radii (vertices)",
             fmt::format("{:.4f}", fmt::join(proof.vertex_radius, ", ")));
  if (proof.beta > 0.0) {
    fmt::print(out, "    {:<26} {:.4g} for {} in {:g} .. {:g} rad per sample\n", "beta", proof.beta,
               join_names(bank.fault_names, proof.detects), proof.band_low_rad,
               proof.band_high_rad);
  }
  const ThresholdCourse& course = *filter.course;
  if (course.norm.size() > 0) {
    fmt::print(out, "    {:<26} {:.4g} in the end, from {:.4g} at the start{}\n",
               "J_th (quadratic)", course.norm[course.norm.size() - 1], course.norm[0],
               filter.evaluation == Evaluation::kNorm ? "; fires on it" : "");
    if (proof.beta > 0.0) {
      fmt::print(out, "    {:<26} {:.4g}\n", "J_th / beta",
                 course.norm[course.norm.size() - 1] / proof.beta);
    }
  }
  if (course.component.rows() > 0) {
    const Eigen::VectorXd limit = course.component.row(course.component.rows() - 1).transpose();
    fmt::print(out, "    {:<26} {}{}\n", "thresholds by component",
               fmt::format("{:.4g}", fmt::join(numbers(limit), ", ")),
               filter.evaluation == Evaluation::kComponent ? "; fires on them" : "");
  }
  print_sizes(out, "fault at the threshold", bank, proof.nominal_fault);
  print_sizes(out, "fault detected for sure", bank, proof.guaranteed_fault);
  if (filter.transient_samples > 0) {
    fmt::print(out, "    {:<26} {} samples: what fires longer is another fault\n",
               "a carried fault fades in", filter.transient_samples);
  }
  if (filter.estimation) {
    fmt::print(out, "    {:<26} within {:.4g} after {} samples, while it is constant\n",
               fmt::format("size of {}", bank.fault_names[filter.estimation->fault]),
               filter.estimation->bound, filter.estimation->settle_samples);
  }
}

}  // namespace

void print_observers(std::FILE* out, const DesignResult& result) {
  for (const ObserverReport& report : result.observers) {
    fmt::print(out, "\n  {}: {}\n", report.name,
               report.exists ? "what was tried, and taken (>)" : "NO observer does it");
    fmt::print(out, "    {:<{}} {:>6} {:>10} {:>10} {:>10} {:>9} {:>10}\n", "decouples", kNameWidth,
               "alpha", "J_th/beta", "beta", "J_th", "radius", guarantee_heading(report));
    for (const ObserverTrial& trial : report.trials) print_trial(out, trial);
  }
}

void print_observer_proofs(std::FILE* out, const Bank& bank) {
  for (const ResidualFilter& filter : bank.filters) {
    if (filter.observer && filter.course) print_proof(out, bank, filter);
  }
}

Json observer_filters_json(const Bank& bank) {
  Json list = Json::array();
  for (const ResidualFilter& filter : bank.filters) {
    if (!filter.observer || !filter.course) continue;
    const ObserverCertificate& proof = *filter.observer;
    const ThresholdCourse& course = *filter.course;
    Json json{{"name", filter.name},
              {"alpha", proof.alpha},
              {"beta", proof.beta},
              {"vertex_radius", proof.vertex_radius},
              {"nominal_fault", proof.nominal_fault},
              {"guaranteed_fault", proof.guaranteed_fault},
              {"transient_samples", filter.transient_samples},
              {"forget_samples", filter.forget_samples}};
    if (course.norm.size() > 0) json["j_th"] = course.norm[course.norm.size() - 1];
    if (course.component.rows() > 0) {
      json["component_threshold"] =
          numbers(course.component.row(course.component.rows() - 1).transpose());
    }
    if (filter.estimation) {
      json["estimates"] = bank.fault_names[filter.estimation->fault];
      json["estimate_bound"] = filter.estimation->bound;
      json["settle_samples"] = filter.estimation->settle_samples;
    }
    list.push_back(std::move(json));
  }
  return list;
}

Json observers_json(const DesignResult& result) {
  Json list = Json::array();
  for (const ObserverReport& report : result.observers) {
    Json trials = Json::array();
    for (const ObserverTrial& trial : report.trials) trials.push_back(trial_json(trial));
    list.push_back({{"name", report.name}, {"exists", report.exists}, {"trials", trials}});
  }
  return list;
}

}  // namespace faultline
