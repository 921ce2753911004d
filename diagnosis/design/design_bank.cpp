#include "diagnosis/design/design_bank.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>

#include <Eigen/LU>
#include <fmt/format.h>

#include "diagnosis/design/check_request.h"
#include "diagnosis/design/eigenstructure/eigenstructure_residual.h"
#include "diagnosis/design/empty_bank.h"
#include "diagnosis/design/explain_failure.h"
#include "diagnosis/design/implementation_form.h"
#include "diagnosis/design/requested_poles.h"
#include "diagnosis/design/residual_response.h"
#include "diagnosis/design/structure.h"
#include "diagnosis/design/uio/design_uio.h"
#include "diagnosis/design/whitening.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;

// Entries of G below this part of B's column are rounding errors of exact zeros.
constexpr double kRoundingError = 1e-13;
// What a sequential test usually asks for before it fires: h of a GLR test at 1e-6 per sample. The
// window of one is chosen by it, and the threshold of a test that is not calibrated yet.
constexpr double kUsualEvidence = 20.0;
// A small fault: half a standard deviation of the white residual.
constexpr double kUsualShift = 0.5;
// Below it takes minutes to tell a fault from noise; above a single sample does, and the test is
// tuned to that.
constexpr double kSmallestShift = 0.02;
constexpr double kLargestShift = 20.0;
// A GLR test looks at every sample of its window in each step.
constexpr double kLongestOwnWindow = 2000.0;
// ---------------------------------------------------------------------------------- one residual

// How a residual, in the domain of the design, sees the faults.
struct Sensitivities {
  std::vector<Sensitivity> sees;
  std::vector<double> gain;  // DC, per fault size; of the transient-only ones: 0
  std::vector<double> peak;  // of the transient-only ones, per fault size
};

Sensitivities find_sensitivities(const PlantModel& plant, const DesignModel& model,
                                 const FaultSet& ignores, const GeometricQuotient& quotient,
                                 const GeometricFilter& filter) {
  const std::size_t fault_count = plant.faults.size();
  Sensitivities found{std::vector<Sensitivity>(fault_count, Sensitivity::kNone),
                      std::vector<double>(fault_count), std::vector<double>(fault_count)};
  for (std::size_t j = 0; j < fault_count; ++j) {
    const bool is_ignored = std::find(ignores.begin(), ignores.end(), j) != ignores.end();
    if (is_ignored || quotient.visible_margin[j] <= kRankTolerance) {
      continue;
    }
    const auto column = static_cast<Index>(j);
    const ResidualResponse response{
        filter.F, quotient.M,
        quotient.P * model.faults.state.col(column) + filter.E * model.faults.output.col(column),
        quotient.H * model.faults.output.col(column), model.is_sampled};
    const double size = plant.faults[j].size;
    found.gain[j] = size * dc_gain(response);
    found.sees[j] = found.gain[j] > 0.0 ? Sensitivity::kSteady : Sensitivity::kTransient;
    if (found.sees[j] == Sensitivity::kTransient) {
      found.peak[j] = size * peak_gain(response);
    }
  }
  return found;
}

// G = P B. An input that by the rank decisions cannot be seen is not used at all.
MatrixXd input_matrix(const GeometricQuotient& quotient, const MatrixXd& B) {
  MatrixXd G = quotient.P * B;
  for (Index j = 0; j < B.cols(); ++j) {
    const double size = B.col(j).cwiseQuotient(quotient.units.state).norm();
    if (G.col(j).norm() <= kRankTolerance * size) {
      G.col(j).setZero();
    }
    G.col(j) = (G.col(j).array().abs() > kRoundingError * size).select(G.col(j), 0.0);
  }
  return G;
}

// 1 / (smallest DC gain seen per fault size; of a transient-only residual the smallest peak).
double normalising_factor(const Sensitivities& found) {
  double smallest_gain = std::numeric_limits<double>::infinity();
  double smallest_peak = std::numeric_limits<double>::infinity();
  for (std::size_t j = 0; j < found.sees.size(); ++j) {
    if (found.sees[j] == Sensitivity::kSteady) {
      smallest_gain = std::min(smallest_gain, found.gain[j]);
    } else if (found.sees[j] == Sensitivity::kTransient) {
      smallest_peak = std::min(smallest_peak, found.peak[j]);
    }
  }
  return 1.0 / (std::isfinite(smallest_gain) ? smallest_gain : smallest_peak);
}

