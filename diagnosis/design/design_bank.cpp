#include "diagnosis/design/design_bank.h"

#include <algorithm>
#include <cmath>
#include <set>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "diagnosis/design/geometric.h"
#include "diagnosis/design/residual_response.h"
#include "diagnosis/model/digest.h"
#include "diagnosis/model/discretize.h"
#include "diagnosis/model/toml_reader.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using FaultSet = std::vector<std::size_t>;
using Poles = std::vector<std::complex<double>>;

// A bad sample is forgotten when what is left of it stays below this part of the threshold.
constexpr double kForgotten = 0.01;
// Longest time a bad sample may be distrusted; a filter slower than that is distrusted this long
// (at 1 kHz a quarter of an hour).
constexpr std::uint32_t kMaxForgetSamples = 1'000'000;
// Columns of G below this part of B's are rounding errors of exact zeros.
constexpr double kRoundingError = 1e-13;

// The plant in the domain of the design.
struct DesignModel {
  MatrixXd A, B, C, D;
  Directions faults;
  Directions decoupled;
  bool is_sampled = false;
};

// ---------------------------------------------------------------------------------- the request

void check_poles(const BankRequest& request) {
  const bool is_sampled = request.domain == DesignDomain::kSampled;
  if (request.poles.empty()) {
    throw request_error(request, "poles", "found no pole, expected at least one");
  }
  for (std::size_t i = 0; i < request.poles.size(); ++i) {
    const std::complex<double> pole = request.poles[i];
    if (is_sampled ? std::abs(pole) >= 1.0 : pole.real() >= 0.0) {
      throw request_error(request, "poles",
                          fmt::format("found {}{:+}i, expected {}", pole.real(), pole.imag(),
                                      is_sampled ? "poles inside the unit circle (domain = "
                                                   "\"sampled\": z plane)"
                                                 : "negative real parts"));
    }
    if (pole.imag() == 0.0) {
      continue;
    }
    if (i + 1 == request.poles.size() || request.poles[i + 1] != std::conj(pole)) {
      throw request_error(request, "poles",
                          fmt::format("found {}{:+}i alone, expected its conjugate behind it",
                                      pole.real(), pole.imag()));
    }
    ++i;
  }
}

void check_time(const PlantModel& plant, const BankRequest& request) {
  if (!(request.sample_time_s > 0.0)) {
    throw request_error(request, "sample_time_s",
                        fmt::format("found {}, expected a positive number", request.sample_time_s));
  }
  if (plant.time == TimeDomain::kContinuous) {
    return;
  }
  if (request.domain != DesignDomain::kSampled) {
    throw request_error(request, "domain",
                        "found \"continuous\", expected \"sampled\": the plant is discrete");
  }
  if (request.sample_time_s != plant.sample_time_s) {
    throw request_error(request, "sample_time_s",
                        fmt::format("found {}, expected the discrete plant's own, {}",
                                    request.sample_time_s, plant.sample_time_s.value_or(0.0)));
  }
}

void check_concurrent(const PlantModel& plant, const BankRequest& request) {
  const std::size_t fault_count = plant.faults.size();
  if (fault_count == 0) {
    throw request_error(request, "plant",
                        fmt::format("found plant \"{}\" without faults, expected some under "
                                    "[faults] or [[fault]]",
                                    plant.name));
  }
  if (request.concurrent < 1 || request.concurrent >= fault_count) {
    throw request_error(
        request, "concurrent",
        fmt::format("found {}, expected at least 1 and less than the plant's {} faults: a residual "
                    "that ignores all of them sees none",
                    request.concurrent, fault_count));
  }
  // There are fewer residuals than fault sets; see kMaxDecisionWords.
  const std::size_t set_count = fault_set_count(fault_count, request.concurrent);
  if (set_count > kMaxDecisionWords / (set_count / 64 + 1)) {
    throw request_error(request, "concurrent",
                        fmt::format("found {} of {} faults at one time, expected fewer: the "
                                    "decision table would not fit",
                                    request.concurrent, fault_count));
  }
}

