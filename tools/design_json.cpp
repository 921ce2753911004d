#include "tools/design_json.h"

#include <algorithm>
#include <complex>
#include <vector>

#include <nlohmann/json.hpp>

#include "tools/assignment_print.h"
#include "tools/bank_print.h"
#include "tools/observer_print.h"

namespace faultline {
namespace {

using Json = nlohmann::ordered_json;

Json names_json(const Bank& bank, const std::vector<std::size_t>& faults) {
  Json json = Json::array();
  for (const std::size_t fault : faults) json.push_back(bank.fault_names[fault]);
  return json;
}

Json matrix_json(const Eigen::MatrixXd& matrix) {
  Json rows = Json::array();
  for (Eigen::Index i = 0; i < matrix.rows(); ++i) {
    Json row = Json::array();
    for (Eigen::Index j = 0; j < matrix.cols(); ++j) row.push_back(matrix(i, j));
    rows.push_back(row);
  }
  return rows;
}

Json certificate_json(const FilterCertificate& certificate) {
  const RankCertificate& rank = certificate.rank;
  return {{"spectral_radius", certificate.spectral_radius},
          {"input_gain", certificate.input_gain},
          {"disturbance_gain", certificate.disturbance_gain},
          {"fault_gain", certificate.fault_gain},
          {"dc_gain", certificate.dc_gain},
          {"band_gain", certificate.band_gain},
          {"band_Hz", certificate.band_Hz},
          {"margin", certificate.margin},
          {"smallest_fault", certificate.smallest_fault},
          {"delay_s", certificate.delay_s},
          {"rank",
           {{"dim_w", rank.dim_w},
            {"dim_s", rank.dim_s},
            {"smallest_kept", rank.smallest_kept},
            {"largest_dropped", rank.largest_dropped},
            {"tolerance_min", rank.tolerance_min},
            {"tolerance_max", rank.tolerance_max}}}};
}

Json complex_json(const std::vector<std::complex<double>>& numbers) {
  Json json = Json::array();
  for (const std::complex<double>& number : numbers) json.push_back({number.real(), number.imag()});
  return json;
}

Json shares_json(const ThresholdShares& shares) {
  return {{"disturbance", shares.disturbance}, {"noise", shares.noise},
          {"resolution", shares.resolution},   {"leakage", shares.leakage},
          {"jitter", shares.jitter},           {"gaussian", shares.gaussian}};
}

Json test_json(const SequentialTest& test) {
  return {{"kind", test.kind == TestKind::kCusum ? "cusum" : "glr"},
          {"reference", test.reference},
          {"window", test.window},
          {"offset", test.offset}};
}

void add_filter_json(Json& json, const Bank& bank, const ResidualReport& report,
                     const ResidualFilter& filter) {
  json["responds_to"] = Json::array();
  json["transient_only"] = Json::array();
  json["margins"] = Json::object();
  json["dc_gain"] = Json::object();
  for (std::size_t j = 0; j < bank.fault_names.size(); ++j) {
    const std::string& fault = bank.fault_names[j];
    if (filter.sees[j] != Sensitivity::kNone) json["responds_to"].push_back(fault);
    if (filter.sees[j] == Sensitivity::kTransient) json["transient_only"].push_back(fault);
    json["margins"][fault] = filter.certificate.margin[j];
    json["dc_gain"][fault] = report.dc_gain[j];
  }
  const Eigen::VectorXcd poles = eigenvalues(filter.F);
  json["poles"] = complex_json({poles.begin(), poles.end()});
  json["design_poles"] = complex_json(report.poles);
  json["threshold"] = filter.threshold;
  if (filter.shares) json["threshold_shares"] = shares_json(*filter.shares);
  if (filter.shares && filter.course) {
    const Eigen::RowVectorXd last = filter.course->component.bottomRows(1);
    json["row_thresholds"] = std::vector<double>(last.data(), last.data() + last.size());
  }
  if (filter.test) json["test"] = test_json(*filter.test);
  json["forget_samples"] = filter.forget_samples;
  json["certificate"] = certificate_json(filter.certificate);
}

Json residual_json(const DesignResult& result, const ResidualReport& report) {
  const Bank& bank = result.bank;
  Json json{
      {"name", report.name},
      {"decouples", names_json(bank, report.ignores)},
      {"exists", report.exists},
      {"dim_w", report.dim_w},
      {"dim_s", report.dim_s},
      {"projector_w", matrix_json(report.projector_w)},
      {"projector_s", matrix_json(report.projector_s)},
      {"quotient_dim", report.quotient_dim},
      {"rows", report.rows},
      {"rank_margin",
       {{"smallest_kept", report.rank_margin.smallest_kept},
        {"largest_dropped", report.rank_margin.largest_dropped},
        {"stable_tolerances", {report.stability.tolerance_min, report.stability.tolerance_max}}}}};
  if (!report.reason.empty()) json["reason"] = report.reason;
  const auto filter =
      std::find_if(bank.filters.begin(), bank.filters.end(),
                   [&](const ResidualFilter& entry) { return entry.name == report.name; });
  if (filter != bank.filters.end()) {
    add_filter_json(json, bank, report, *filter);
    return json;
  }
  for (const char* const list : {"responds_to", "transient_only", "poles", "design_poles"}) {
    json[list] = Json::array();
  }
  json["margins"] = Json::object();
  json["dc_gain"] = Json::object();
  json["certificate"] = nullptr;
  return json;
}

Json confusable_json(const Bank& bank) {
  Json json = Json::array();
  for (const ConfusableFaults& set : bank.isolability.confusable) {
    json.push_back(names_json(bank, set.faults));
  }
  return json;
}

// Per confusable set, the weights with which its faults look like none; null if they depend on
// frequency.
Json weights_json(const Bank& bank) {
  Json json = Json::array();
  for (const ConfusableFaults& set : bank.isolability.confusable) {
    json.push_back(set.weights.empty() ? Json(nullptr) : Json(set.weights));
  }
  return json;
}

Json faults_json(const Bank& bank) {
  Json json = Json::object();
  for (std::size_t j = 0; j < bank.fault_names.size(); ++j) {
    const FaultReach reach = fault_reach(bank, j);
    const auto or_null = [](double value) { return value > 0.0 ? Json(value) : Json(nullptr); };
    json[bank.fault_names[j]] = {{"detected_from", or_null(reach.detected_from)},
                                 {"isolated_from", or_null(reach.isolated_from)},
                                 {"detection_delay_s", or_null(reach.detection_delay_s)},
                                 {"isolation_delay_s", or_null(reach.isolation_delay_s)}};
  }
  return json;
}

}  // namespace

Json design_json(const DesignResult& result) {
  const Bank& bank = result.bank;
  Json json{{"name", bank.name}, {"solvable", result.is_solvable}, {"failing", Json::array()}};
  Json reasons = Json::array();
  for (const DesignFailure& failure : result.failing) {
    Json names = names_json(bank, failure.ignores);
    names.push_back(bank.fault_names[failure.fault]);
    json["failing"].push_back(names);
    reasons.push_back({{"ignores", names_json(bank, failure.ignores)},
                       {"fault", bank.fault_names[failure.fault]},
                       {"reason", failure.reason}});
  }
  json["failing_reasons"] = reasons;
  json["signatures_distinct"] = result.are_signatures_distinct;
  json["indistinguishable"] = Json::array();
  for (const std::vector<FaultSet>& group : result.indistinguishable) {
    Json sets = Json::array();
    for (const FaultSet& set : group) sets.push_back(names_json(bank, set));
    json["indistinguishable"].push_back(sets);
  }
  json["strongly_isolable"] = bank.isolability.is_strongly_isolable;
  json["confusable_sets"] = confusable_json(bank);
  json["confusable_weights"] = weights_json(bank);
  json["confusable_list_complete"] = bank.isolability.is_list_complete;
  json["faults"] = faults_json(bank);
  json["residuals"] = Json::array();
  for (const ResidualReport& report : result.residuals) {
    json["residuals"].push_back(residual_json(result, report));
  }
  if (!result.assignments.empty()) json["assignments"] = assignments_json(result);
  if (!result.observers.empty()) {
    json["observers"] = observers_json(result);
    json["observer_filters"] = observer_filters_json(result.bank);
  }
  return json;
}

}  // namespace faultline