// Of the filter as it runs, to constant faults: rows×k.
MatrixXd response_at_rest(const ResidualFilter& filter) {
  const Index d = filter.F.rows();
  return filter.J + filter.M * (MatrixXd::Identity(d, d) - filter.F).partialPivLu().solve(filter.L);
}

// Finite and stable, as it must be but for rounding errors beyond all bounds.
bool is_usable(const ResidualFilter& filter) {
  const auto matrices = {&filter.F, &filter.E, &filter.G, &filter.M,
                         &filter.H, &filter.K, &filter.L, &filter.J};
  return std::all_of(matrices.begin(), matrices.end(),
                     [](const MatrixXd* matrix) { return matrix->allFinite(); }) &&
         spectral_radius(filter.F) < 1.0;
}

// ---------------------------------------------------------------------------------- the bank

class BankDesign {
 public:
  BankDesign(const PlantModel& plant, const BankRequest& request)
      : plant_(plant),
        request_(request),
        model_(design_model(plant, request)),
        explainer_(plant, model_) {
    result_.bank = bank_without_filters(plant, request);
  }

  DesignResult run(const DesignProgress& progress) {
    const std::vector<FaultSet> sets = requested_sets(plant_, request_);
    for (const FaultSet& ignores : sets) {
      add_residual(ignores);
      if (progress) {
        progress(result_.residuals.size(), sets.size());
      }
    }
    const std::size_t fault_count = plant_.faults.size();
    if (request_.structure == StructureChoice::kSmallest) {
      // Why something cannot be told apart, the residuals that ignore p faults say.
      for (const ResidualReport& report : result_.residuals) {
        if (report.ignores.size() == request_.concurrent) {
          note_failures(report);
        }
      }
      keep_smallest();
    } else {
      for (const ResidualReport& report : result_.residuals) {
        note_failures(report);
      }
    }
    result_.indistinguishable =
        indistinguishable_sets(structure(), fault_count, request_.concurrent);
    result_.are_signatures_distinct = result_.indistinguishable.empty();
    if (request_.structure == StructureChoice::kSmallest && result_.are_signatures_distinct) {
      result_.failing.clear();
    }
    result_.is_solvable = result_.failing.empty();
    result_.bank.decision.window = request_.window.value_or(estimate_window(result_.bank.filters));
    return std::move(result_);
  }

 private:
  void add_residual(const FaultSet& ignores) {
    const Directions ignored = ignored_directions(model_, ignores);
    GeometricQuotient quotient = geometric_quotient(model_.A, model_.C, ignored, model_.faults);
    const DimensionStability stability =
        dimension_stability(model_.A, model_.C, ignored, model_.faults, quotient);
    std::optional<GeometricFilter> filter;
    std::string reason;
    if (request_.method == "eigenstructure") {
      EigenstructureResidual assigned = eigenstructure_residual(
          plant_, model_, request_, residual_name(ignores, plant_.faults.size()), ignores);
      quotient = std::move(assigned.quotient);
      filter = std::move(assigned.filter);
      reason = std::move(assigned.reason);
      result_.assignments.push_back(std::move(assigned.report));
    }
    ResidualReport report = report_of(ignores, quotient);
    report.stability = stability;
    report.reason = std::move(reason);
    if (report.rows == 0) {
      report.reason = explainer_.no_residual(ignores) + nearest_thing();
    } else if (report.reason.empty()) {
      report.margin = quotient.visible_margin;
      if (is_any_seen(ignores, quotient)) {
        note_weights(quotient);
        add_filter(quotient, filter, report);
      } else {
        report.reason = "it would see no fault";
      }
    }
    result_.residuals.push_back(std::move(report));
    quotients_.push_back(std::move(quotient));
  }

  void note_weights(const GeometricQuotient& quotient) {
    if (!result_.assignments.empty()) {
      const MatrixXd W = quotient.H.rowwise().normalized();
      result_.assignments.back().W = (W.array().abs() > kRoundingError).select(W, 0.0);
    }
  }

