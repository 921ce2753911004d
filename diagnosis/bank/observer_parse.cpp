#include "diagnosis/bank/observer_parse.h"

#include <algorithm>
#include <array>
#include <numbers>
#include <string>
#include <utility>

#include <fmt/format.h>

namespace faultline {
namespace {

// Bounds against hostile files, above what a plant file may have.
constexpr std::size_t kMaxNonlinearities = 16;  // a certificate has 2^16 vertices
constexpr std::size_t kMaxCoefficients = 32;

std::size_t size_of(Eigen::Index size) { return static_cast<std::size_t>(size); }

void read_polynomial(const JsonCursor& object, NonlinearFunction& function) {
  const std::vector<JsonCursor> at = object.members({"kind", "coefficients", "domain"});
  function.coefficients = at[1].numbers();
  if (function.coefficients.empty() || function.coefficients.size() > kMaxCoefficients) {
    throw at[1].expected(fmt::format("1 to {} numbers", kMaxCoefficients));
  }
  const Eigen::VectorXd domain = at[2].vector(2);
  function.domain_min = domain[0];
  function.domain_max = domain[1];
  if (domain[0] >= domain[1]) {
    throw at[2].error(
        fmt::format("found [{}, {}], expected [smallest, largest]", domain[0], domain[1]));
  }
}

void read_table(const JsonCursor& object, NonlinearFunction& function) {
  const std::vector<JsonCursor> at = object.members({"kind", "at", "value"});
  function.at = at[1].numbers();
  if (function.at.size() < 2) {
    throw at[1].expected("at least 2 numbers");
  }
  for (std::size_t i = 1; i < function.at.size(); ++i) {
    if (function.at[i] <= function.at[i - 1]) {
      throw at[1].elements()[i].expected(fmt::format("more than {} before it", function.at[i - 1]));
    }
  }
  const Eigen::VectorXd value = at[2].vector(function.at.size());
  function.value.assign(value.begin(), value.end());
}

NonlinearFunction read_function(const JsonCursor& object) {
  using enum FunctionKind;
  constexpr std::array kKinds = {kSin,      kCos,        kTanh,       kAtan,
                                 kDeadZone, kSaturation, kPolynomial, kTable};
  const std::optional<JsonCursor> kind = object.member("kind");
  if (!kind) {
    throw object.error("found no \"kind\", expected it");
  }
  NonlinearFunction function;
  function.kind = kKinds[kind->choice(
      {"sin", "cos", "tanh", "atan", "dead_zone", "saturation", "polynomial", "table"})];
  if (function.kind == kPolynomial) {
    read_polynomial(object, function);
  } else if (function.kind == kTable) {
    read_table(object, function);
  } else if (function.kind == kDeadZone || function.kind == kSaturation) {
    function.width = object.members({"kind", "width"})[1].positive();
  } else {
    static_cast<void>(object.members({"kind"}));
  }
  return function;
}

std::vector<FilterNonlinearity> read_nonlinearities(const JsonCursor& list,
                                                    const ResidualFilter& filter) {
  const std::size_t order = size_of(filter.F.rows());
  std::vector<FilterNonlinearity> nonlinearities;
  const std::vector<JsonCursor> elements = list.elements();
  if (elements.size() > kMaxNonlinearities) {
    throw list.expected(fmt::format("at most {}", kMaxNonlinearities));
  }
  for (const JsonCursor& element : elements) {
    const std::vector<JsonCursor> at =
        element.members({"function", "center", "radius", "W", "a_v", "a_y", "a_u"});
    nonlinearities.push_back({read_function(at[0]), at[1].number(), at[2].not_negative(),
                              at[3].vector(order), at[4].vector(order),
                              at[5].vector(size_of(filter.H.cols())),
                              at[6].vector(size_of(filter.K.cols()))});
  }
  return nonlinearities;
}

void refuse_not_positive(const std::vector<JsonCursor>& values) {
  for (const JsonCursor& value : values) {
    static_cast<void>(value.positive());
  }
}

ThresholdCourse read_course(const JsonCursor& object, const ResidualFilter& filter) {
  const std::size_t rows = size_of(filter.H.rows());
  const std::vector<JsonCursor> at = object.members({"weight", "norm", "component"});
  ThresholdCourse course;
  course.weight = at[0].matrix(rows, rows);
  const std::vector<JsonCursor> norm = at[1].elements();
  if (norm.empty()) {
    throw at[1].expected("at least one threshold");
  }
  refuse_not_positive(norm);
  course.norm = at[1].vector(norm.size());
  course.component = at[2].matrix(norm.size(), rows);
  for (const JsonCursor& row : at[2].elements()) {
    refuse_not_positive(row.elements());
  }
  return course;
}

FaultEstimation read_estimation(const JsonCursor& object, const Bank& bank,
                                const ResidualFilter& filter) {
  if (filter.H.rows() != 1) {
    throw object.error(
        fmt::format("found a residual of {} rows, expected one: the estimate", filter.H.rows()));
  }
  const std::vector<JsonCursor> at = object.members({"fault", "bound", "settle_samples"});
  FaultEstimation estimation{at[0].index(bank.fault_names), at[1].positive(), at[2].count(0)};
  if (filter.sees[estimation.fault] != Sensitivity::kSteady) {
    throw at[0].expected("a fault that the residual sees at DC");
  }
  return estimation;
}

Eigen::VectorXd not_negatives(const JsonCursor& list, std::size_t size) {
  const std::vector<double> values = list.not_negatives(size);
  return Eigen::Map<const Eigen::VectorXd>(values.data(), static_cast<Eigen::Index>(size));
}

Eigen::MatrixXd read_symmetric(const JsonCursor& rows, std::size_t size) {
  Eigen::MatrixXd matrix = rows.matrix(size, size);
  if (matrix != matrix.transpose()) {
    throw rows.error("found a matrix that is not symmetric, expected one that is, to the bit");
  }
  return matrix;
}

void refuse_no_band(const JsonCursor& high, const ObserverCertificate& certificate) {
  if (certificate.band_high_rad < certificate.band_low_rad ||
      certificate.band_high_rad > std::numbers::pi) {
    throw high.expected(fmt::format("{} to pi", certificate.band_low_rad));
  }
}

ObserverCertificate read_certificate(const JsonCursor& object, const Bank& bank,
                                     const ResidualFilter& filter) {
  const std::vector<JsonCursor> at =
      object.members({"fault_states", "drift_bound", "T", "gain", "alpha", "P", "mu_now", "mu_next",
                      "mu_direct", "beta", "detects", "band_low_rad", "band_high_rad",
                      "vertex_radius", "nominal_fault", "guaranteed_fault"});
  const std::size_t order = size_of(filter.F.rows());
  const std::size_t q = bank.output_names.size();
  const std::size_t fault_count = bank.fault_names.size();
  ObserverCertificate certificate;
  certificate.fault_states = at[0].indices(bank.fault_names);
  certificate.drift_bound = not_negatives(at[1], certificate.fault_states.size());
  certificate.T = at[2].matrix(order, q);
  certificate.gain = at[3].matrix(order, q);
  certificate.alpha = at[4].positive();
  if (certificate.alpha >= 1.0) {
    throw at[4].expected("a number below 1");
  }
  certificate.P = read_symmetric(at[5], order);
  const std::size_t w_count = at[6].elements().size();
  certificate.mu_now = not_negatives(at[6], w_count);
  certificate.mu_next = not_negatives(at[7], w_count);
  certificate.mu_direct = not_negatives(at[8], w_count);
  certificate.beta = at[9].not_negative();
  certificate.detects = at[10].indices(bank.fault_names);
  certificate.band_low_rad = at[11].not_negative();
  certificate.band_high_rad = at[12].not_negative();
  refuse_no_band(at[12], certificate);
  certificate.vertex_radius = at[13].not_negatives(std::size_t{1} << filter.nonlinearities.size());
  certificate.nominal_fault = at[14].not_negatives(fault_count);
  certificate.guaranteed_fault = at[15].not_negatives(fault_count);
  return certificate;
}

// A filter's `threshold` is the one that holds in the end.
void refuse_other_threshold(const JsonCursor& evaluation, const ResidualFilter& filter) {
  const bool is_norm = filter.evaluation == Evaluation::kNorm;
  if (!is_norm && !filter.course) {
    throw evaluation.error("found \"component\" and no \"course\", expected one");
  }
  if (!filter.course) {
    return;
  }
  const Eigen::VectorXd& norm = filter.course->norm;
  const double last = is_norm ? norm[norm.size() - 1] : 1.0;
  if (filter.threshold != last) {
    throw evaluation.error(fmt::format(
        "found a filter with threshold {}, expected {}: {}", filter.threshold, last,
        is_norm ? "the last of its course's norm" : "residuals are taken relative to the course"));
  }
}

}  // namespace

void read_observer(const JsonCursor& object, const Bank& bank, ResidualFilter& filter) {
  const std::vector<JsonCursor> at =
      object.members({"transient_samples", "nonlinearities", "evaluation"},
                     {"course", "estimation", "certificate"});
  filter.transient_samples = at[0].count(0);
  filter.nonlinearities = read_nonlinearities(at[1], filter);
  filter.evaluation =
      at[2].choice({"norm", "component"}) == 1 ? Evaluation::kComponent : Evaluation::kNorm;
  if (const auto course = object.member("course")) {
    filter.course = read_course(*course, filter);
  }
  refuse_other_threshold(at[2], filter);
  if (const auto estimation = object.member("estimation")) {
    filter.estimation = read_estimation(*estimation, bank, filter);
  }
  if (const auto certificate = object.member("certificate")) {
    filter.observer = read_certificate(*certificate, bank, filter);
  }
}

}  // namespace faultline
