#include <functional>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "diagnosis/certify/certify.h"
#include "diagnosis/certify/check.h"
#include "tests/diagnosis/certify/observer_cases.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using ::testing::AllOf;
using ::testing::HasSubstr;

Bank certified(const PlantModel& plant, Bank bank) {
  certify(plant, bank);
  return bank;
}

std::string all_sentences(const CheckResult& result) {
  std::string text;
  for (const CheckFinding& finding : result.findings) text += sentence(finding) + "\n";
  return text;
}

void expect_found(const PlantModel& plant, const Bank& bank, const std::string& what) {
  EXPECT_FALSE(check_bank(plant, bank).holds()) << what << " was tampered with";
}

TEST(CheckObserver, FindsNothingWrongWithCertifiedObservers) {
  for (const ObserverCase& oracle :
       {ObserverCase::detection(), ObserverCase::combined(), ObserverCase::estimator()}) {
    EXPECT_EQ(all_sentences(check_bank(joint_plant(), certified(joint_plant(), oracle.bank()))), "")
        << oracle.name;
  }
  EXPECT_EQ(all_sentences(check_bank(tanh_plant(), certified(tanh_plant(), tanh_bank()))), "");
}

TEST(CheckObserver, FindsNothingWrongWithResidualsThatAreEvaluatedByTheirNorm) {
  for (const ObserverCase& oracle : {ObserverCase::detection(), ObserverCase::combined()}) {
    Bank bank = oracle.bank();
    ResidualFilter& filter = bank.filters[0];
    filter.evaluation = Evaluation::kNorm;
    filter.course.emplace().weight = 2.0 * MatrixXd::Identity(3, 3);
    filter.observer->P *= 4.0;
    filter.observer->mu_now *= 4.0;
    filter.observer->mu_next *= 4.0;
    filter.observer->mu_direct *= 4.0;
    filter.observer->beta *= 2.0;
    bank = certified(joint_plant(), bank);
    EXPECT_EQ(all_sentences(check_bank(joint_plant(), bank)), "") << oracle.name;
    const ResidualFilter& found = bank.filters[0];
    EXPECT_EQ(found.threshold, found.course->norm[found.course->norm.size() - 1]);
    EXPECT_GT(found.certificate.smallest_fault[0], 0.0);
    EXPECT_GT(found.certificate.delay_s[0], 0.0);
  }
}

TEST(CheckObserver, FindsEveryMatrixTamperedWith) {
  const PlantModel plant = tanh_plant();
  const Bank bank = certified(plant, tanh_bank());
  using Member = MatrixXd ResidualFilter::*;
  const std::vector<std::pair<char, Member>> members = {
      {'F', &ResidualFilter::F}, {'E', &ResidualFilter::E}, {'G', &ResidualFilter::G},
      {'M', &ResidualFilter::M}, {'H', &ResidualFilter::H}, {'K', &ResidualFilter::K},
      {'L', &ResidualFilter::L}, {'J', &ResidualFilter::J}};
  for (std::size_t f = 0; f < bank.filters.size(); ++f) {
    for (const auto& [letter, member] : members) {
      const MatrixXd& matrix = bank.filters[f].*member;
      for (Index i = 0; i < matrix.size(); ++i) {
        Bank tampered = bank;
        (tampered.filters[f].*member).data()[i] += 1e-4;
        expect_found(plant, tampered, std::string(1, letter) + std::to_string(i));
      }
    }
  }
}

TEST(CheckObserver, FindsEveryLipschitzTermTamperedWith) {
  const PlantModel plant = tanh_plant();
  const Bank bank = certified(plant, tanh_bank());
  const std::vector<std::pair<std::string, std::function<void(FilterNonlinearity&)>>> changes = {
      {"function", [](FilterNonlinearity& t) { t.function.kind = FunctionKind::kAtan; }},
      {"width", [](FilterNonlinearity& t) { t.function.width = 1.0; }},
      {"center", [](FilterNonlinearity& t) { t.center += 1e-4; }},
      {"radius", [](FilterNonlinearity& t) { t.radius *= 1.0001; }},
      {"W", [](FilterNonlinearity& t) { t.W[0] *= 1.0001; }},
      {"a_v", [](FilterNonlinearity& t) { t.a_v[0] += 1e-4; }},
      {"a_y", [](FilterNonlinearity& t) { t.a_y[0] += 1e-4; }},
      {"a_u", [](FilterNonlinearity& t) { t.a_u[0] += 1e-4; }},
      {"a_v of another length", [](FilterNonlinearity& t) { t.a_v = VectorXd::Zero(2); }},
      {"a_y of another length", [](FilterNonlinearity& t) { t.a_y = VectorXd::Zero(7); }},
  };
  for (const auto& [what, change] : changes) {
    Bank tampered = bank;
    change(tampered.filters[0].nonlinearities[0]);
    expect_found(plant, tampered, what);
  }
  Bank tampered = bank;
  tampered.filters[0].nonlinearities.clear();
  expect_found(plant, tampered, "number of terms");
}