void check_request(const PlantModel& plant, const BankRequest& request) {
  if (request.method != "geometric") {
    throw request_error(request, "method",
                        fmt::format("found \"{}\", expected \"geometric\"", request.method));
  }
  check_concurrent(plant, request);
  check_poles(request);
  check_time(plant, request);
  if (!(request.threshold > 0.0)) {
    throw request_error(
        request, "decision",
        fmt::format("found threshold {}, expected a positive number", request.threshold));
  }
}

// ---------------------------------------------------------------------------------- the model

Directions fault_directions(const PlantModel& plant) {
  const auto count = std::ssize(plant.faults);
  Directions directions{MatrixXd(plant.n(), count), MatrixXd(plant.q(), count)};
  Index j = 0;
  for (const Fault& fault : plant.faults) {
    directions.state.col(j) = fault.state;
    directions.output.col(j++) = fault.output;
  }
  return directions;
}

Directions decoupled_disturbances(const PlantModel& plant, const BankRequest& request) {
  const auto count = std::ssize(request.decouple);
  Directions directions{MatrixXd(plant.n(), count), MatrixXd(plant.q(), count)};
  std::vector<std::string> names;
  for (const Disturbance& disturbance : plant.disturbances) {
    names.push_back(disturbance.name);
  }
  Index j = 0;
  for (const std::string& name : request.decouple) {
    const auto found = std::find(names.begin(), names.end(), name);
    if (found == names.end()) {
      const std::optional<std::string> near = nearest_name(name, names);
      throw request_error(
          request, "decouple",
          fmt::format("found \"{}\", expected names of the plant's disturbances{}", name,
                      near ? fmt::format("; did you mean \"{}\"?", *near) : ""));
    }
    const Disturbance& disturbance =
        plant.disturbances[static_cast<std::size_t>(found - names.begin())];
    directions.state.col(j) = disturbance.state;
    directions.output.col(j++) = disturbance.output;
  }
  return directions;
}

// All inputs of the sampled plant are held over a sample, faults and disturbances too.
void sample(DesignModel& model, double sample_time_s) {
  const Index m = model.B.cols();
  const Index k = model.faults.state.cols();
  const Index l = model.decoupled.state.cols();
  MatrixXd inputs(model.A.rows(), m + k + l);
  inputs << model.B, model.faults.state, model.decoupled.state;
  const SampledSystem sampled = discretize_zoh(model.A, inputs, sample_time_s);
  model.A = sampled.A;
  model.B = sampled.B.leftCols(m);
  model.faults.state = sampled.B.middleCols(m, k);
  model.decoupled.state = sampled.B.rightCols(l);
}

DesignModel design_model(const PlantModel& plant, const BankRequest& request) {
  DesignModel model{plant.A,
                    plant.B,
                    plant.C,
                    plant.D,
                    fault_directions(plant),
                    decoupled_disturbances(plant, request),
                    request.domain == DesignDomain::kSampled};
  if (model.is_sampled && plant.time == TimeDomain::kContinuous) {
    sample(model, request.sample_time_s);
  }
  return model;
}

Directions ignored_directions(const DesignModel& model, const FaultSet& ignores) {
  const auto count = std::ssize(ignores);
  const Index l = model.decoupled.state.cols();
  Directions directions{MatrixXd(model.A.rows(), count + l), MatrixXd(model.C.rows(), count + l)};
  Index i = 0;
  for (const std::size_t j : ignores) {
    directions.state.col(i) = model.faults.state.col(static_cast<Index>(j));
    directions.output.col(i++) = model.faults.output.col(static_cast<Index>(j));
  }
  directions.state.rightCols(l) = model.decoupled.state;
  directions.output.rightCols(l) = model.decoupled.output;
  return directions;
}

// ---------------------------------------------------------------------------------- names, sets

