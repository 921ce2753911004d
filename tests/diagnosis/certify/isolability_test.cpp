#include "diagnosis/certify/isolability.h"

#include <algorithm>
#include <chrono>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "diagnosis/design/design_bank.h"
#include "tests/diagnosis/certify/certify_cases.h"
#include "tests/diagnosis/geometric_oracle.h"
#include "tests/diagnosis/hou_plant.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using ::testing::ElementsAre;
using ::testing::IsEmpty;
using FaultSet = std::vector<std::size_t>;

// A bank without filters: only what strong isolability depends on.
Bank bank_frame(const PlantModel& plant, std::size_t concurrent) {
  Bank bank;
  bank.concurrent = concurrent;
  bank.sample_time_s = 0.01;
  bank.fault_names = plant.fault_names();
  for (const Disturbance& disturbance : plant.disturbances) {
    bank.disturbances.push_back({disturbance.name, BankDisturbance::Treatment::kDecoupled});
  }
  return bank;
}

std::vector<FaultSet> sets_of(std::size_t count, std::size_t size) {
  std::vector<FaultSet> sets;
  std::vector<bool> is_chosen(count, false);
  std::fill_n(is_chosen.begin(), std::min(size, count), true);
  do {
    FaultSet set;
    for (std::size_t j = 0; j < count; ++j) {
      if (is_chosen[j]) {
        set.push_back(j);
      }
    }
    sets.push_back(set);
  } while (std::prev_permutation(is_chosen.begin(), is_chosen.end()));
  return sets;
}

TEST(Isolability, AgreesWithTheOracleInBothDomains) {
  for (const OracleCase& oracle : oracle_cases()) {
    SCOPED_TRACE(oracle.name);
    const PlantModel plant = oracle.plant();
    Bank bank = design_bank(plant, oracle.request()).bank;
    for (const DesignDomain domain : {DesignDomain::kContinuous, DesignDomain::kSampled}) {
      bank.domain = domain;
      const IsolabilityCertificate found = analyse_isolability(plant, bank);
      EXPECT_EQ(found.are_signatures_distinct, oracle.are_signatures_distinct);
      EXPECT_TRUE(found.is_list_complete);
      if (domain == DesignDomain::kSampled && oracle.name == "h6_cor1_ok_but_unsolvable") {
        continue;  // b3 = A b1 does not survive sampling
      }
      EXPECT_EQ(found.is_strongly_isolable, oracle.is_strongly_isolable);
      // The oracle lists sets of 2p; the certificate their smallest dependent parts.
      std::vector<FaultSet> dependent;
      for (const FaultSet& set : sets_of(plant.faults.size(), 2 * bank.concurrent)) {
        if (std::any_of(found.confusable.begin(), found.confusable.end(), [&](const auto& circuit) {
              return std::includes(set.begin(), set.end(), circuit.faults.begin(),
                                   circuit.faults.end());
            })) {
          dependent.push_back(set);
        }
      }
      EXPECT_EQ(dependent, oracle.confusable_2p_sets);
    }
  }
}

TEST(Isolability, GivesHousWeights) {
  const IsolabilityCertificate found = analyse_isolability(hou_plant(), bank_frame(hou_plant(), 2));
  ASSERT_EQ(found.confusable.size(), 1u);
  EXPECT_THAT(found.confusable[0].faults, ElementsAre(0, 1, 2, 3));
  ASSERT_EQ(found.confusable[0].weights.size(), 4u);
  const std::vector<double> expected = {1.0, 0.5, -0.5, -0.5};
  for (std::size_t i = 0; i < 4; ++i) {
    EXPECT_NEAR(found.confusable[0].weights[i], expected[i], 1e-12);
  }
}

TEST(Isolability, FindsOnlySmallestDependentSets) {
  // b3 = b1 + b2: {1, 2, 3}, and no set of four.
  const OracleCase h4 = oracle_cases()[2];
  const IsolabilityCertificate found = analyse_isolability(h4.plant(), bank_frame(h4.plant(), 2));
  ASSERT_EQ(found.confusable.size(), 1u);
  EXPECT_THAT(found.confusable[0].faults, ElementsAre(0, 1, 2));
  EXPECT_NEAR(found.confusable[0].weights[0], 1.0, 1e-12);
  EXPECT_NEAR(found.confusable[0].weights[1], 1.0, 1e-9);
  EXPECT_NEAR(found.confusable[0].weights[2], -1.0, 1e-9);
}

