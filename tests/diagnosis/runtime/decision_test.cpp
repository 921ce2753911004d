#include "diagnosis/runtime/decision.h"

#include <array>
#include <string>

#include <gtest/gtest.h>

#include "tests/diagnosis/hou_plant.h"
#include "tests/support/allocation_guard.h"

namespace faultline {
namespace {

using Sets = std::vector<std::vector<std::size_t>>;

/// One row of the structure matrix per residual: '.' does not see, 't' transient, 'x' steady.
Bank bank_of(const std::vector<std::string>& structure, std::size_t concurrent) {
  Bank bank;
  bank.concurrent = concurrent;
  bank.fault_names.resize(structure.front().size());
  for (const std::string& row : structure) {
    ResidualFilter filter;
    for (const char cell : row) {
      filter.sees.push_back(cell == '.'   ? Sensitivity::kNone
                            : cell == 't' ? Sensitivity::kTransient
                                          : Sensitivity::kSteady);
    }
    bank.filters.push_back(filter);
  }
  return bank;
}

/// Hou's residuals r12, r13, r14, r23, r24, r34.
Bank hou_structure() { return bank_of({"..xx", ".x.x", ".xx.", "x..x", "x.x.", "xx.."}, 2); }

/// The verdict when the residuals marked '1' have fired, and the sets it names.
struct Answer {
  Decision decision;
  Sets sets;
};
/// 'P': persistent.
Answer answer(const Bank& bank, const std::string& fired) {
  const DecisionTable table(bank);
  std::vector<std::uint64_t> signature((fired.size() + 63) / 64), persistent = signature;
  for (std::size_t i = 0; i < fired.size(); ++i) {
    signature[i / 64] |= std::uint64_t{fired[i] != '0'} << (i % 64);
    persistent[i / 64] |= std::uint64_t{fired[i] == 'P'} << (i % 64);
  }
  Answer result{table.decide(signature, persistent), {}};
  for (std::uint32_t s = 0; s < std::min<std::size_t>(result.decision.set_count, 8); ++s) {
    result.sets.push_back(table.sets()[result.decision.sets[s]]);
  }
  return result;
}

TEST(DecisionTable, ListsSetsBySizeThenLexicographically) {
  const DecisionTable table(bank_of({"xxx"}, 2));
  EXPECT_EQ(table.sets(), (Sets{{}, {0}, {1}, {2}, {0, 1}, {0, 2}, {1, 2}}));
}

TEST(DecisionTable, IsHealthyWhenNothingFired) {
  const Answer found = answer(hou_structure(), "000000");
  EXPECT_EQ(found.decision.verdict, Verdict::kHealthy);
  EXPECT_EQ(found.sets, (Sets{{}}));
}

TEST(DecisionTable, IsolatesAllRowsOfHousTable) {
  const Sets faults = {{0}, {1}, {2}, {3}, {0, 1}, {0, 2}, {0, 3}, {1, 2}, {1, 3}, {2, 3}};
  const std::vector<std::string> fired = {"000111", "011001", "101010", "110100", "011111",
                                          "101111", "110111", "111011", "111101", "111110"};
  for (std::size_t i = 0; i < faults.size(); ++i) {
    const Answer found = answer(hou_structure(), fired[i]);
    EXPECT_EQ(found.decision.verdict, Verdict::kIsolated) << fired[i];
    EXPECT_EQ(found.sets, (Sets{faults[i]})) << fired[i];
  }
}

TEST(DecisionTable, PrefersTheSmallestSet) {
  // All of {0, 1, 2} contain what fault 0 explains alone.
  const Answer found = answer(bank_of({"x..", "x..", ".x.", "..x"}, 3), "1100");
  EXPECT_EQ(found.decision.verdict, Verdict::kIsolated);
  EXPECT_EQ(found.sets, (Sets{{0}}));
}

TEST(DecisionTable, AllowsTwoMembersToCancel) {
  // F2 and F3 cancel in r14; F1 and F4 in r23 would look the same.
  const Answer found = answer(hou_structure(), "110011");
  EXPECT_EQ(found.decision.verdict, Verdict::kAmbiguous);
  EXPECT_EQ(found.sets, (Sets{{0, 3}, {1, 2}}));
}

TEST(DecisionTable, IsAmbiguousWhenSeveralSmallestSetsExplain) {
  // (F1, F2) = (4, 2) and (F3, F4) = (2, 2).
  const Answer found = answer(hou_structure(), "011110");
  EXPECT_EQ(found.decision.verdict, Verdict::kAmbiguous);
  EXPECT_EQ(found.decision.set_count, 2u);
  EXPECT_EQ(found.sets, (Sets{{0, 1}, {2, 3}}));
}

TEST(DecisionTable, NamesTheSmallestSetsThatCouldHaveLeftAPartialSignature) {
  // F1 = 1 in Hou's bank as published fires r23 alone; so would a small F4.
  const Answer one = answer(hou_structure(), "000100");
  EXPECT_EQ(one.decision.verdict, Verdict::kUnexplained);
  EXPECT_EQ(one.decision.cause, Cause::kPartial);
  EXPECT_EQ(one.sets, (Sets{{0}, {3}}));
  // r13 and r14 see F2 both; only r34, which has to fire on it, is silent.
  const Answer two = answer(hou_structure(), "011000");
  EXPECT_EQ(two.decision.verdict, Verdict::kUnexplained);
  EXPECT_EQ(two.decision.cause, Cause::kPartial);
  EXPECT_EQ(two.sets, (Sets{{1}}));
}

TEST(DecisionTable, LeavesMoreThanPFaultsUnexplained) {
  const Answer pairs = answer(hou_structure(), "111111");
  EXPECT_EQ(pairs.decision.verdict, Verdict::kUnexplained);
  EXPECT_EQ(pairs.decision.cause, Cause::kMoreThanP);
  EXPECT_EQ(pairs.decision.set_count, 0u);
  const Answer single = answer(bank_of({"x.", ".x"}, 1), "11");
  EXPECT_EQ(single.decision.cause, Cause::kMoreThanP);
}

TEST(DecisionTable, HasNoCauseForBeingHealthy) {
  EXPECT_EQ(answer(hou_structure(), "000000").decision.cause, Cause::kNone);
}

TEST(DecisionTable, CallsASignatureCompleteWhenEveryResidualThatSeesTheSetFired) {
  EXPECT_EQ(answer(hou_structure(), "000111").decision.cause, Cause::kComplete);
  EXPECT_EQ(answer(hou_structure(), "111011").decision.cause, Cause::kComplete);
}

TEST(DecisionTable, CallsASilentResidualThatSeesTwoMembersACancellation) {
  EXPECT_EQ(answer(hou_structure(), "110011").decision.cause, Cause::kCancellation);
  // One of the two fades: the other alone would have fired, had they not cancelled at first.
  const Answer mixed = answer(bank_of({"xt", "x.", ".x"}, 2), "011");
  EXPECT_EQ(mixed.decision.verdict, Verdict::kIsolated);
  EXPECT_EQ(mixed.decision.cause, Cause::kCancellation);
}

TEST(DecisionTable, CallsASilentResidualThatSeesItsMembersInTransientsTransient) {
  const Bank bank = bank_of({"tt", "x.", ".x"}, 2);
  EXPECT_EQ(answer(bank, "010").decision.cause, Cause::kTransient);
  EXPECT_EQ(answer(bank, "011").decision.cause, Cause::kTransient);
  EXPECT_EQ(answer(bank, "110").decision.cause, Cause::kComplete);
}

TEST(DecisionTable, NamesCancellationWhereBothExcusesAreNeeded) {
  const Bank bank = bank_of({"t.", "xx", "x.", ".x"}, 2);
  EXPECT_EQ(answer(bank, "0011").decision.cause, Cause::kCancellation);
}

TEST(DecisionTable, AcceptsTheSilenceOfAResidualThatSeesAFaultOnlyInTransients) {
  const Bank bank = bank_of({"tx", "x."}, 1);
  EXPECT_EQ(answer(bank, "01").sets, (Sets{{0}}));
  EXPECT_EQ(answer(bank, "11").sets, (Sets{{0}}));
  EXPECT_EQ(answer(bank, "10").sets, (Sets{{1}}));
}

TEST(DecisionTable, LetsAPersistentResidualSeeAMemberAtDc) {
  // An actuator that both see, a sensor that the first sees in transients.
  const Bank bank = bank_of({"xt", "xx"}, 1);
  const Answer young = answer(bank, "11");
  EXPECT_EQ(young.decision.verdict, Verdict::kAmbiguous);
  EXPECT_EQ(young.sets, (Sets{{0}, {1}}));
  const Answer old = answer(bank, "P1");
  EXPECT_EQ(old.decision.verdict, Verdict::kIsolated);
  EXPECT_EQ(old.decision.cause, Cause::kComplete);
  EXPECT_EQ(old.sets, (Sets{{0}}));
  const Answer gone = answer(bank, "01");
  EXPECT_EQ(gone.decision.cause, Cause::kTransient);
  EXPECT_EQ(gone.sets, (Sets{{1}}));
  // The second, silent, must fire for the actuator.
  const Answer partial = answer(bank, "P0");
  EXPECT_EQ(partial.decision.cause, Cause::kPartial);
  EXPECT_EQ(partial.sets, (Sets{{0}}));
}

TEST(DecisionTable, LeavesAPersistentResidualThatSeesOnlyTransientsUnexplained) {
  const Bank bank = bank_of({"t.", "xx"}, 1);
  EXPECT_EQ(answer(bank, "11").sets, (Sets{{0}}));
  EXPECT_EQ(answer(bank, "P1").decision.cause, Cause::kMoreThanP);
}

TEST(DecisionTable, TakesALargerSetForAPersistentResidual) {
  // Of the sensors the first residual sees the first in transients, the second at DC.
  const Bank bank = bank_of({"tx", "x.", ".x"}, 2);
  EXPECT_EQ(answer(bank, "110").sets, (Sets{{0}}));
  EXPECT_EQ(answer(bank, "P10").decision.cause, Cause::kPartial);
  EXPECT_EQ(answer(bank, "P11").sets, (Sets{{0, 1}}));
}

TEST(DecisionTable, ReadsPersistenceOfSeveralWords) {
  std::vector<std::string> structure(70, "xx");
  structure[69] = "xt";
  EXPECT_EQ(answer(bank_of(structure, 1), std::string(70, '1')).sets, (Sets{{0}, {1}}));
  EXPECT_EQ(answer(bank_of(structure, 1), std::string(69, '1') + "P").sets, (Sets{{0}}));
}

TEST(DecisionTable, CountsAllSetsButListsEight) {
  const Answer found = answer(bank_of({std::string(10, 'x')}, 1), "1");
  EXPECT_EQ(found.decision.verdict, Verdict::kAmbiguous);
  EXPECT_EQ(found.decision.set_count, 10u);
  EXPECT_EQ(found.sets.size(), Decision::kMaxListed);
}

TEST(DecisionTable, ReadsSignaturesOfSeveralWords) {
  std::vector<std::string> structure(70, "x.");
  structure[69] = ".x";
  EXPECT_EQ(answer(bank_of(structure, 1), std::string(69, '0') + "1").sets, (Sets{{1}}));
}

TEST(Verdict, HasANameForEachValue) {
  EXPECT_EQ(verdict_name(Verdict::kHealthy), "healthy");
  EXPECT_EQ(verdict_name(Verdict::kIsolated), "isolated");
  EXPECT_EQ(verdict_name(Verdict::kAmbiguous), "ambiguous");
  EXPECT_EQ(verdict_name(Verdict::kUnexplained), "unexplained");
  EXPECT_EQ(verdict_name(Verdict::kInhibited), "inhibited");
}

TEST(Cause, HasANameForEachValue) {
  EXPECT_EQ(cause_name(Cause::kNone), "none");
  EXPECT_EQ(cause_name(Cause::kComplete), "complete");
  EXPECT_EQ(cause_name(Cause::kCancellation), "cancellation");
  EXPECT_EQ(cause_name(Cause::kTransient), "transient");
  EXPECT_EQ(cause_name(Cause::kPartial), "partial");
  EXPECT_EQ(cause_name(Cause::kMoreThanP), "more_than_p");
}

Decision decision_of(Verdict verdict) {
  Decision decision;
  decision.verdict = verdict;
  return decision;
}

TEST(Settling, AnnouncesASignatureOnceItHasStood) {
  Settling settling({.settle = 3}, 1);
  const std::array<std::uint64_t, 1> none = {0}, some = {5}, other = {7};
  EXPECT_EQ(settling.announced().verdict, Verdict::kInhibited);
  for (int k = 0; k < 3; ++k) {
    settling.step(decision_of(Verdict::kHealthy), none);
  }
  EXPECT_EQ(settling.announced().verdict, Verdict::kHealthy);
  settling.step(decision_of(Verdict::kUnexplained), some);
  settling.step(decision_of(Verdict::kUnexplained), some);
  EXPECT_EQ(settling.announced().verdict, Verdict::kHealthy);
  for (int k = 0; k < 2; ++k) {
    EXPECT_EQ(settling.step(decision_of(Verdict::kIsolated), other).verdict, Verdict::kHealthy);
  }
  EXPECT_EQ(settling.step(decision_of(Verdict::kIsolated), other).verdict, Verdict::kIsolated);
}

TEST(Settling, AnnouncesInhibitionAtOnceAndKeepsItUntilASignatureHasStood) {
  Settling settling({.settle = 2}, 1);
  const std::array<std::uint64_t, 1> none = {0};
  settling.step(decision_of(Verdict::kHealthy), none);
  settling.step(decision_of(Verdict::kHealthy), none);
  EXPECT_EQ(settling.step(decision_of(Verdict::kInhibited), none).verdict, Verdict::kInhibited);
  EXPECT_EQ(settling.step(decision_of(Verdict::kHealthy), none).verdict, Verdict::kInhibited);
  EXPECT_EQ(settling.step(decision_of(Verdict::kHealthy), none).verdict, Verdict::kHealthy);
}

TEST(Settling, AnnouncesAnotherDecisionOfTheSameSignatureOnceThatHasStood) {
  Settling settling({.settle = 3}, 1);
  const std::array<std::uint64_t, 1> some = {3};
  for (int k = 0; k < 10; ++k) settling.step(decision_of(Verdict::kAmbiguous), some);
  for (int k = 0; k < 2; ++k) {
    EXPECT_EQ(settling.step(decision_of(Verdict::kIsolated), some).verdict, Verdict::kAmbiguous);
    EXPECT_FALSE(settling.has_settled());
  }
  EXPECT_EQ(settling.step(decision_of(Verdict::kIsolated), some).verdict, Verdict::kIsolated);
  EXPECT_TRUE(settling.has_settled());
}

TEST(Settling, KeepsAnAnnouncedSignatureForAnyLength) {
  Settling settling({.settle = 2}, 1);
  const std::array<std::uint64_t, 1> none = {0};
  for (int k = 0; k < 100; ++k) {
    settling.step(decision_of(Verdict::kHealthy), none);
    EXPECT_EQ(settling.announced().verdict, k == 0 ? Verdict::kInhibited : Verdict::kHealthy);
  }
}

TEST(Decision, DoesNotTouchTheHeapInAThousandSteps) {
  const DecisionTable table(hou_structure());
  Settling settling({.settle = 3}, 1);
  const AllocationGuard guard;
  for (std::uint64_t k = 0; k < 1000; ++k) {
    const std::array<std::uint64_t, 1> signature = {(k / 5) % 64};
    settling.step(table.decide(signature), signature);
    if (k % 300 == 0) {
      settling.reset();
    }
  }
  const std::uint64_t heap_calls = guard.heap_calls();
  EXPECT_EQ(heap_calls, 0u);
}

TEST(Settling, DoesNotLetAFaultTurnIntoAnotherWhileResidualsClear) {
  Settling settling({.settle = 2, .clearing = 5}, 1);
  const Decision actuator{.verdict = Verdict::kIsolated, .set_count = 1, .sets = {1}};
  const Decision sensor{.verdict = Verdict::kIsolated, .set_count = 1, .sets = {2}};
  const Decision either{.verdict = Verdict::kAmbiguous, .set_count = 2, .sets = {1, 2}};
  const Decision healthy{.verdict = Verdict::kHealthy, .set_count = 1};
  const auto steps = [&](const Decision& decision, std::uint64_t signature, int count) {
    const std::array<std::uint64_t, 1> word{signature};
    for (int i = 0; i < count; ++i) settling.step(decision, word);
    return settling.announced();
  };
  EXPECT_EQ(steps(actuator, 0b11, 2), actuator);
  // One of two residuals has cleared; what is left would name the sensor.
  EXPECT_EQ(steps(sensor, 0b10, 4), actuator);
  EXPECT_FALSE(settling.has_settled());
  EXPECT_EQ(steps(healthy, 0b00, 2), healthy);  // .. but it clears, too
  EXPECT_EQ(steps(actuator, 0b11, 2), actuator);
  EXPECT_EQ(steps(sensor, 0b10, 5), sensor);  // it stays: it is the sensor
  // Out of an ambiguous one a set is chosen at once, and so is one that a new residual names.
  EXPECT_EQ(steps(either, 0b11, 2), either);
  EXPECT_EQ(steps(sensor, 0b10, 2), sensor);
  EXPECT_EQ(steps(actuator, 0b01, 2), actuator);
}

}  // namespace
}  // namespace faultline