  // What can be done where nothing can be decoupled.
  [[nodiscard]] std::string nearest_thing() const {
    return request_.method == "eigenstructure" && model_.decoupled.state.cols() > 0
               ? "; what cannot be kept out can be kept small: [eigenstructure] weaken instead of "
                 "decouple"
               : "";
  }

  [[nodiscard]] ResidualReport report_of(const FaultSet& ignores,
                                         const GeometricQuotient& quotient) const {
    ResidualReport report;
    report.name = residual_name(ignores, plant_.faults.size());
    report.ignores = ignores;
    report.dim_w = quotient.dim_w;
    report.dim_s = quotient.dim_s;
    report.projector_w = quotient.projector_w;
    report.projector_s = quotient.projector_s;
    report.quotient_dim = quotient.P.rows();
    report.rows = quotient.H.rows();
    report.rank_margin = quotient.margin;
    return report;
  }

  [[nodiscard]] bool is_any_seen(const FaultSet& ignores, const GeometricQuotient& quotient) const {
    for (std::size_t j = 0; j < plant_.faults.size(); ++j) {
      if (quotient.visible_margin[j] > kRankTolerance &&
          std::find(ignores.begin(), ignores.end(), j) == ignores.end()) {
        return true;
      }
    }
    return false;
  }

  void add_filter(const GeometricQuotient& quotient, const std::optional<GeometricFilter>& given,
                  ResidualReport& report) {
    GeometricFilter geometric;
    if (given) {
      geometric = *given;
    } else {
      const PolePlacement placement = requested_placement(request_, report.name, quotient);
      if (!placement.is_possible) {
        report.reason = placement.reason;
        return;
      }
      geometric = complete_filter(quotient, placement);
    }
    const Sensitivities found =
        find_sensitivities(plant_, model_, report.ignores, quotient, geometric);
    const double factor = request_.normalise ? normalising_factor(found) : 1.0;
    const DesignedFilter designed{quotient.P,  geometric.F,
                                  geometric.E, input_matrix(quotient, model_.B),
                                  quotient.M,  quotient.H};
    ResidualFilter filter;
    filter.name = report.name;
    filter.ignores = report.ignores;
    filter.sees = found.sees;
    implement(model_, designed, request_.sample_time_s, factor, filter);
    if (!is_usable(filter)) {
      report.reason =
          "its numbers overflow or are all rounding error: the plant's entries differ too much in "
          "size, scale it";
      return;
    }
    filter.threshold = request_.threshold;
    if (request_.test != TestKind::kComparison) add_test(filter);
    filter.forget_samples = forget_samples(plant_, filter);
    filter.certificate = empty_certificate(plant_);
    report.exists = true;
    report.sees = found.sees;
    for (const double gain : found.gain) {
      report.dc_gain.push_back(factor * gain);
    }
    if (filter.test) {
      const MatrixXd at_rest = response_at_rest(filter);
      for (std::size_t j = 0; j < report.dc_gain.size(); ++j) {
        if (found.sees[j] != Sensitivity::kSteady) continue;
        report.dc_gain[j] = plant_.faults[j].size * at_rest.col(static_cast<Index>(j)).norm();
      }
    }
    const Eigen::VectorXcd poles = eigenvalues(geometric.F);
    report.poles.assign(poles.begin(), poles.end());
    result_.bank.filters.push_back(std::move(filter));
  }