using Change = std::function<void(ResidualFilter&)>;

std::vector<std::pair<std::string, Change>> changes_of_any_observer() {
  return {
      {"threshold", [](ResidualFilter& f) { f.threshold *= 1.0001; }},
      {"forget_samples", [](ResidualFilter& f) { f.forget_samples += 1; }},
      {"forget_samples", [](ResidualFilter& f) { f.forget_samples -= 1; }},
      {"transient_samples", [](ResidualFilter& f) { f.transient_samples += 1; }},
      {"first threshold", [](ResidualFilter& f) { f.course->component(0, 0) *= 0.9999; }},
      {"a threshold", [](ResidualFilter& f) { f.course->component(7, 0) *= 1.0001; }},
      {"last threshold", [](ResidualFilter& f) { f.course->component.bottomRows(1) *= 0.9999; }},
      {"a course that is too short",
       [](ResidualFilter& f) { f.course->component = f.course->component.topRows(9).eval(); }},
      {"no number",
       [](ResidualFilter& f) {
         f.course->component(3, 0) = std::numeric_limits<double>::quiet_NaN();
       }},
      {"no course", [](ResidualFilter& f) { f.course.reset(); }},
      {"no observer", [](ResidualFilter& f) { f.observer.reset(); }},
      {"evaluation", [](ResidualFilter& f) { f.evaluation = Evaluation::kNorm; }},
      {"T", [](ResidualFilter& f) { f.observer->T(0, 0) += 1e-4; }},
      {"gain", [](ResidualFilter& f) { f.observer->gain(1, 1) += 1e-4; }},
      {"shape of the gain", [](ResidualFilter& f) { f.observer->gain = MatrixXd::Zero(2, 2); }},
      {"radius at a corner", [](ResidualFilter& f) { f.observer->vertex_radius[1] *= 0.9999; }},
      {"corners", [](ResidualFilter& f) { f.observer->vertex_radius.pop_back(); }},
      {"nominal fault", [](ResidualFilter& f) { f.observer->nominal_fault[0] *= 0.9999; }},
      {"guaranteed fault", [](ResidualFilter& f) { f.observer->guaranteed_fault[0] *= 0.9999; }},
      {"smallest fault", [](ResidualFilter& f) { f.certificate.smallest_fault[0] *= 0.9999; }},
      {"delay", [](ResidualFilter& f) { f.certificate.delay_s[0] += 0.01; }},
      {"gain at DC", [](ResidualFilter& f) { f.certificate.dc_gain[0] *= 1.0001; }},
  };
}

void tamper(const PlantModel& plant, const Bank& bank, std::size_t filter,
            const std::vector<std::pair<std::string, Change>>& changes) {
  for (const auto& [what, change] : changes) {
    Bank tampered = bank;
    change(tampered.filters[filter]);
    expect_found(plant, tampered, what);
  }
}

TEST(CheckObserver, FindsEveryClaimTamperedWith) {
  for (const auto& [plant, bank] :
       {std::pair(tanh_plant(), certified(tanh_plant(), tanh_bank())),
        std::pair(joint_plant(), certified(joint_plant(), ObserverCase::combined().bank()))}) {
    tamper(plant, bank, 0, changes_of_any_observer());
    tamper(plant, bank, 1, changes_of_any_observer());
    tamper(plant, bank, 0,
           {{"transient_samples", [](ResidualFilter& f) { f.transient_samples -= 1; }},
            {"no transient_samples", [](ResidualFilter& f) { f.transient_samples = 0; }},
            {"carried faults", [](ResidualFilter& f) { f.observer->fault_states = {0}; }},
            {"no carried faults", [](ResidualFilter& f) { f.observer->fault_states.clear(); }},
            {"a drift below zero", [](ResidualFilter& f) { f.observer->drift_bound[0] = -1.0; }},
            {"an estimate", [](ResidualFilter& f) { f.estimation.emplace().fault = 1; }}});
    tamper(plant, bank, 1,
           {{"bound", [](ResidualFilter& f) { f.estimation->bound *= 0.9999; }},
            {"settle_samples", [](ResidualFilter& f) { f.estimation->settle_samples -= 1; }},
            {"estimated fault", [](ResidualFilter& f) { f.estimation->fault = 0; }},
            {"no estimation", [](ResidualFilter& f) { f.estimation.reset(); }}});
  }
}