// All sets of p of k faults, lexicographic.
std::vector<FaultSet> combinations(std::size_t k, std::size_t p) {
  std::vector<FaultSet> sets;
  std::vector<bool> is_chosen(k, false);
  std::fill_n(is_chosen.begin(), p, true);
  do {
    FaultSet set;
    for (std::size_t j = 0; j < k; ++j) {
      if (is_chosen[j]) {
        set.push_back(j);
      }
    }
    sets.push_back(set);
  } while (std::prev_permutation(is_chosen.begin(), is_chosen.end()));
  return sets;
}

// "r12"; "r1_12" where fault numbers have two digits.
std::string residual_name(const FaultSet& ignores, std::size_t fault_count) {
  std::vector<std::size_t> numbers;
  for (const std::size_t j : ignores) {
    numbers.push_back(j + 1);
  }
  return fmt::format("r{}", fmt::join(numbers, fault_count < 10 ? "" : "_"));
}

Poles poles_of(const BankRequest& request, const std::string& name, Index d) {
  const auto count = static_cast<std::size_t>(d);
  if (request.poles.size() == 1) {
    return Poles(count, request.poles.front());
  }
  if (request.poles.size() < count) {
    throw request_error(request, "poles",
                        fmt::format("found {} poles, expected {}: residual {} has order {}",
                                    request.poles.size(), count, name, count));
  }
  const Poles poles(request.poles.begin(), request.poles.begin() + d);
  const auto complex_count = std::count_if(poles.begin(), poles.end(),
                                           [](const auto& pole) { return pole.imag() != 0.0; });
  if (complex_count % 2 != 0) {  // pairs stand together: only the last one can be split
    throw request_error(request, "poles",
                        fmt::format("residual {} has order {}, and the first {} poles split the "
                                    "complex pair {}{:+}i, expected a real pole there",
                                    name, count, count, poles.back().real(), poles.back().imag()));
  }
  return poles;
}

// ---------------------------------------------------------------------------------- one residual

// A residual in the domain of the design: the quotient, its filter and how it sees the faults.
struct DesignedResidual {
  GeometricQuotient quotient;
  MatrixXd F, E, G;
  std::vector<Sensitivity> sees;
  std::vector<double> margin;
  std::vector<double> gain;  // DC, per fault size; of the transient-only ones: 0
  std::vector<double> peak;  // of the transient-only ones, per fault size
};

ResidualResponse response_to(const DesignedResidual& residual, const DesignModel& model, Index j) {
  const GeometricQuotient& quotient = residual.quotient;
  return {residual.F, quotient.M,
          quotient.P * model.faults.state.col(j) + residual.E * model.faults.output.col(j),
          quotient.H * model.faults.output.col(j), model.is_sampled};
}

// Distance of a fault's direction from what the residual ignores, relative to the direction:
// ‖b_j - Π_S b_j‖ / ‖b_j‖; with an output part ‖[P L_j + E_0 D_j; H D_j]‖ / ‖[L_j; D_j]‖.
double margin_of(const GeometricQuotient& quotient, const Directions& directions, Index j) {
  const VectorXd state =
      quotient.P * directions.state.col(j) + quotient.E_0 * directions.output.col(j);
  const VectorXd output = quotient.H * directions.output.col(j);
  const double size = std::hypot(directions.state.col(j).norm(), directions.output.col(j).norm());
  return size > 0.0 ? std::hypot(state.norm(), output.norm()) / size : 0.0;
}

// Margins of all faults; whether one that is not ignored can be seen at all. Needs no poles.
bool find_margins(const DesignModel& model, const FaultSet& ignores, DesignedResidual& residual) {
  bool is_any_seen = false;
  for (Index j = 0; j < model.faults.state.cols(); ++j) {
    residual.margin.push_back(margin_of(residual.quotient, model.faults, j));
    const bool is_ignored =
        std::find(ignores.begin(), ignores.end(), static_cast<std::size_t>(j)) != ignores.end();
    is_any_seen = is_any_seen || (!is_ignored && residual.margin.back() > kRankTolerance);
  }
  return is_any_seen;
}

