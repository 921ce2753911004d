#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "diagnosis/design/bank_request.h"
#include "tests/diagnosis/flexible_joint.h"

namespace faultline {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

std::string refusal(const std::string& uio) {
  try {
    static_cast<void>(joint_request(uio));
  } catch (const InputError& error) {
    return error.what();
  }
  return "accepted";
}

TEST(UioRequest, ReadsEveryOption) {
  const BankRequest request = joint_request(R"(
detect = ["u1"]
criterion = "l_infinity"
weight = "full"
band_rad = [0.2, 1.5]
a_0 = [-0.05, 0.5]
v = [1, 10]
carry = ["y1"]
drift_per_s = 0.1
alpha = [0.9]
decoupling = "none"
[uio.estimate]
faults = ["y1"]
drift_per_s = 0.5
alpha = [0.95]
decoupling = "full"
)");
  EXPECT_EQ(request.domain, DesignDomain::kSampled);
  const UioRequest& uio = request.uio;
  EXPECT_THAT(uio.detect, ElementsAre("u1"));
  EXPECT_FALSE(uio.is_h_minus);
  EXPECT_TRUE(uio.is_weight_full);
  EXPECT_EQ(uio.band_low_rad, 0.2);
  EXPECT_EQ(uio.band_high_rad, 1.5);
  EXPECT_THAT(uio.a_0, ElementsAre(-0.05, 0.5));
  EXPECT_THAT(uio.v, ElementsAre(1, 10));
  EXPECT_THAT(uio.detection.carry, ElementsAre("y1"));
  EXPECT_EQ(uio.detection.drift_per_s, 0.1);
  EXPECT_THAT(uio.detection.alpha, ElementsAre(0.9));
  EXPECT_EQ(uio.detection.decoupling, DecouplingChoice::kNone);
  EXPECT_THAT(uio.estimation.carry, ElementsAre("y1"));
  EXPECT_EQ(uio.estimation.drift_per_s, 0.5);
  EXPECT_EQ(uio.estimation.decoupling, DecouplingChoice::kFull);
  EXPECT_FALSE(uio.is_threshold_quadratic);
}

TEST(UioRequest, NeedsNoSectionOfItsOwn) {
  const BankRequest request = joint_request("");
  EXPECT_TRUE(request.uio.is_h_minus);
  EXPECT_EQ(request.uio.detection.decoupling, DecouplingChoice::kBest);
  EXPECT_TRUE(request.uio.estimation.carry.empty());
}

TEST(UioRequest, RefusesWhatMeansNothing) {
  EXPECT_THAT(
      refusal("band_rad = [0.1, 3.2]"),
      HasSubstr("uio.band_rad: found [0.1, 3.2], expected [lowest, highest] within 0 .. pi"));
  EXPECT_THAT(refusal("band_rad = [-0.1, 1]"), HasSubstr("within 0 .. pi"));
  EXPECT_THAT(refusal("band_rad = [0.2, 0.1]"), HasSubstr("[lowest, highest]"));
  EXPECT_THAT(refusal("alpha = [1.0]"), HasSubstr("expected numbers between 0 and 1"));
  EXPECT_THAT(refusal("alpha = []"), HasSubstr("expected 1 to 100"));
  EXPECT_THAT(refusal("v = [0]"), HasSubstr("expected positive numbers"));
  EXPECT_THAT(refusal("carry = [\"y1\"]\ndrift_per_s = 0"),
              HasSubstr("expected a positive number"));
  EXPECT_THAT(refusal("carry = [\"y1\"]"), HasSubstr("drift_per_s"));
  EXPECT_THAT(refusal("[uio.estimate]\nfaults = []"), HasSubstr("expected the faults to be"));
  EXPECT_THAT(refusal("criterion = \"h2\""), HasSubstr("criterion"));
  EXPECT_THAT(refusal("polse = [1]"), HasSubstr("polse"));
}

TEST(UioRequest, TakesNoThresholdAsANumberAndNoContinuousDomain) {
  const std::string head =
      "schema = 1\nname = \"a\"\nplant = \"p\"\nmethod = \"uio\"\nsample_time_s = 0.01\n";
  EXPECT_THROW(static_cast<void>(parse_bank_request(head + "[decision]\nthreshold = 0.1\n", "b")),
               InputError);
  EXPECT_THROW(
      static_cast<void>(parse_bank_request(head + "domain = \"continuous\"\n[decision]\n", "b")),
      InputError);
  const BankRequest euler =
      parse_bank_request(head + "domain = \"euler\"\n[decision]\nthreshold = \"quadratic\"\n", "b");
  EXPECT_EQ(euler.domain, DesignDomain::kEuler);
  EXPECT_TRUE(euler.uio.is_threshold_quadratic);
}

}  // namespace
}  // namespace faultline