TEST(Isolability, GivesNoWeightsWhereTheyDependOnFrequency) {
  const OracleCase h6 = oracle_cases()[3];  // b3 = A b1, C b1 = 0: column 3 is s times column 1
  const IsolabilityCertificate found = analyse_isolability(h6.plant(), bank_frame(h6.plant(), 1));
  ASSERT_EQ(found.confusable.size(), 1u);
  EXPECT_THAT(found.confusable[0].faults, ElementsAre(0, 2));
  EXPECT_THAT(found.confusable[0].weights, IsEmpty());
}

TEST(Isolability, ConfusesAFaultThatNoOutputShowsWithNone) {
  PlantModel plant = hou_plant();
  plant.faults.push_back(
      {"ghost", FaultKind::kComponent, VectorXd::Zero(3), VectorXd::Zero(3), 1.0});
  const IsolabilityCertificate found = analyse_isolability(plant, bank_frame(plant, 1));
  ASSERT_EQ(found.confusable.size(), 1u);
  EXPECT_THAT(found.confusable[0].faults, ElementsAre(4));
  EXPECT_THAT(found.confusable[0].weights, ElementsAre(1.0));
}

TEST(Isolability, CountsOnlyWhatDecoupledDisturbancesLeave) {
  PlantModel plant = hou_plant();
  Bank bank = bank_frame(plant, 1);
  EXPECT_TRUE(analyse_isolability(plant, bank).is_strongly_isolable);
  // A disturbance like u1 hides that fault altogether.
  plant.disturbances.push_back({"d", plant.B.col(0), VectorXd::Zero(3), std::nullopt});
  bank = bank_frame(plant, 1);
  const IsolabilityCertificate found = analyse_isolability(plant, bank);
  EXPECT_FALSE(found.is_strongly_isolable);
  ASSERT_FALSE(found.confusable.empty());
  EXPECT_THAT(found.confusable[0].faults, ElementsAre(0));
  bank.disturbances[0].treatment = BankDisturbance::Treatment::kNone;
  EXPECT_TRUE(analyse_isolability(plant, bank).is_strongly_isolable);
}

TEST(Isolability, IsNotMisledByUnits) {
  PlantModel plant = hou_plant();
  plant.C.row(0) *= 1e12;
  plant.faults[1].state *= 1e-9;
  const IsolabilityCertificate found = analyse_isolability(plant, bank_frame(plant, 2));
  ASSERT_EQ(found.confusable.size(), 1u);
  ASSERT_EQ(found.confusable[0].weights.size(), 4u);
  EXPECT_NEAR(found.confusable[0].weights[0], 2e-9, 1e-15);
  EXPECT_EQ(found.confusable[0].weights[1], 1.0);
}

TEST(Isolability, SaysSoWhenItsListIsNotComplete) {
  // 31 faults, 12 outputs: 942,648 sets of up to six.
  const CertifyCase random = random_case(30, 12, 31, 12, 3, DesignDomain::kContinuous);
  const auto begin = std::chrono::steady_clock::now();
  const IsolabilityCertificate found =
      analyse_isolability(random.plant, bank_frame(random.plant, 3));
  EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(20));
  EXPECT_FALSE(found.is_list_complete);
  EXPECT_FALSE(found.is_strongly_isolable);
}

TEST(Isolability, NeedsNoSearchWhenAllColumnsAreIndependent) {
  const CertifyCase random = random_case(31, 40, 30, 32, 3, DesignDomain::kContinuous);
  const IsolabilityCertificate found =
      analyse_isolability(random.plant, bank_frame(random.plant, 3));
  EXPECT_TRUE(found.is_list_complete);
  EXPECT_TRUE(found.is_strongly_isolable);
}

TEST(Signatures, AreDistinctUntilTwoSetsFireTheSameResiduals) {
  Bank bank = hou_bank();
  EXPECT_TRUE(are_signatures_distinct(bank));
  bank.concurrent = 3;
  EXPECT_FALSE(are_signatures_distinct(bank));  // any three fire all six
  bank.concurrent = 1;
  bank.filters.resize(1);
  EXPECT_FALSE(are_signatures_distinct(bank));  // u1 and u2: nothing fires
}

TEST(Signatures, AreThoseInWhichWhatFadesHasFaded) {
  Bank bank;
  bank.fault_names = {"u", "y"};
  bank.filters.resize(2);
  bank.filters[0].sees = {Sensitivity::kSteady, Sensitivity::kTransient};
  bank.filters[1].sees = {Sensitivity::kSteady, Sensitivity::kSteady};
  EXPECT_FALSE(are_signatures_distinct(bank));
  bank.filters[0].transient_samples = 5;
  EXPECT_TRUE(are_signatures_distinct(bank));
}

}  // namespace
}  // namespace faultline