void find_sensitivities(const PlantModel& plant, const DesignModel& model, const FaultSet& ignores,
                        DesignedResidual& residual) {
  const std::size_t fault_count = plant.faults.size();
  residual.sees.assign(fault_count, Sensitivity::kNone);
  residual.gain.assign(fault_count, 0.0);
  residual.peak.assign(fault_count, 0.0);
  for (std::size_t j = 0; j < fault_count; ++j) {
    const bool is_ignored = std::find(ignores.begin(), ignores.end(), j) != ignores.end();
    if (is_ignored || residual.margin[j] <= kRankTolerance) {
      continue;
    }
    const ResidualResponse response = response_to(residual, model, static_cast<Index>(j));
    const double size = plant.faults[j].size;
    residual.gain[j] = size * dc_gain(response);
    residual.sees[j] = residual.gain[j] > 0.0 ? Sensitivity::kSteady : Sensitivity::kTransient;
    if (residual.sees[j] == Sensitivity::kTransient) {
      residual.peak[j] = size * peak_gain(response);
    }
  }
}

// G = P B, with the columns of ignored inputs exactly zero.
MatrixXd input_matrix(const MatrixXd& P, const MatrixXd& B) {
  MatrixXd G = P * B;
  for (Index j = 0; j < B.cols(); ++j) {
    const double floor = kRoundingError * B.col(j).norm();
    G.col(j) = (G.col(j).array().abs() > floor).select(G.col(j), 0.0);
  }
  return G;
}

// 1 / (smallest DC gain seen per fault size; of a transient-only residual the smallest peak).
double normalising_factor(const DesignedResidual& residual) {
  double smallest_gain = std::numeric_limits<double>::infinity();
  double smallest_peak = std::numeric_limits<double>::infinity();
  for (std::size_t j = 0; j < residual.sees.size(); ++j) {
    if (residual.sees[j] == Sensitivity::kSteady) {
      smallest_gain = std::min(smallest_gain, residual.gain[j]);
    } else if (residual.sees[j] == Sensitivity::kTransient) {
      smallest_peak = std::min(smallest_peak, residual.peak[j]);
    }
  }
  return 1.0 / (std::isfinite(smallest_gain) ? smallest_gain : smallest_peak);
}

// Nothing proved yet: diagnosis/certify does that, from plant and filter alone.
FilterCertificate empty_certificate(const PlantModel& plant) {
  const std::vector<double> per_fault(plant.faults.size());
  FilterCertificate certificate;
  certificate.input_gain.resize(plant.input_names.size());
  certificate.disturbance_gain.resize(plant.disturbances.size());
  for (auto* values : {&certificate.fault_gain, &certificate.dc_gain, &certificate.band_gain,
                       &certificate.margin, &certificate.smallest_fault, &certificate.delay_s}) {
    *values = per_fault;
  }
  return certificate;
}

// The filter on ỹ = y - D u in the form that runs. Continuous domain: y by first-order hold,
//   w_k+1 = F_d w_k - E_0 ỹ_k - E_1 ỹ_k+1 + G_d u_k,
// and with v = w + E_1 ỹ:
//   v_k+1 = F_d v_k - (E_0 + F_d E_1) ỹ_k + G_d u_k,  r_k = M v_k - (H + M E_1) ỹ_k.
// With V = P + E_1 C the error e = v - V x sees held faults through L = V L_d + E D_f and J = H
// D_f.
void implement(const DesignModel& model, const DesignedResidual& residual, double sample_time_s,
               double factor, ResidualFilter& filter) {
  filter.M = factor * residual.quotient.M;
  filter.H = factor * residual.quotient.H;
  if (model.is_sampled) {
    filter.F = residual.F;
    filter.E = residual.E;
    filter.G = residual.G;
    filter.L = residual.quotient.P * model.faults.state;
  } else {
    const FirstOrderHoldSystem y_path = discretize_foh(residual.F, residual.E, sample_time_s);
    filter.F = y_path.A;
    filter.E = y_path.B_0 + y_path.A * y_path.B_1;
    filter.G = discretize_zoh(residual.F, residual.G, sample_time_s).B;
    filter.H += filter.M * y_path.B_1;
    const MatrixXd V = residual.quotient.P + y_path.B_1 * model.C;
    filter.L = V * discretize_zoh(model.A, model.faults.state, sample_time_s).B;
  }
  filter.L += filter.E * model.faults.output;
  filter.J = filter.H * model.faults.output;
  filter.G += filter.E * model.D;
  filter.K = filter.H * model.D;
}