  // The residual becomes white; tuned to the smallest gain of the faults that it sees.
  void add_test(ResidualFilter& filter) const {
    try {
      whiten(plant_, filter);
    } catch (const std::invalid_argument& error) {
      throw request_error(request_, "decision", fmt::format("test: {}", error.what()));
    }
    const MatrixXd at_rest = response_at_rest(filter);
    double smallest = std::numeric_limits<double>::infinity();
    for (std::size_t j = 0; j < filter.sees.size(); ++j) {
      if (filter.sees[j] != Sensitivity::kSteady) continue;
      const double gain = at_rest.col(static_cast<Index>(j)).cwiseAbs().maxCoeff();
      smallest = std::min(smallest, plant_.faults[j].size * gain);
    }
    if (!std::isfinite(smallest)) {
      throw request_error(
          request_, "decision",
          fmt::format("test: {} sees every fault in transients only: there is nothing "
                      "that adds up; expected test = \"comparison\"",
                      filter.name));
    }
    const double shift =
        request_.tuned_for ? std::min(*request_.tuned_for * smallest, kLargestShift) : kUsualShift;
    if (shift < kSmallestShift) {
      throw request_error(
          request_, "decision",
          fmt::format(
              "tuned_for: found {:g}, a shift of {} by {:.3g} standard deviations, expected "
              "at least {:.3g}",
              request_.tuned_for.value_or(0.0), filter.name, shift, kSmallestShift / smallest));
    }
    SequentialTest test{request_.test, 0.5 * shift, 0,
                        std::vector<double>(static_cast<std::size_t>(filter.H.rows()))};
    if (request_.test == TestKind::kGlr) {
      const double samples = std::ceil(2.0 * kUsualEvidence / (shift * shift));
      test.window = request_.glr_window.value_or(
          static_cast<std::uint32_t>(std::clamp(samples, 1.0, kLongestOwnWindow)));
    }
    filter.test = std::move(test);
    if (request_.threshold_kind == ThresholdBasis::Kind::kCalibrated) {
      filter.threshold = kUsualEvidence;
    }
  }

  // Of all residuals that exist, as few as isolate what all of them do.
  void keep_smallest() {
    const ResidualChoice choice =
        smallest_structure(structure(), plant_.faults.size(), request_.concurrent);
    result_.candidate_count = result_.residuals.size();
    result_.is_structure_proved_smallest = choice.is_proved_smallest;
    std::vector<ResidualFilter> filters;
    std::vector<ResidualReport> reports;
    std::vector<GeometricQuotient> quotients;
    for (const std::size_t i : choice.residuals) {
      filters.push_back(std::move(result_.bank.filters[i]));
      for (std::size_t r = 0; r < result_.residuals.size(); ++r) {
        if (result_.residuals[r].name == filters.back().name) {
          reports.push_back(std::move(result_.residuals[r]));
          quotients.push_back(std::move(quotients_[r]));
          break;
        }
      }
    }
    result_.bank.filters = std::move(filters);
    result_.residuals = std::move(reports);
    quotients_ = std::move(quotients);
  }

  void note_failures(const ResidualReport& report) {
    const auto r = static_cast<std::size_t>(&report - result_.residuals.data());
    for (std::size_t j = 0; j < plant_.faults.size(); ++j) {
      const bool is_seen = report.exists && report.sees[j] != Sensitivity::kNone;
      const bool is_ignored =
          std::find(report.ignores.begin(), report.ignores.end(), j) != report.ignores.end();
      if (!is_seen && !is_ignored) {
        result_.failing.push_back({report.ignores, j, why_unseen(report, j, quotients_[r])});
      }
    }
  }

  // What was demanded of an assignment may fail where the plant would allow a residual.
  [[nodiscard]] std::string why_unseen(const ResidualReport& report, std::size_t fault,
                                       const GeometricQuotient& quotient) const {
    const bool is_by_demand =
        request_.method == "eigenstructure" && !report.exists && report.rows > 0;
    return is_by_demand ? report.reason : explainer_.unseen(report.ignores, fault, quotient);
  }

  [[nodiscard]] Structure structure() const {
    Structure structure;
    for (const ResidualFilter& filter : result_.bank.filters) {
      structure.push_back(filter.sees);
    }
    return structure;
  }

  const PlantModel& plant_;
  const BankRequest& request_;
  DesignModel model_;
  FailureExplainer explainer_;
  std::vector<GeometricQuotient> quotients_;  // one per residual of the result
  DesignResult result_;
};

}  // namespace

DesignResult design_bank(const PlantModel& plant, const BankRequest& request,
                         const DesignProgress& progress) {
  check_request(plant, request);
  if (request.method == "uio") {
    return design_uio_bank(plant, request, progress);
  }
  return BankDesign(plant, request).run(progress);
}

}  // namespace faultline
