// Replay and verification of an hour of Hou's bench at 100 Hz (360,001 cycles, every frame), beside
// the floor in the same run: liblcm's own reader going through the same log and doing nothing.
#include <cstdint>
#include <filesystem>

#include <benchmark/benchmark.h>
#include <lcm/lcm-cpp.hpp>

#include "tools/bench/bench.h"
#include "tools/lcm/log_reader.h"
#include "tools/replay/log_replay.h"

namespace faultline {
namespace {

/// The log, made once, removed at the end.
class HourLog {
 public:
  HourLog() : file_(std::filesystem::temp_directory_path() / "faultline-replay-benchmark.lcm") {
    BenchInputs inputs =
        load_bench_inputs(std::filesystem::path(FAULTLINE_EXAMPLES_DIR) / "hou2015" / "fig13.toml");
    inputs.scenario.duration_s = 3600.0;
    inputs.scenario.expectations.clear();
    for (RunPart& part : inputs.parts) {
      if (part.part != "scenario") continue;
      const std::string old = "duration_s = 100.0";
      part.text.replace(part.text.find(old), old.size(), "duration_s = 3600.0");
    }
    BenchOptions options;
    options.bus = "loop";
    options.log = file_;
    static_cast<void>(run_bench(inputs, options));
  }
  ~HourLog() { std::filesystem::remove(file_); }
  HourLog(const HourLog&) = delete;
  HourLog& operator=(const HourLog&) = delete;
  [[nodiscard]] const std::filesystem::path& file() const noexcept { return file_; }

 private:
  std::filesystem::path file_;
};

const std::filesystem::path& hour_log() {
  static const HourLog log;
  return log.file();
}

void set_rate(benchmark::State& state, std::uint64_t cycles) {
  state.counters["cycles/s"] =
      benchmark::Counter(static_cast<double>(cycles), benchmark::Counter::kIsRate);
}

void ReplayAndVerify(benchmark::State& state) {
  ReplayOptions options;
  options.logs = {hour_log()};
  std::uint64_t cycles = 0;
  for (auto _ : state) {
    const ReplayResult result = replay(options);
    const RunReplay& run = result.runs.front();
    if (!run.verification->is_verified()) state.SkipWithError("not verified");
    cycles += run.answers.front().samples;
  }
  set_rate(state, cycles);
}
BENCHMARK(ReplayAndVerify)->Unit(benchmark::kMillisecond);

void FloorLibLcmReads(benchmark::State& state) {
  constexpr std::uint64_t kCycles = 360'001;
  std::uint64_t cycles = 0;
  for (auto _ : state) {
    lcm::LogFile log(hour_log().string(), "r");
    std::int64_t bytes = 0;
    while (const lcm::LogEvent* event = log.readNextEvent()) bytes += event->datalen;
    benchmark::DoNotOptimize(bytes);
    cycles += kCycles;
  }
  set_rate(state, cycles);
}
BENCHMARK(FloorLibLcmReads)->Unit(benchmark::kMillisecond);

void OurReaderReads(benchmark::State& state) {
  constexpr std::uint64_t kCycles = 360'001;
  std::uint64_t cycles = 0;
  for (auto _ : state) {
    LogReader log(hour_log());
    std::size_t bytes = 0;
    while (const LogEvent* event = log.next()) bytes += event->data.size();
    benchmark::DoNotOptimize(bytes);
    cycles += kCycles;
  }
  set_rate(state, cycles);
}
BENCHMARK(OurReaderReads)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace faultline

BENCHMARK_MAIN();
