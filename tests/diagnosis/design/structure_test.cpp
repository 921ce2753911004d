#include "diagnosis/design/structure.h"

#include <algorithm>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "diagnosis/design/design_bank.h"
#include "diagnosis/runtime/decision.h"
#include "tests/diagnosis/hou_plant.h"

namespace faultline {
namespace {

using ::testing::HasSubstr;

constexpr Sensitivity kNone = Sensitivity::kNone;
constexpr Sensitivity kSteady = Sensitivity::kSteady;

/// One residual per set of faults; it sees all others.
Structure structure_of(std::size_t fault_count, const std::vector<FaultSet>& sets) {
  Structure structure;
  for (const FaultSet& ignores : sets) {
    std::vector<Sensitivity> row(fault_count, kSteady);
    for (const std::size_t j : ignores) {
      row[j] = kNone;
    }
    structure.push_back(row);
  }
  return structure;
}

/// Whether the decision names every set of up to p faults from its generic signature.
bool isolates(const Structure& structure, const std::vector<std::size_t>& chosen, std::size_t k,
              std::size_t p) {
  Bank bank;
  bank.concurrent = p;
  bank.fault_names.resize(k);
  for (const std::size_t i : chosen) {
    ResidualFilter filter;
    filter.sees = structure[i];
    bank.filters.push_back(filter);
  }
  const DecisionTable table(bank);
  for (std::size_t s = 0; s < table.sets().size(); ++s) {
    std::vector<std::uint64_t> signature((chosen.size() + 63) / 64);
    for (std::size_t i = 0; i < chosen.size(); ++i) {
      const bool fires =
          std::any_of(table.sets()[s].begin(), table.sets()[s].end(),
                      [&](std::size_t j) { return bank.filters[i].sees[j] != kNone; });
      signature[i / 64] |= std::uint64_t{fires} << (i % 64);
    }
    const Decision decision = table.decide(signature);
    if (decision.set_count != 1 || decision.sets[0] != s) {
      return false;
    }
  }
  return true;
}

TEST(Structure, NamesResidualsByWhatTheyIgnore) {
  EXPECT_EQ(residual_name({0, 1}, 4), "r12");
  EXPECT_EQ(residual_name({0, 11}, 12), "r1_12");
  EXPECT_EQ(residual_name({}, 4), "r0");
}

TEST(Structure, SmallestIsolatesAndNoSmallerChoiceDoes) {
  struct Case {
    std::size_t faults, concurrent, outputs;
  };
  for (const auto& [k, p, q] : {Case{3, 1, 2}, Case{4, 1, 2}, Case{6, 1, 2}, Case{4, 1, 4},
                                Case{5, 1, 3}, Case{4, 2, 3}, Case{4, 2, 4}, Case{5, 2, 4}}) {
    SCOPED_TRACE(testing::Message() << k << " faults, " << p << " at a time, " << q << " outputs");
    const Structure structure = structure_of(k, candidate_sets(k, p, q));
    const ResidualChoice choice = smallest_structure(structure, k, p);
    EXPECT_TRUE(choice.is_proved_smallest);
    EXPECT_TRUE(isolates(structure, choice.residuals, k, p));
    // By brute force: no choice of one residual fewer isolates.
    for (const FaultSet& fewer : combinations(structure.size(), choice.residuals.size() - 1)) {
      EXPECT_FALSE(isolates(structure, fewer, k, p));
    }
  }
}

TEST(Structure, SmallestOfManyFaultsIsOneResidualPerFaultIfTheOutputsAllowIt) {
  // Ten faults, three at a time: 120 sets to ignore, but ten residuals that each see one fault do.
  const Structure structure = structure_of(10, candidate_sets(10, 3, 12));
  const ResidualChoice choice = smallest_structure(structure, 10, 3);
  EXPECT_LE(choice.residuals.size(), 10u);
  EXPECT_TRUE(isolates(structure, choice.residuals, 10, 3));
}

TEST(Structure, NeedsEveryPairIgnoredWhereFaultsMayCancel) {
  // {1,2} and {3,4}: only a residual that ignores 3 and 4 fires for the first and not the second.
  const Structure structure = structure_of(5, candidate_sets(5, 2, 3));
  EXPECT_EQ(smallest_structure(structure, 5, 2).residuals.size(), 10u);
}

TEST(Structure, FindsWhatHasOneSignature) {
  // Faults 0 and 2 are seen alike.
  const Structure structure = {{kSteady, kNone, kSteady}, {kNone, kSteady, kNone}};
  const auto groups = indistinguishable_sets(structure, 3, 1);
  ASSERT_EQ(groups.size(), 1u);
  EXPECT_EQ(groups[0], (std::vector<FaultSet>{{0}, {2}}));
}

TEST(Structure, GivenSetsMakeTheBank) {
  BankRequest request = hou_request();
  request.structure = StructureChoice::kGiven;
  request.ignored_sets = {{"u3"}, {"u2", "u1"}, {}};
  request.poles = {-10.0, -11.0, -12.0};
  const DesignResult result = design_bank(hou_plant(), request);
  EXPECT_TRUE(result.is_solvable);
  ASSERT_EQ(result.bank.filters.size(), 3u);
  EXPECT_EQ(result.bank.filters[0].name, "r3");
  EXPECT_EQ(result.bank.filters[1].name, "r12");
  EXPECT_EQ(result.bank.filters[2].name, "r0");
  EXPECT_EQ(result.bank.filters[2].F.rows(), 3);
  EXPECT_FALSE(result.are_signatures_distinct);
}

TEST(Structure, SmallestBankOfHousPlantStillTellsAllPairsApart) {
  BankRequest request = hou_request();
  request.structure = StructureChoice::kSmallest;
  const DesignResult result = design_bank(hou_plant(), request);
  EXPECT_TRUE(result.is_solvable);
  EXPECT_TRUE(result.are_signatures_distinct);
  EXPECT_EQ(result.candidate_count, 6u);
  EXPECT_LE(result.bank.filters.size(), 6u);
  EXPECT_EQ(result.bank.filters.size(), result.residuals.size());
}

TEST(Structure, GivenSetsAreChecked) {
  const auto refusal = [](std::vector<std::vector<std::string>> sets) {
    BankRequest request = hou_request();
    request.structure = StructureChoice::kGiven;
    request.ignored_sets = std::move(sets);
    try {
      static_cast<void>(design_bank(hou_plant(), request));
    } catch (const InputError& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  EXPECT_THAT(refusal({{"u9"}}), HasSubstr("found \"u9\", expected names of the plant's faults"));
  EXPECT_THAT(refusal({{"u1", "u1"}}), HasSubstr("each fault once"));
  EXPECT_THAT(refusal({{"u1", "u2"}, {"u2", "u1"}}), HasSubstr("expected different sets"));
  EXPECT_THAT(refusal({{"u1", "u2", "u3", "u4"}}), HasSubstr("leaves a fault to be seen"));
  EXPECT_THAT(refusal({}), HasSubstr("found no set"));
}

}  // namespace
}  // namespace faultline
