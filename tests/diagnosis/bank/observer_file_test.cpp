// Observers in a bank file: what is read back, and what is refused.

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "diagnosis/bank/bank_file.h"
#include "tests/diagnosis/hou_plant.h"
#include "tests/diagnosis/observer_bank.h"

namespace faultline {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

std::string refusal(const std::string& text) {
  try {
    static_cast<void>(parse_bank(text, "b.json"));
  } catch (const BankFileError& error) {
    return error.what();
  }
  return "";
}

/// Why the bank's own text is refused.
std::string refusal(const Bank& bank) { return refusal(bank_text(bank)); }

/// The bank of two observers after `change`.
template <class Change>
std::string refusal_after(const Change& change) {
  Bank bank = observer_bank();
  change(bank);
  return refusal(bank);
}

/// Its text with the first `from` replaced.
std::string with(const std::string& from, const std::string& to) {
  std::string text = bank_text(observer_bank());
  const std::size_t at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return text.replace(at, from.size(), to);
}

bool same_bits(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b) {
  return a.rows() == b.rows() && a.cols() == b.cols() &&
         std::equal(a.data(), a.data() + a.size(), b.data(), [](double x, double y) {
           return std::bit_cast<std::uint64_t>(x) == std::bit_cast<std::uint64_t>(y);
         });
}

void expect_same(const FilterNonlinearity& a, const FilterNonlinearity& b) {
  EXPECT_EQ(a.function, b.function);
  EXPECT_EQ(a.center, b.center);
  EXPECT_EQ(a.radius, b.radius);
  for (const auto vector : {&FilterNonlinearity::W, &FilterNonlinearity::a_v,
                            &FilterNonlinearity::a_y, &FilterNonlinearity::a_u}) {
    EXPECT_TRUE(same_bits(a.*vector, b.*vector));
  }
}

void expect_same(const ObserverCertificate& a, const ObserverCertificate& b) {
  EXPECT_EQ(a.fault_states, b.fault_states);
  EXPECT_EQ(a.alpha, b.alpha);
  EXPECT_EQ(a.beta, b.beta);
  EXPECT_EQ(a.detects, b.detects);
  EXPECT_EQ(a.band_low_rad, b.band_low_rad);
  EXPECT_EQ(a.band_high_rad, b.band_high_rad);
  EXPECT_EQ(a.vertex_radius, b.vertex_radius);
  EXPECT_EQ(a.nominal_fault, b.nominal_fault);
  EXPECT_EQ(a.guaranteed_fault, b.guaranteed_fault);
  for (const auto vector : {&ObserverCertificate::drift_bound, &ObserverCertificate::mu_now,
                            &ObserverCertificate::mu_next, &ObserverCertificate::mu_direct}) {
    EXPECT_TRUE(same_bits(a.*vector, b.*vector));
  }
  for (const auto matrix :
       {&ObserverCertificate::T, &ObserverCertificate::gain, &ObserverCertificate::P}) {
    EXPECT_TRUE(same_bits(a.*matrix, b.*matrix));
  }
}

TEST(ObserverFile, RoundTripsToTheBit) {
  Bank bank = observer_bank();
  bank.domain = DesignDomain::kEuler;
  bank.filters[0].course->component(0, 0) = std::numeric_limits<double>::denorm_min();
  bank.filters[0].course->weight(0, 1) = -0.0;
  bank.filters[0].observer->T(1, 1) = std::nextafter(1.0, 2.0);
  bank.filters[0].nonlinearities[0].center = 1.0 / 3.0;
  const Bank again = parse_bank(bank_text(bank), "b.json");
  EXPECT_EQ(bank_text(again), bank_text(bank));
  EXPECT_EQ(again.domain, DesignDomain::kEuler);
  ASSERT_EQ(again.filters.size(), 2u);
  for (std::size_t i = 0; i < 2; ++i) {
    const ResidualFilter &a = bank.filters[i], &b = again.filters[i];
    EXPECT_EQ(a.transient_samples, b.transient_samples);
    EXPECT_EQ(a.evaluation, b.evaluation);
    ASSERT_EQ(b.nonlinearities.size(), 1u);
    expect_same(a.nonlinearities[0], b.nonlinearities[0]);
    EXPECT_TRUE(same_bits(a.course->weight, b.course->weight));
    EXPECT_TRUE(same_bits(a.course->norm, b.course->norm));
    EXPECT_TRUE(same_bits(a.course->component, b.course->component));
    expect_same(*a.observer, *b.observer);
  }
  EXPECT_FALSE(again.filters[0].estimation);
  EXPECT_EQ(again.filters[1].estimation->fault, 1u);
  EXPECT_EQ(again.filters[1].estimation->bound, 0.015);
  EXPECT_EQ(again.filters[1].estimation->settle_samples, 8u);
}

TEST(ObserverFile, RoundTripsEveryFunction) {
  using enum FunctionKind;
  Bank bank = observer_bank();
  std::vector<FilterNonlinearity>& terms = bank.filters[1].nonlinearities;
  const FilterNonlinearity term = terms[0];
  terms.clear();
  for (const NonlinearFunction& function : std::vector<NonlinearFunction>{
           {.kind = kSin},
           {.kind = kCos},
           {.kind = kTanh},
           {.kind = kAtan},
           {.kind = kDeadZone, .width = 0.1},
           {.kind = kSaturation, .width = 2.0},
           {.kind = kPolynomial,
           .coefficients = {0.0, 1.0, -0.3},
           .domain_min = -1.0,
           .domain_max = 2.0},
           {.kind = kTable, .at = {-1.0, 0.0, 2.0}, .value = {1.0, 0.5, 0.25}}}) {
    terms.push_back(term);
    terms.back().function = function;
  }
  bank.filters[1].observer->vertex_radius.assign(256, 0.5);
  const Bank again = parse_bank(bank_text(bank), "b.json");
  ASSERT_EQ(again.filters[1].nonlinearities.size(), terms.size());
  for (std::size_t i = 0; i < terms.size(); ++i) {
    SCOPED_TRACE(i);
    expect_same(terms[i], again.filters[1].nonlinearities[i]);
  }
}

TEST(ObserverFile, SaysNothingOfObserversInTheTextOfOtherFilters) {
  EXPECT_THAT(bank_text(hou_bank()), Not(HasSubstr("observer")));
  Bank bank = observer_bank();
  ResidualFilter& filter = bank.filters[1];
  filter.nonlinearities.clear();
  filter.course.reset();
  filter.estimation.reset();
  filter.observer.reset();
  bank.filters.erase(bank.filters.begin());
  EXPECT_THAT(bank_text(bank), Not(HasSubstr("observer\"")));
  bank.filters[0].transient_samples = 5;
  const Bank again = parse_bank(bank_text(bank), "b.json");
  EXPECT_EQ(again.filters[0].transient_samples, 5u);
  EXPECT_FALSE(again.filters[0].course || again.filters[0].estimation || again.filters[0].observer);
}

TEST(ObserverFile, RefusesKeysThatAreMissingOrUnknown) {
  EXPECT_THAT(refusal(with("\"transient_samples\": 10", "\"transient\": 10")),
              HasSubstr("filters[0].observer: found unknown key \"transient\", expected one of "
                        "transient_samples, nonlinearities, evaluation, course, estimation, "
                        "certificate"));
  EXPECT_THAT(refusal(with("\"transient_samples\": 10,", "")),
              HasSubstr("filters[0].observer: found no \"transient_samples\", expected it"));
  EXPECT_THAT(refusal(with("\"observer\": {", "\"Observer\": {")),
              HasSubstr("filters[0]: found unknown key \"Observer\""));
  EXPECT_THAT(refusal(with("\"evaluation\": \"component\"", "\"evaluation\": \"largest\"")),
              HasSubstr("observer.evaluation: found string \"largest\", expected \"norm\" or "
                        "\"component\""));
  EXPECT_THAT(refusal(with("\"domain\": \"sampled\"", "\"domain\": \"heun\"")),
              HasSubstr("domain: found string \"heun\", expected \"continuous\", \"sampled\" or "
                        "\"euler\""));
}

TEST(ObserverFile, RefusesThresholdsThatAreNone) {
  EXPECT_THAT(refusal_after([](Bank& bank) { bank.filters[0].course->norm[1] = 0.0; }),
              HasSubstr("course.norm[1]: found number 0.0, expected a positive number"));
  EXPECT_THAT(refusal_after([](Bank& bank) { bank.filters[0].course->component(2, 1) = -0.1; }),
              HasSubstr("course.component[2][1]: found number -0.1, expected a positive number"));
  EXPECT_THAT(refusal_after([](Bank& bank) {
                bank.filters[0].course->norm.resize(0);
                bank.filters[0].course->component.resize(0, 2);
              }),
              HasSubstr("course.norm: found a list of 0 values, expected at least one threshold"));
  EXPECT_THAT(refusal_after([](Bank& bank) { bank.filters[0].course->norm.conservativeResize(3); }),
              HasSubstr("course.component: found a list of 4 values, expected a list of 3 values"));
  EXPECT_THAT(refusal_after([](Bank& bank) { bank.filters[0].course->weight.resize(1, 1); }),
              HasSubstr("course.weight: found a list of 1 values, expected a list of 2 values"));
}

TEST(ObserverFile, RefusesAThresholdThatIsNotTheLastOfItsCourse) {
  EXPECT_THAT(refusal_after([](Bank& bank) { bank.filters[1].threshold = 0.03; }),
              HasSubstr("found a filter with threshold 0.03, expected 0.02: the last of its"));
  EXPECT_THAT(refusal_after([](Bank& bank) { bank.filters[0].threshold = 0.006; }),
              HasSubstr("found a filter with threshold 0.006, expected 1: residuals are taken "
                        "relative to the course"));
  EXPECT_THAT(refusal_after([](Bank& bank) { bank.filters[0].course.reset(); }),
              HasSubstr("observer.evaluation: found \"component\" and no \"course\""));
}

TEST(ObserverFile, RefusesFunctionsThatAreNone) {
  const auto function = [](const std::string& text) {
    return refusal(with("{\"kind\": \"sin\"}", text));
  };
  EXPECT_THAT(function("{\"kind\": \"sinh\"}"), HasSubstr("function.kind: found string \"sinh\""));
  EXPECT_THAT(function("{}"), HasSubstr("function: found no \"kind\", expected it"));
  EXPECT_THAT(function("17"), HasSubstr("function: found number 17, expected an object"));
  EXPECT_THAT(function("{\"kind\": \"sin\", \"width\": 1}"), HasSubstr("unknown key \"width\""));
  EXPECT_THAT(function("{\"kind\": \"dead_zone\", \"width\": 0}"),
              HasSubstr("function.width: found number 0, expected a positive number"));
  EXPECT_THAT(function("{\"kind\": \"polynomial\", \"coefficients\": [], \"domain\": [0, 1]}"),
              HasSubstr("function.coefficients: found a list of 0 values, expected 1 to 32"));
  EXPECT_THAT(function("{\"kind\": \"polynomial\", \"coefficients\": [1], \"domain\": [1, 1]}"),
              HasSubstr("function.domain: found [1, 1], expected [smallest, largest]"));
  EXPECT_THAT(function("{\"kind\": \"table\", \"at\": [1], \"value\": [1]}"),
              HasSubstr("function.at: found a list of 1 values, expected at least 2 numbers"));
  EXPECT_THAT(function("{\"kind\": \"table\", \"at\": [0, 2, 2], \"value\": [1, 1, 1]}"),
              HasSubstr("function.at[2]: found number 2, expected more than 2 before it"));
  EXPECT_THAT(function("{\"kind\": \"table\", \"at\": [0, 2], \"value\": [1, 1, 1]}"),
              HasSubstr("function.value: found a list of 3 values, expected a list of 2 values"));
}

TEST(ObserverFile, RefusesWrongShapesOfATerm) {
  EXPECT_THAT(
      refusal_after([](Bank& bank) { bank.filters[0].nonlinearities[0].W.setZero(2); }),
      HasSubstr("nonlinearities[0].W: found a list of 2 values, expected a list of 3 values"));
  EXPECT_THAT(refusal(with("\"a_y\": [0.0, 0.0]", "\"a_y\": [0.0]")),
              HasSubstr("nonlinearities[0].a_y: found a list of 1 values, expected a list of 2"));
  EXPECT_THAT(refusal(with("\"radius\": 1.0", "\"radius\": -1.0")),
              HasSubstr("nonlinearities[0].radius: found number -1.0"));
}

TEST(ObserverFile, RefusesAnEstimateThatIsNone) {
  EXPECT_THAT(refusal(with("{\"fault\": \"y1\"", "{\"fault\": \"y2\"")),
              HasSubstr("estimation.fault: found string \"y2\", expected the name of a fault"));
  EXPECT_THAT(refusal(with("\"bound\": 0.015", "\"bound\": 0")),
              HasSubstr("estimation.bound: found number 0, expected a positive number"));
  EXPECT_THAT(
      refusal_after([](Bank& bank) { bank.filters[1].sees[1] = Sensitivity::kTransient; }),
      HasSubstr("estimation.fault: found string \"y1\", expected a fault that the residual sees"));
  EXPECT_THAT(
      refusal_after([](Bank& bank) { bank.filters[0].estimation = bank.filters[1].estimation; }),
      HasSubstr("estimation: found a residual of 2 rows, expected one: the estimate"));
}

TEST(ObserverFile, RefusesACertificateThatIsNone) {
  const auto certificate = [](const auto& change) {
    return refusal_after([&](Bank& bank) { change(*bank.filters[0].observer); });
  };
  using Certificate = ObserverCertificate;
  EXPECT_THAT(certificate([](Certificate& c) { c.P(0, 1) = 0.3; }),
              HasSubstr("certificate.P: found a matrix that is not symmetric"));
  EXPECT_THAT(certificate([](Certificate& c) { c.alpha = 1.0; }),
              HasSubstr("certificate.alpha: found number 1.0, expected a number below 1"));
  EXPECT_THAT(certificate([](Certificate& c) {
                c.mu_next.resize(2);
                c.mu_next.setZero();
              }),
              HasSubstr("certificate.mu_next: found a list of 2 values, expected a list of 3"));
  EXPECT_THAT(certificate([](Certificate& c) { c.mu_now[0] = -1.0; }),
              HasSubstr("certificate.mu_now[0]: found number -1.0"));
  EXPECT_THAT(certificate([](Certificate& c) { c.drift_bound.resize(0); }),
              HasSubstr("certificate.drift_bound: found a list of 0 values"));
  EXPECT_THAT(certificate([](Certificate& c) { c.band_high_rad = 3.2; }),
              HasSubstr("certificate.band_high_rad: found number 3.2, expected 0 to pi"));
  EXPECT_THAT(certificate([](Certificate& c) { c.band_low_rad = 0.2; }),
              HasSubstr("certificate.band_high_rad: found number 0.1, expected 0.2 to pi"));
  EXPECT_THAT(certificate([](Certificate& c) { c.vertex_radius.pop_back(); }),
              HasSubstr("certificate.vertex_radius: found a list of 1 values, expected a list of "
                        "2 values"));
  EXPECT_THAT(certificate([](Certificate& c) { c.T.setZero(2, 2); }),
              HasSubstr("certificate.T: found a list of 2 values, expected a list of 3 values"));
  EXPECT_THAT(certificate([](Certificate& c) { c.nominal_fault = {1.0}; }),
              HasSubstr("certificate.nominal_fault: found a list of 1 values"));
}

TEST(ObserverFile, BoundsWhatAHostileFileCanAskFor) {
  EXPECT_THAT(refusal_after([](Bank& bank) {
                ThresholdCourse& course = *bank.filters[1].course;
                course.norm = Eigen::VectorXd::Constant(100'000, 0.02);
                course.component = course.norm;
              }),
              HasSubstr("filters[1]: found 100004 samples of thresholds up to here, expected "
                        "courses of at most 100000 in all filters together"));
  EXPECT_THAT(refusal_after([](Bank& bank) {
                std::vector<FilterNonlinearity>& terms = bank.filters[0].nonlinearities;
                terms.resize(17, terms[0]);
              }),
              HasSubstr("nonlinearities: found a list of 17 values, expected at most 16"));
}

TEST(ObserverFile, SurvivesEveryTruncationAndEverySingleByteChange) {
  const std::string text = bank_text(observer_bank());
  for (std::size_t i = 0; i < text.size(); i += 7) {
    EXPECT_NE(refusal(text.substr(0, i)), "") << i;
  }
  for (std::size_t i = 0; i < text.size(); ++i) {
    std::string changed = text;
    changed[i] = static_cast<char>(changed[i] ^ 0x15);
    static_cast<void>(refusal(changed));  // may be read or refused, nothing else
  }
}

}  // namespace
}  // namespace faultline
