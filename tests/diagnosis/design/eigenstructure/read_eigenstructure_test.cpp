#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "diagnosis/design/bank_request.h"

namespace faultline {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

std::string bank_text(const std::string& options) {
  return "schema = 1\nname = \"b\"\nplant = \"plant.toml\"\nmethod = \"eigenstructure\"\n"
         "poles = [-1]\nsample_time_s = 0.01\nstructure = \"dedicated\"\n"
         "[decision]\nthreshold = 0.5\n" +
         options;
}

std::string refusal(const std::string& options) {
  try {
    static_cast<void>(parse_bank_request(bank_text(options), "bank.toml"));
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

TEST(ReadEigenstructure, TakesEveryOption) {
  const BankRequest request = parse_bank_request(
      bank_text("[eigenstructure]\nassignment = \"left\"\nweaken = [\"d1\", \"d2\"]\n"
                "criterion = \"rms\"\nrows = 2\n"),
      "bank.toml");
  EXPECT_EQ(request.structure, StructureChoice::kDedicated);
  EXPECT_EQ(request.eigenstructure.assignment, AssignmentChoice::kLeft);
  EXPECT_THAT(request.eigenstructure.weaken, ElementsAre("d1", "d2"));
  EXPECT_EQ(request.eigenstructure.criterion, CompromiseCriterion::kRms);
  EXPECT_EQ(request.eigenstructure.rows, 2u);
}

TEST(ReadEigenstructure, NeedsNone) {
  const BankRequest request = parse_bank_request(bank_text(""), "bank.toml");
  EXPECT_EQ(request.eigenstructure.assignment, AssignmentChoice::kBest);
  EXPECT_TRUE(request.eigenstructure.weaken.empty());
  EXPECT_EQ(request.eigenstructure.criterion, CompromiseCriterion::kWorstCase);
  EXPECT_FALSE(request.eigenstructure.rows);
}

TEST(ReadEigenstructure, RefusesWhatMakesNoSense) {
  EXPECT_THAT(refusal("[eigenstructure]\nassignment = \"up\"\n"), HasSubstr("\"geometric\""));
  EXPECT_THAT(refusal("[eigenstructure]\ncriterion = \"rms\"\n"),
              HasSubstr("found it without \"weaken\""));
  EXPECT_THAT(refusal("[eigenstructure]\nweaken = [\"d\"]\nrows = 0\n"),
              HasSubstr("expected a whole number from 1"));
  EXPECT_THAT(refusal("[eigenstructure]\nweaken = [\"d\"]\ncriterion = \"fast\"\n"),
              HasSubstr("\"low_rank\""));
  EXPECT_THAT(refusal("[eigenstructure]\nweakn = [\"d\"]\n"), HasSubstr("weakn"));
}

}  // namespace
}  // namespace faultline