TEST(CheckObserver, FindsEveryNumberOfTheQuadraticBoundTamperedWith) {
  for (const ObserverCase& oracle : {ObserverCase::detection(), ObserverCase::combined()}) {
    const Bank bank = certified(joint_plant(), oracle.bank());
    tamper(joint_plant(), bank, 0,
           {{"alpha", [](ResidualFilter& f) { f.observer->alpha *= 0.999; }},
            {"alpha", [](ResidualFilter& f) { f.observer->alpha = 1.0; }},
            {"P", [](ResidualFilter& f) { f.observer->P *= 0.999; }},
            {"an entry of P", [](ResidualFilter& f) { f.observer->P(0, 0) *= 0.99; }},
            {"symmetry of P", [](ResidualFilter& f) { f.observer->P(0, 1) *= 1.001; }},
            {"a P that is not definite", [](ResidualFilter& f) { f.observer->P *= -1.0; }},
            {"mu_now", [](ResidualFilter& f) { f.observer->mu_now *= 0.999; }},
            {"mu_next", [](ResidualFilter& f) { f.observer->mu_next[3] += 1e-4; }},
            {"mu_direct", [](ResidualFilter& f) { f.observer->mu_direct *= 0.999; }},
            {"a mu below zero", [](ResidualFilter& f) { f.observer->mu_now[3] = -1e-3; }},
            {"number of mu", [](ResidualFilter& f) { f.observer->mu_now.conservativeResize(2); }},
            {"weight", [](ResidualFilter& f) { f.course->weight *= 1.01; }},
            {"shape of the weight",
             [](ResidualFilter& f) { f.course->weight = MatrixXd::Identity(2, 2); }},
            {"first norm", [](ResidualFilter& f) { f.course->norm[0] *= 0.9999; }},
            {"last norm", [](ResidualFilter& f) { f.course->norm.tail(1) *= 0.9999; }},
            {"no norm", [](ResidualFilter& f) { f.course->norm.resize(0); }},
            {"no P", [](ResidualFilter& f) { f.observer->P.resize(0, 0); }},
            {"beta", [](ResidualFilter& f) { f.observer->beta = 2.0; }},
            {"a beta of nothing", [](ResidualFilter& f) { f.observer->detects.clear(); }},
            {"beta of more faults than rows",
             [](ResidualFilter& f) {
               f.observer->detects = {0, 0, 0, 0};
             }},
            {"beta of a fault seen in transients",
             [](ResidualFilter& f) {
               f.observer->detects = {0, 0};
             }},
            {"band", [](ResidualFilter& f) { f.observer->band_high_rad = 3.0; }},
            {"band upside down", [](ResidualFilter& f) { f.observer->band_low_rad = 0.2; }},
            {"another fault", [](ResidualFilter& f) { f.observer->detects = {7}; }}});
  }
}

TEST(CheckObserver, SaysWhichClaimInWords) {
  Bank bank = certified(joint_plant(), ObserverCase::combined().bank());
  bank.filters[1].estimation->settle_samples = 3;
  bank.filters[0].course->component(2, 1) *= 0.5;
  const std::string text = all_sentences(check_bank(joint_plant(), bank));
  EXPECT_THAT(text, HasSubstr("output: componentwise threshold(2, 1): the bank says 6.26"));
  EXPECT_THAT(text, HasSubstr("estimate: samples its estimate settles in: the bank says 3, but it "
                              "is 25"));
}

TEST(CheckObserver, FindsWhatOnlyAnObserverMayClaim) {
  Bank bank = certified(tanh_plant(), tanh_bank());
  bank.filters[0].observer.reset();
  const std::string text = all_sentences(check_bank(tanh_plant(), bank));
  EXPECT_THAT(text, HasSubstr("Lipschitz terms: the bank says an observer's, but it is no "
                              "observer's"));
}