bool is_finite(const ResidualFilter& filter) {
  const auto matrices = {&filter.F, &filter.E, &filter.G, &filter.M,
                         &filter.H, &filter.K, &filter.L, &filter.J};
  return std::all_of(matrices.begin(), matrices.end(),
                     [](const MatrixXd* matrix) { return matrix->allFinite(); });
}

// First j from which ‖M F^i‖ ρ stays below kForgotten τ for all i >= j, ρ being the largest state
// error that a bad sample or an unknown start leaves: the channels' ranges themselves, or what E
// and G make of them.
std::uint32_t forget_samples(const PlantModel& plant, const ResidualFilter& filter) {
  const VectorXd bad_sample =
      filter.E.cwiseAbs() * plant.output_range + filter.G.cwiseAbs() * plant.input_range;
  // A plant need not have inputs.
  const double largest_range =
      std::max(plant.output_range.maxCoeff(), plant.m() > 0 ? plant.input_range.maxCoeff() : 0.0);
  const double rho = std::max(largest_range, bad_sample.norm());
  const double forgotten = kForgotten * filter.threshold / rho;
  MatrixXd power = MatrixXd::Identity(filter.F.rows(), filter.F.cols());
  double largest_power = 1.0;
  std::uint32_t first = 1;  // the bad sample itself
  for (std::uint32_t i = 1; i < kMaxForgetSamples; ++i) {
    if ((filter.M * power).norm() >= forgotten) {
      first = i + 1;
    }
    power = (filter.F * power).eval();
    largest_power = std::max(largest_power, power.norm());
    // ‖F^(i+t)‖ <= ‖F^i‖ max_t ‖F^t‖, and the maximum lies before the first power below 1.
    if (power.norm() < 1.0 && filter.M.norm() * power.norm() * largest_power < forgotten) {
      return first;
    }
  }
  return kMaxForgetSamples;
}

// ---------------------------------------------------------------------------------- the bank

class BankDesign {
 public:
  BankDesign(const PlantModel& plant, const BankRequest& request)
      : plant_(plant), request_(request), model_(design_model(plant, request)) {
    Bank& bank = result_.bank;
    bank.name = request.name;
    bank.method = request.method;
    bank.plant_name = plant.name;
    bank.plant_digest = plant_digest(plant);
    bank.request_digest = text_digest(request.text);
    bank.domain = request.domain;
    bank.sample_time_s = request.sample_time_s;
    bank.concurrent = request.concurrent;
    bank.input_names = plant.input_names;
    bank.output_names = plant.output_names;
    bank.fault_names = plant.fault_names();
    for (const Fault& fault : plant.faults) {
      bank.fault_sizes.push_back(fault.size);
    }
    for (const Disturbance& disturbance : plant.disturbances) {
      using Treatment = BankDisturbance::Treatment;
      const bool is_decoupled = std::find(request.decouple.begin(), request.decouple.end(),
                                          disturbance.name) != request.decouple.end();
      bank.disturbances.push_back(
          {disturbance.name, is_decoupled ? Treatment::kDecoupled : Treatment::kNone});
    }
    bank.u_operating = plant.u_operating;
    bank.y_operating = plant.y_operating;
    bank.decision = request.decision;
  }

