// The flexible-joint robot of examples/ma2024 on the bench: a continuous plant stepped by RK4,
// noise and disturbances anywhere within their bounds, observers designed for the sampled model.
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "faultline/diagnosis_t.hpp"
#include "faultline/estimate_t.hpp"
#include "faultline/residual_t.hpp"
#include <gtest/gtest.h>

#include "tests/tools/bench/log_comparison.h"
#include "tools/bench/bench.h"

namespace faultline {
namespace {

const std::filesystem::path kExamples = std::filesystem::path(FAULTLINE_EXAMPLES_DIR) / "ma2024";
constexpr std::int64_t kSamples = 8001;
/// After a fault ends its trace in a residual may last that long.
constexpr std::int64_t kClearing = 300;

struct RobotRun {
  BenchResult result;
  std::vector<residual_t> residuals;
  std::vector<estimate_t> estimates;
};

RobotRun run(const std::string& scenario, const std::string& bus = "loop") {
  const BenchInputs inputs = load_bench_inputs(kExamples / (scenario + ".toml"));
  const TemporaryFolder folder;
  BenchOptions options;
  options.bus = bus;
  options.log = folder.path() / "run.lcm";
  BenchResult result = run_bench(inputs, options);
  return {std::move(result), logged_messages<residual_t>(*options.log, "FAULTLINE_RESIDUAL"),
          logged_messages<estimate_t>(*options.log, "FAULTLINE_ESTIMATE")};
}

/// Cycles in which filter `filter` is above its threshold, [from, until).
std::int64_t alarms(const RobotRun& run, std::size_t filter, std::int64_t from,
                    std::int64_t until) {
  return std::count_if(run.residuals.begin(), run.residuals.end(), [&](const residual_t& message) {
    return message.cycle >= from && message.cycle < until &&
           !(message.evaluation[filter] <= message.threshold[filter]);
  });
}

void expect_no_false_alarm(const RobotRun& run, std::int64_t fault_begin, std::int64_t fault_end) {
  ASSERT_EQ(std::ssize(run.residuals), kSamples);
  for (std::size_t i = 0; i < run.residuals[0].evaluation.size(); ++i) {
    EXPECT_EQ(alarms(run, i, 0, fault_begin), 0) << "filter " << i;
    EXPECT_EQ(alarms(run, i, fault_end + kClearing, kSamples), 0) << "filter " << i;
  }
}

TEST(Ma2024, RaisesNoFalseAlarmFromTheFirstSampleOn) {
  const RobotRun healthy = run("healthy");
  EXPECT_TRUE(healthy.result.history.are_expectations_met());
  expect_no_false_alarm(healthy, kSamples, kSamples);
}

TEST(Ma2024, NamesTheActuatorWithinSamples) {
  for (const std::string scenario : {"actuator", "fig1"}) {
    SCOPED_TRACE(scenario);
    const RobotRun actuator = run(scenario);
    EXPECT_TRUE(actuator.result.history.are_expectations_met());
    expect_no_false_alarm(actuator, 2001, 6001);
    // Detected within 5 samples of its onset at 100 Hz.
    EXPECT_GT(alarms(actuator, 0, 2001, 2006), 0);
    EXPECT_GT(alarms(actuator, 0, 2001, 6001), 3900);
  }
}

TEST(Ma2024, EstimatesTheSensorFaultWithinItsProvedBound) {
  const RobotRun sensor = run("fig2");
  EXPECT_TRUE(sensor.result.history.are_expectations_met());
  expect_no_false_alarm(sensor, 3001, 5001);
  int bounded = 0;
  for (const estimate_t& message : sensor.estimates) {
    if (message.fault_count == 0 || message.cycle >= 5001) continue;
    ASSERT_EQ(message.fault[0], "y1");
    if (message.bound[0] < 0.0) continue;
    ++bounded;
    EXPECT_LE(std::abs(message.estimate[0] - 0.2), message.bound[0]) << message.cycle;
    EXPECT_LT(message.bound[0], 0.02);
  }
  EXPECT_GE(bounded, 15);  // one a second
}

TEST(Ma2024, WithoutAFaultStateTheSensorFaultHasNoName) {
  const RobotRun sensor = run("fig4");
  EXPECT_TRUE(sensor.result.history.are_expectations_met());
  expect_no_false_alarm(sensor, 3001, 5001);
  EXPECT_TRUE(std::all_of(sensor.estimates.begin(), sensor.estimates.end(),
                          [](const estimate_t& message) { return message.fault_count == 0; }));
}

TEST(Ma2024, AFastObserverSeesTheFaultWithHMinusAndHardlyWithoutIt) {
  const RobotRun with = run("fig3_h_minus");
  const RobotRun without = run("fig3_l_infinity");
  expect_no_false_alarm(with, 2001, 6001);
  expect_no_false_alarm(without, 2001, 6001);
  EXPECT_GT(alarms(with, 0, 2001, 6001), 2 * alarms(without, 0, 2001, 6001));
}

}  // namespace
}  // namespace faultline
