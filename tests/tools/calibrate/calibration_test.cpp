#include "tools/calibrate/calibration.h"

#include <array>
#include <cmath>
#include <random>
#include <string>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "diagnosis/bank/bank_file.h"
#include "diagnosis/certify/certify.h"
#include "diagnosis/certify/check.h"
#include "diagnosis/design/design_bank.h"
#include "diagnosis/model/plant_file.h"
#include "diagnosis/runtime/residual_bank.h"
#include "tests/diagnosis/hou_plant.h"
#include "tests/support/random_seed.h"

namespace faultline {
namespace {

using testing::HasSubstr;

class CalibrationTest : public testing::Test {
 protected:
  static Bank bank(const std::string& decision = "threshold = \"calibrated\"\n") {
    std::string request = hou_request_text(true, 3);
    const std::size_t at = request.find("threshold = 0.05\n");
    request.replace(at, std::string("threshold = 0.05\n").size(), decision);
    Bank result = design_bank(plant(), parse_bank_request(request, "bank.toml")).bank;
    certify(plant(), result);
    return result;
  }
  static PlantModel plant() {
    return parse_plant(hou_plant_text() +
                           "[[noise]]\noutput = [1, 0, 0]\nsigma = 0.01\n"
                           "[[noise]]\noutput = [0, 1, 0]\nsigma = 0.01\n"
                           "[[noise]]\noutput = [0, 0, 1]\nsigma = 0.01\n",
                       "plant.toml");
  }
  // At rest, with noise.
  RecordedStretch noise(Eigen::Index samples) {
    RecordedStretch stretch{Eigen::MatrixXd(3, samples), Eigen::MatrixXd::Zero(4, samples)};
    for (Eigen::Index k = 0; k < samples; ++k) {
      for (Eigen::Index i = 0; i < 3; ++i) stretch.y(i, k) = 0.01 * normal_(draw_);
    }
    return stretch;
  }
  static std::string refusal(const std::vector<RecordedStretch>& record, double far,
                             Bank one = bank()) {
    try {
      calibrate(plant(), record, {.false_alarms_per_h = far}, one);
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "";
  }

  std::mt19937_64 draw_{test_seed(20261215)};
  std::normal_distribution<double> normal_;
};

TEST_F(CalibrationTest, LetsTheBankAlarmAsOftenAsAsked) {
  Bank calibrated = bank();
  // 40 minutes in four pieces, of which 28 are fitted.
  std::vector<RecordedStretch> record;
  for (int i = 0; i < 4; ++i) record.push_back(noise(60'000));
  calibrate(plant(), record, {.false_alarms_per_h = 6.0}, calibrated);
  EXPECT_EQ(calibrated.thresholds.kind, ThresholdBasis::Kind::kCalibrated);
  // Twenty hours of noise through the bank: alarms, half a second apart or more.
  ResidualBank filters(calibrated);
  const std::size_t count = calibrated.filters.size();
  std::vector<std::uint32_t> above(count), quiet(count, 1000);
  std::vector<double> alarms(count);
  std::vector<double> u(4);
  constexpr int kSamples = 7'200'000;
  for (int k = 0; k < kSamples; ++k) {
    const std::array y = {0.01 * normal_(draw_), 0.01 * normal_(draw_), 0.01 * normal_(draw_)};
    filters.step(y, u);
    for (std::size_t f = 0; f < count; ++f) {
      above[f] = filters.evaluation()[f] > filters.thresholds()[f] ? above[f] + 1 : 0;
      ++quiet[f];
      if (above[f] < calibrated.decision.dwell) continue;
      if (quiet[f] > 50) alarms[f] += 1.0;
      quiet[f] = 0;
    }
  }
  int held = 0;
  for (std::size_t f = 0; f < count; ++f) {
    const Calibration& c = calibrated.filters[f].calibration.value();
    EXPECT_NEAR(c.false_alarms_per_h, 1.0, 1e-9);
    EXPECT_LT(c.rate_low_per_h, 1.0);
    EXPECT_GT(c.rate_high_per_h, 1.0);
    EXPECT_NEAR(c.hours, 0.7 * 4.0 / 6.0, 0.01);
    // The count is uncertain itself, by two deviations.
    const double rate = alarms[f] / 20.0, error = 2.0 * std::sqrt(alarms[f] + 1.0) / 20.0;
    held += rate + error >= c.rate_low_per_h && rate - error <= c.rate_high_per_h ? 1 : 0;
  }
  EXPECT_GE(held, 5);
  // The file keeps it, and its certificates are those of the new thresholds.
  const Bank again = parse_bank(bank_text(calibrated), "b.json");
  EXPECT_EQ(bank_text(again), bank_text(calibrated));
  for (const CheckFinding& finding : check_bank(plant(), again).findings) {
    ADD_FAILURE() << sentence(finding);
  }
}

TEST_F(CalibrationTest, OfASequentialTest) {
  Bank calibrated = bank("threshold = \"calibrated\"\ntest = \"cusum\"\n");
  calibrate(plant(), {noise(400'000)}, {.false_alarms_per_h = 6.0}, calibrated);
  for (const ResidualFilter& filter : calibrated.filters) {
    // Of a CUSUM theory knows: 1/h each, two sides, 360,000 samples.
    EXPECT_NEAR(filter.threshold, 20.0, 6.0) << filter.name;
  }
  EXPECT_TRUE(check_bank(plant(), calibrated).holds());
}

TEST_F(CalibrationTest, RefusesToGoBeyondTheRecord) {
  const std::vector<RecordedStretch> record = {noise(60'000)};
  EXPECT_EQ(refusal(record, 6.0), "");
  const std::string text = refusal(record, 1e-6);
  // 0.116 h fitted: 6 filters / (0.116 h · 100); 6e6 h / 100 / 0.7
  EXPECT_THAT(text, HasSubstr("they carry 0.5"));
  EXPECT_THAT(text, HasSubstr("expected at least 8.57e+04 h of record"));
  EXPECT_THAT(refusal({noise(4000)}, 6.0), HasSubstr("too few peaks; expected at least"));
  EXPECT_THAT(refusal(record, 1e6), HasSubstr("expected at most"));
}

TEST_F(CalibrationTest, RefusesARecordWithAFault) {
  RecordedStretch record = noise(120'000);
  // A bias of u2 that acts for 20 s: what a standing plant's sensors would show of it.
  record.u.block(1, 50'000, 1, 2000).array() += 0.2;
  const std::string text = refusal({record}, 6.0);
  EXPECT_THAT(text, HasSubstr("of the record, but at"));
  EXPECT_THAT(text, HasSubstr("expected a record without any fault"));
}

TEST_F(CalibrationTest, RefusesARecordThatChanges) {
  RecordedStretch record = noise(120'000);
  record.y.rightCols(30'000) *= 1.5;
  EXPECT_THAT(refusal({record}, 6.0), HasSubstr("the record changes in time"));
}

TEST_F(CalibrationTest, RefusesWhatDoesNotMove) {
  RecordedStretch still = noise(60'000);
  still.y.setZero();
  EXPECT_THAT(refusal({still}, 6.0), HasSubstr("found a residual that is 0 in every sample"));
  EXPECT_THAT(refusal({noise(50)}, 6.0), HasSubstr("no sample of the record says anything of it"));
}

TEST_F(CalibrationTest, RefusesThresholdsThatAreProved) {
  Bank proved = bank();
  proved.thresholds.kind = ThresholdBasis::Kind::kCertified;
  EXPECT_THAT(refusal({noise(60'000)}, 6.0, proved), HasSubstr("proved from bounds"));
}

}  // namespace
}  // namespace faultline