// What certify() says of a plant or bank that it cannot prove.
std::string refusal(const PlantModel& plant, Bank bank) {
  try {
    certify(plant, bank);
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "it was certified";
}

TEST(CertifyObserver, RefusesAPlantWithoutTheBoundsThatProofsStartFrom) {
  PlantModel plant = joint_plant();
  plant.disturbances[1].bound.reset();
  EXPECT_THAT(refusal(plant, ObserverCase::combined().bank()),
              AllOf(HasSubstr("residual output: found disturbance zd2"), HasSubstr("bound")));
  // Decoupled ones need none.
  EXPECT_EQ(refusal(plant, ObserverCase::detection().bank()), "it was certified");
  plant = joint_plant();
  plant.noises[0].bound.reset();
  plant.noises[0].sigma = 0.1;
  EXPECT_THAT(refusal(plant, ObserverCase::detection().bank()),
              HasSubstr("found [[noise]] 1 of plant \"flexible joint\" without a bound"));
  plant = joint_plant();
  plant.state_range.reset();
  EXPECT_THAT(refusal(plant, ObserverCase::detection().bank()), HasSubstr("`range`"));
}

TEST(CertifyObserver, RefusesADisturbanceThatIsNotDecoupled) {
  Bank bank = ObserverCase::combined().bank();
  bank.disturbances[2].treatment = BankDisturbance::Treatment::kDecoupled;
  EXPECT_THAT(refusal(joint_plant(), bank), HasSubstr("found disturbance zd3 decoupled, but"));
}

TEST(CertifyObserver, RefusesThresholdsOfZero) {
  PlantModel plant = joint_plant();
  plant.noises.clear();
  Bank bank = ObserverCase::detection().bank();
  bank.filters[0].observer->P.resize(0, 0);
  bank.filters[0].observer->beta = 0.0;
  EXPECT_THAT(refusal(plant, bank), HasSubstr("a threshold would be 0"));
}

TEST(CertifyObserver, RefusesAnObserverThatTheSmallGainTheoremDoesNotBound) {
  PlantModel plant = joint_plant();
  plant.nonlinearities[0].gain = -20.0;
  Bank bank = ObserverCase::detection().bank();
  EXPECT_THAT(refusal(plant, bank), HasSubstr("the small gain theorem does not hold"));
}

TEST(CertifyObserver, RefusesAnUnstableObserver) {
  Bank bank = ObserverCase::combined().bank();
  bank.filters[0].observer->gain.setZero();
  EXPECT_THAT(refusal(joint_plant(), bank), HasSubstr("expected a stable observer"));
}

TEST(CertifyObserver, RefusesWhatPDoesNotProve) {
  Bank bank = ObserverCase::detection().bank();
  bank.filters[0].observer->mu_now *= 0.9;
  EXPECT_THAT(refusal(joint_plant(), bank), HasSubstr("P does not prove its bound"));
  bank = ObserverCase::detection().bank();
  bank.filters[0].observer->beta = 2.0;
  EXPECT_THAT(refusal(joint_plant(), bank), HasSubstr("found beta = 2, expected at most 1.98125"));
}

TEST(CertifyObserver, RefusesWhatIsNoObserverOfThePlant) {
  Bank bank = ObserverCase::combined().bank();
  bank.method = "geometric";
  EXPECT_THAT(refusal(joint_plant(), bank), HasSubstr("expected \"uio\""));
  bank = ObserverCase::combined().bank();
  bank.domain = DesignDomain::kContinuous;
  EXPECT_THAT(refusal(joint_plant(), bank), HasSubstr("continuous domain"));
  bank = ObserverCase::combined().bank();
  bank.filters[0].observer->fault_states = {9};
  EXPECT_THAT(refusal(joint_plant(), bank), HasSubstr("not in the plant"));
  bank = ObserverCase::combined().bank();
  bank.filters[1].estimation->fault = 0;
  EXPECT_THAT(refusal(joint_plant(), bank), HasSubstr("found an estimate of fault 0"));
  PlantModel plant = joint_plant();
  plant.nonlinearities.assign(9, plant.nonlinearities[0]);
  EXPECT_THAT(refusal(plant, ObserverCase::combined().bank()), HasSubstr("found 9 nonlinearities"));
}

}  // namespace
}  // namespace faultline