  DesignResult run() {
    for (const FaultSet& ignores : combinations(plant_.faults.size(), request_.concurrent)) {
      add_residual(ignores);
    }
    result_.is_solvable = result_.failing.empty();
    result_.are_signatures_distinct = are_signatures_distinct();
    return std::move(result_);
  }

 private:
  void add_residual(const FaultSet& ignores) {
    DesignedResidual residual;
    residual.quotient =
        geometric_quotient(model_.A, model_.C, ignored_directions(model_, ignores), model_.faults);
    ResidualReport report = report_of(ignores, residual.quotient);
    if (report.rows == 0) {
      report.reason = "every output is moved by what it has to ignore";
    } else if (!find_margins(model_, ignores, residual)) {
      report.reason = "it would see no fault";
    } else {
      complete(report.name, residual);
      find_sensitivities(plant_, model_, ignores, residual);
      const double factor = request_.normalise ? normalising_factor(residual) : 1.0;
      ResidualFilter filter = filter_of(report.name, ignores, residual, factor);
      report.exists = is_finite(filter);
      for (const double gain : residual.gain) {
        report.dc_gain.push_back(factor * gain);
      }
      if (report.exists) {
        result_.bank.filters.push_back(std::move(filter));
      } else {
        residual.sees.clear();
        report.reason =
            "its numbers are not finite: the plant's entries differ too much in size, scale it";
      }
    }
    report.margin = residual.margin;
    note_failures(ignores, residual.sees);
    result_.residuals.push_back(std::move(report));
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
    return report;
  }

  void complete(const std::string& name, DesignedResidual& residual) const {
    const Index d = residual.quotient.P.rows();
    GeometricFilter filter = complete_filter(residual.quotient, poles_of(request_, name, d));
    if (!filter.is_possible) {
      throw request_error(request_, "poles",
                          fmt::format("residual {} has order {}; {}", name, d, filter.reason));
    }
    residual.F = std::move(filter.F);
    residual.E = std::move(filter.E);
    residual.G = input_matrix(residual.quotient.P, model_.B);
  }

  [[nodiscard]] ResidualFilter filter_of(const std::string& name, const FaultSet& ignores,
                                         const DesignedResidual& residual, double factor) const {
    ResidualFilter filter;
    filter.name = name;
    filter.ignores = ignores;
    filter.sees = residual.sees;
    implement(model_, residual, request_.sample_time_s, factor, filter);
    filter.threshold = request_.threshold;
    filter.forget_samples = forget_samples(plant_, filter);
    filter.certificate = empty_certificate(plant_);
    return filter;
  }

  // `sees` is empty if the residual does not exist: then it cannot see any fault.
  void note_failures(const FaultSet& ignores, const std::vector<Sensitivity>& sees) {
    for (std::size_t j = 0; j < plant_.faults.size(); ++j) {
      const bool is_seen = !sees.empty() && sees[j] != Sensitivity::kNone;
      if (!is_seen && std::find(ignores.begin(), ignores.end(), j) == ignores.end()) {
        result_.failing.push_back({ignores, j});
      }
    }
  }

  [[nodiscard]] bool are_signatures_distinct() const {
    std::set<std::vector<bool>> signatures;
    for (std::size_t size = 0; size <= request_.concurrent; ++size) {
      for (const FaultSet& faults : combinations(plant_.faults.size(), size)) {
        std::vector<bool> signature;
        for (const ResidualFilter& filter : result_.bank.filters) {
          signature.push_back(std::any_of(faults.begin(), faults.end(), [&](std::size_t j) {
            return filter.sees[j] != Sensitivity::kNone;
          }));
        }
        if (!signatures.insert(signature).second) {
          return false;
        }
      }
    }
    return true;
  }

  const PlantModel& plant_;
  const BankRequest& request_;
  DesignModel model_;
  DesignResult result_;
};

}  // namespace

DesignResult design_bank(const PlantModel& plant, const BankRequest& request) {
  check_request(plant, request);
  return BankDesign(plant, request).run();
}

}  // namespace faultline
