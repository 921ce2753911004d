#include "diagnosis/design/uio/observer_search.h"

#include <algorithm>
#include <set>
#include <stdexcept>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/diagnosis/design/uio/observer_oracle.h"

namespace faultline {
namespace {

using Eigen::MatrixXd;

/// @throws std::runtime_error if there is none
const ObserverCandidate& best_of(const ObserverSearch& search) {
  if (search.candidates.empty()) throw std::runtime_error("the search found no observer");
  return *std::min_element(search.candidates.begin(), search.candidates.end(),
                           [](const ObserverCandidate& a, const ObserverCandidate& b) {
                             return a.design.objective < b.design.objective;
                           });
}

TEST(ObserverSearch, FindsObserversAsGoodAsTheBestKnown) {
  for (const char* name : {"paper_detection_UIO", "paper_combined_noDecoupling"}) {
    const ObserverOracle oracle = observer_oracle(name);
    const ObserverSearch search =
        search_observer(oracle.model, oracle.decoupling, oracle.output, oracle.band);
    ASSERT_FALSE(search.candidates.empty()) << name;
    EXPECT_LT(best_of(search).design.objective, 1.01 * oracle.objective) << name;
    EXPECT_EQ(best_of(search).multipliers.direction, ReferenceDirection::kFaultInput) << name;
  }
}

TEST(ObserverSearch, KeepsTheBestOfEachAlphaAndPoleWithItsSmallestThreshold) {
  const ObserverOracle oracle = observer_oracle("paper_detection_UIO");
  std::size_t reported = 0;
  ObserverSearchOptions options;
  options.alphas = {0.8, 0.9};
  options.on_attempt = [&](std::size_t count) { EXPECT_EQ(count, ++reported); };
  const ObserverSearch search =
      search_observer(oracle.model, oracle.decoupling, oracle.output, oracle.band, options);
  EXPECT_EQ(reported, search.attempts.size());
  EXPECT_EQ(search.candidates.size(), 6U);
  std::set<std::pair<double, double>> places;
  for (const ObserverCandidate& candidate : search.candidates) {
    places.emplace(candidate.multipliers.alpha, candidate.multipliers.a_0);
    EXPECT_EQ(candidate.bound.gain, candidate.design.gain);
    EXPECT_EQ(candidate.bound.beta, candidate.design.beta);
    EXPECT_LE(candidate.bound.tau, candidate.design.tau);
    for (const ObserverAttempt& attempt : search.attempts) {
      if (attempt.multipliers.alpha != candidate.multipliers.alpha ||
          attempt.multipliers.a_0 != candidate.multipliers.a_0 ||
          attempt.status != SynthesisStatus::kSolved) {
        continue;
      }
      EXPECT_GE(attempt.objective, candidate.design.objective);
    }
  }
  EXPECT_EQ(places.size(), 6U);
}

/// The robot with its positions measured alone: the fault, a torque, shows a sample later.
ObserverOracle positions_measured() {
  ObserverOracle oracle = observer_oracle("paper_detection_UIO");
  ObserverModel& model = oracle.model;
  model.C = (MatrixXd(2, 4) << 1, 0, 0, 0, 0, 0, 1, 0).finished();
  model.M = MatrixXd::Zero(4, 2);
  model.W = 0.1 * MatrixXd::Identity(2, 2);
  model.w_bound = Eigen::VectorXd::Constant(2, 0.1);
  model.F_y = MatrixXd::Zero(2, 1);
  oracle.decoupling = {MatrixXd::Zero(4, 2), MatrixXd::Identity(4, 4), MatrixXd(4, 0)};
  oracle.output = output_error(model);
  return oracle;
}

TEST(ObserverSearch, FindsObserversForFaultsThatShowASampleLater) {
  const ObserverOracle oracle = positions_measured();
  ObserverSearchOptions options;
  options.alphas = {0.9};
  const ObserverSearch search =
      search_observer(oracle.model, oracle.decoupling, oracle.output, oracle.band, options);
  ASSERT_FALSE(search.candidates.empty());
  EXPECT_EQ(best_of(search).multipliers.direction, ReferenceDirection::kFaultResponse);
  for (const ObserverAttempt& attempt : search.attempts) {
    if (attempt.multipliers.direction == ReferenceDirection::kFaultInput) {
      EXPECT_EQ(attempt.status, SynthesisStatus::kInfeasible) << attempt.reason;
    }
  }
}

TEST(ObserverSearch, SaysOfEveryAttemptWhyThereIsNoObserver) {
  const ObserverOracle oracle = observer_oracle("paper_augmented_UIO_ry_low_band_INFEASIBLE");
  const ObserverSearch search =
      search_observer(oracle.model, oracle.decoupling, oracle.output, oracle.band);
  EXPECT_TRUE(search.candidates.empty());
  ASSERT_FALSE(search.attempts.empty());
  std::set<double> alphas;
  for (const ObserverAttempt& attempt : search.attempts) {
    alphas.insert(attempt.multipliers.alpha);
    EXPECT_EQ(attempt.status, SynthesisStatus::kInfeasible) << attempt.reason;
    EXPECT_FALSE(attempt.reason.empty());
  }
  EXPECT_EQ(alphas.size(), 4U);
}

TEST(ObserverSearch, WithoutABandTriesEachAlphaOnce) {
  const ObserverOracle oracle = observer_oracle("paper_sensor_fault_estimator_UIO");
  const ObserverSearch search =
      search_observer(oracle.model, oracle.decoupling, oracle.output, std::nullopt);
  EXPECT_EQ(search.attempts.size(), 4U);
  EXPECT_EQ(search.candidates.size(), 4U);
}

TEST(ObserverSearch, RefusesEmptyListsAndRanges) {
  const ObserverOracle oracle = observer_oracle("paper_detection_UIO");
  ObserverSearchOptions options;
  options.alphas.clear();
  EXPECT_THROW(static_cast<void>(search_observer(oracle.model, oracle.decoupling, oracle.output,
                                                 oracle.band, options)),
               std::invalid_argument);
  options = {};
  options.smallest_v = 0.0;
  EXPECT_THROW(static_cast<void>(search_observer(oracle.model, oracle.decoupling, oracle.output,
                                                 oracle.band, options)),
               std::invalid_argument);
}

}  // namespace
}  // namespace faultline
