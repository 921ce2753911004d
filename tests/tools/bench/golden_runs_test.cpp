// The frames of whole runs, pinned down: tests/golden/frames/README.md.
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include <faultline/can_t.hpp>
#include <faultline/truth_t.hpp>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <gtest/gtest.h>

#include "diagnosis/model/digest.h"
#include "tests/tools/bench/log_comparison.h"
#include "tools/bench/bench.h"
#include "tools/lcm/channels.h"

namespace faultline {
namespace {

/// Between machines, relative to the largest state (and to 1).
constexpr double kStateTolerance = 1e-12;

struct GoldenRun {
  std::string scenario;
  double duration_s = 0.0;
  std::string digest;
  std::vector<double> x;
};

std::vector<GoldenRun> golden_runs() {
  std::ifstream file(std::filesystem::path(FAULTLINE_GOLDEN_DIR) / "frames" / "runs.txt");
  std::vector<GoldenRun> runs;
  for (std::string line; std::getline(file, line);) {
    if (line.empty() || line.front() == '#') continue;
    std::istringstream words(line);
    GoldenRun& run = runs.emplace_back();
    words >> run.scenario >> run.duration_s >> run.digest;
    for (double x = 0.0; words >> x;) run.x.push_back(x);
  }
  return runs;
}

/// The run as it is now.
GoldenRun run_now(const GoldenRun& golden) {
  const TemporaryFolder folder;
  BenchInputs inputs =
      load_bench_inputs(std::filesystem::path(FAULTLINE_EXAMPLES_DIR) / golden.scenario);
  inputs.scenario.duration_s = golden.duration_s;
  BenchOptions options;
  options.bus = "loop";
  options.log = folder.path() / "run.lcm";
  static_cast<void>(run_bench(inputs, options));
  GoldenRun run{.scenario = golden.scenario, .duration_s = golden.duration_s};
  std::string bytes;
  for (const can_t& batch : logged_messages<can_t>(*options.log, kCanChannel)) {
    for (const can_frame_t& frame : batch.frames) {
      bytes += fmt::format("{:x} {} ", frame.id, frame.length);
      bytes.append(frame.data.begin(), frame.data.end());
    }
  }
  run.digest = text_digest(bytes);
  run.x = logged_messages<truth_t>(*options.log, kTruthChannel).back().x;
  return run;
}

TEST(GoldenRuns, HaveTheSameFramesToTheBitInEveryBuild) {
  const bool prints = std::getenv("FAULTLINE_PRINT_FRAME_DIGESTS") != nullptr;
  const std::vector<GoldenRun> runs = golden_runs();
  ASSERT_GE(runs.size(), 6U);
  for (const GoldenRun& golden : runs) {
    const GoldenRun now = run_now(golden);
    if (prints) {
      fmt::print("{} {:g} {} {:.17g}\n", now.scenario, now.duration_s, now.digest,
                 fmt::join(now.x, " "));
      continue;
    }
    EXPECT_EQ(now.digest, golden.digest) << golden.scenario;
    ASSERT_EQ(now.x.size(), golden.x.size()) << golden.scenario;
    double largest = 1.0;
    for (const double x : golden.x) largest = std::max(largest, std::abs(x));
    for (std::size_t i = 0; i < now.x.size(); ++i) {
      EXPECT_NEAR(now.x[i], golden.x[i], kStateTolerance * largest) << golden.scenario << " x" << i;
    }
  }
}

}  // namespace
}  // namespace faultline
