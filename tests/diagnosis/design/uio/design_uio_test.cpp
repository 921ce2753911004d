#include <cmath>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "diagnosis/design/design_bank.h"
#include "tests/diagnosis/flexible_joint.h"

namespace faultline {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

// The multipliers of the reference: a_0 = -0.05, V = -50 F_x.
const std::string kMultiplier = "a_0 = [-0.05]\nv = [50]\n";

std::string refusal(const PlantModel& plant, const BankRequest& request) {
  try {
    static_cast<void>(design_bank(plant, request));
  } catch (const InputError& error) {
    return error.what();
  }
  return "accepted";
}

const ObserverTrial& chosen(const ObserverReport& report) {
  for (const ObserverTrial& trial : report.trials) {
    if (trial.is_chosen) return trial;
  }
  throw std::logic_error("nothing was chosen");
}

// Objectives and guaranteed faults of section 5 of the corrected example, Euler's robot.
TEST(UioDesign, FindsTheObserversOfTheReference) {
  struct Case {
    const char* uio;
    double objective, nominal;
  };
  for (const Case& expected :
       {Case{"decoupling = \"full\"\nalpha = [0.9]\n", 0.06988643300367418, 0.029},
        Case{"decoupling = \"none\"\nalpha = [0.9]\ncarry = [\"y1\"]\ndrift_per_s = 0.1\n",
             0.06546260085123891, 0.034}}) {
    const DesignResult result =
        design_bank(flexible_joint_euler(), joint_request(expected.uio + kMultiplier));
    ASSERT_TRUE(result.is_solvable);
    const ObserverTrial& trial = chosen(result.observers[0]);
    EXPECT_NEAR(trial.objective, expected.objective, 1e-3 * expected.objective);
    EXPECT_NEAR(0.5 * trial.guaranteed, expected.nominal, 1e-3);
    for (const double radius : trial.radius) EXPECT_LT(radius, std::sqrt(0.9));
  }
}

TEST(UioDesign, TriesBothWaysOfDecouplingAndSaysWhyOneCannotBe) {
  const DesignResult result = design_bank(
      flexible_joint_euler(),
      joint_request("carry = [\"y1\"]\ndrift_per_s = 0.1\nalpha = [0.9]\n" + kMultiplier));
  ASSERT_TRUE(result.is_solvable);
  const std::vector<ObserverTrial>& trials = result.observers[0].trials;
  ASSERT_EQ(trials.size(), 2u);
  EXPECT_THAT(trials[0].decoupled, ElementsAre("zd1", "zd2", "zd3"));
  EXPECT_EQ(trials[0].status, SynthesisStatus::kInfeasible);
  EXPECT_THAT(trials[0].reason, HasSubstr("a constant u1 of 1 looks exactly like y1 of 0.478"));
  EXPECT_TRUE(trials[1].decoupled.empty());
  EXPECT_TRUE(trials[1].is_chosen);
  for (const BankDisturbance& disturbance : result.bank.disturbances) {
    EXPECT_EQ(disturbance.treatment, BankDisturbance::Treatment::kNone);
  }
}

TEST(UioDesign, WithoutAnyObserverIsNotSolvable) {
  const DesignResult result =
      design_bank(flexible_joint_euler(), joint_request("carry = [\"y1\"]\ndrift_per_s = 0.1\n"
                                                        "decoupling = \"full\"\nalpha = [0.9]\n"));
  EXPECT_FALSE(result.is_solvable);
  EXPECT_FALSE(result.observers[0].exists);
  EXPECT_TRUE(result.bank.filters.empty());
}

TEST(UioDesign, TakesTheAlphaWithTheSmallestFaultThatIsSure) {
  const DesignResult result = design_bank(
      flexible_joint(), joint_request("decoupling = \"none\"\nalpha = [0.7, 0.8, 0.9]\n"));
  const ObserverReport& report = result.observers[0];
  double smallest = 1e9;
  for (const ObserverTrial& trial : report.trials) {
    ASSERT_EQ(trial.status, SynthesisStatus::kSolved) << trial.reason;
    smallest = std::min(smallest, trial.guaranteed);
  }
  EXPECT_EQ(chosen(report).guaranteed, smallest);
}

TEST(UioDesign, EstimatesWithAFilterForEachFault) {
  const DesignResult result = design_bank(
      flexible_joint_euler(),
      joint_request("decoupling = \"full\"\nalpha = [0.9]\n" + kMultiplier +
                    "[uio.estimate]\nfaults = [\"y1\"]\ndrift_per_s = 0.5\nalpha = [0.95]\n"
                    "decoupling = \"full\"\n"));
  ASSERT_TRUE(result.is_solvable);
  ASSERT_EQ(result.bank.filters.size(), 2u);
  const ResidualFilter& size = result.bank.filters[1];
  EXPECT_EQ(size.name, "size_y1");
  EXPECT_EQ(size.estimation->fault, 1u);
  EXPECT_EQ(size.sees[1], Sensitivity::kSteady);
  // The reference's bound of the estimate's error, for its own gain: 0.0147.
  EXPECT_NEAR(chosen(result.observers[1]).guaranteed, 0.0147, 5e-4);
  for (const BankDisturbance& disturbance : result.bank.disturbances) {
    EXPECT_EQ(disturbance.treatment, BankDisturbance::Treatment::kDecoupled);
  }
}

TEST(UioDesign, TellsFaultsApartByTheOneThatFades) {
  const std::string estimate =
      "[uio.estimate]\nfaults = [\"y1\"]\ndrift_per_s = 0.5\nalpha = [0.95]\n";
  const DesignResult carried = design_bank(
      flexible_joint_euler(), joint_request("carry = [\"y1\"]\ndrift_per_s = 0.1\nalpha = [0.9]\n" +
                                            kMultiplier + estimate));
  EXPECT_TRUE(carried.are_signatures_distinct);
  // Without it both residuals see both faults for ever.
  const DesignResult plain = design_bank(flexible_joint_euler(),
                                         joint_request("alpha = [0.9]\n" + kMultiplier + estimate));
  EXPECT_FALSE(plain.are_signatures_distinct);
  ASSERT_EQ(plain.indistinguishable.size(), 1u);
  EXPECT_THAT(plain.indistinguishable[0], ElementsAre(FaultSet{0}, FaultSet{1}));
}

TEST(UioDesign, RefusesWhatThePlantHasNot) {
  const PlantModel plant = flexible_joint_euler();
  EXPECT_THAT(refusal(plant, joint_request("detect = [\"u2\"]")),
              HasSubstr("detect: found \"u2\", expected faults of plant"));
  EXPECT_THAT(refusal(plant, joint_request("detect = [\"u1\", \"u1\"]")), HasSubstr("twice"));
  EXPECT_THAT(refusal(plant, joint_request("detect = [\"y1\"]\ncarry = [\"y1\"]\ndrift_per_s = 1")),
              HasSubstr("which is to be detected too"));
  BankRequest request = joint_request("");
  request.decouple = {"zd9"};
  EXPECT_THAT(refusal(plant, request), HasSubstr("found \"zd9\""));
  request = joint_request("");
  request.concurrent = 3;
  EXPECT_THAT(refusal(plant, request), HasSubstr("at most the plant's 2 faults"));
}

TEST(UioDesign, RefusesToDecoupleWhatNoOutputShowsWithinASample) {
  PlantModel plant = flexible_joint_euler();
  for (Disturbance& disturbance : plant.disturbances) {
    disturbance.state << 0, 0, 1, -1;  // C D = 0
  }
  EXPECT_THAT(refusal(plant, joint_request("decoupling = \"full\"")),
              HasSubstr("no direction of the plant's disturbances reaches the outputs"));
  BankRequest request = joint_request("");
  request.decouple = {"zd1"};
  EXPECT_THAT(refusal(plant, request), HasSubstr("rank(C D) must be rank(D)"));
  plant.disturbances[0].output << 1, 0, 0;
  EXPECT_THAT(refusal(plant, request), HasSubstr("acts on the outputs themselves"));
}

TEST(UioDesign, SaysThatAnUnseenUnstableModeCannotBeObserved) {
  PlantModel plant = flexible_joint_euler();
  plant.C.setZero();
  plant.C(0, 1) = 1.0;  // speed only: the angles' common drift is not seen
  plant.nonlinearities.clear();
  const DesignResult result =
      design_bank(plant, joint_request("decoupling = \"none\"\nalpha = [0.9]\n"));
  EXPECT_FALSE(result.is_solvable);
  ASSERT_FALSE(result.observers[0].trials.empty());
  EXPECT_THAT(result.observers[0].trials[0].reason, HasSubstr("which no gain makes stable"));
}

}  // namespace
}  // namespace faultline
