// Virtual time on the loop bus: cycles per second of Hou's bench end to end (plant, controller,
// frames, decoding, bank, decision, LCM log), with and without the log, on one thread. Beside it,
// in the same run, the floor: writing events of the same sizes through liblcm and nothing else.
#include <cstdint>
#include <filesystem>
#include <vector>

#include <benchmark/benchmark.h>
#include <lcm/lcm-cpp.hpp>

#include "tools/bench/bench.h"

namespace faultline {
namespace {

const std::filesystem::path kScenario =
    std::filesystem::path(FAULTLINE_EXAMPLES_DIR) / "hou2015" / "fig13.toml";

void run_cycles(benchmark::State& state, const std::optional<std::filesystem::path>& log) {
  const BenchInputs inputs = load_bench_inputs(kScenario);
  BenchOptions options;
  options.bus = "loop";
  options.log = log;
  std::uint64_t cycles = 0;
  for (auto _ : state) {
    const BenchResult result = run_bench(inputs, options);
    if (!result.history.are_expectations_met()) state.SkipWithError("expectations not met");
    cycles += result.counters.cycles;
  }
  state.counters["cycles/s"] =
      benchmark::Counter(static_cast<double>(cycles), benchmark::Counter::kIsRate);
}

std::filesystem::path log_file() {
  return std::filesystem::temp_directory_path() / "faultline-bench-benchmark.lcm";
}

void EndToEndWithLog(benchmark::State& state) {
  run_cycles(state, log_file());
  std::filesystem::remove(log_file());
}
BENCHMARK(EndToEndWithLog)->Unit(benchmark::kMillisecond);

void EndToEndWithoutLog(benchmark::State& state) { run_cycles(state, std::nullopt); }
BENCHMARK(EndToEndWithoutLog)->Unit(benchmark::kMillisecond);

/// What one cycle logs: a SAMPLE of 115 bytes, a RESIDUAL of 190, and 5/64 of a CAN batch of 2,400.
void FloorLibLcmWritesTheSameEvents(benchmark::State& state) {
  constexpr int kCycles = 10001;
  std::vector<std::uint8_t> bytes(2400);
  std::uint64_t cycles = 0;
  for (auto _ : state) {
    lcm::LogFile log(log_file().string(), "w");
    lcm::LogEvent event{};
    event.data = bytes.data();
    for (int k = 0; k < kCycles; ++k) {
      event.timestamp = k;
      event.channel = "FAULTLINE_SAMPLE";
      event.datalen = 115;
      log.writeEvent(&event);
      event.channel = "FAULTLINE_RESIDUAL";
      event.datalen = 190;
      log.writeEvent(&event);
      if (k % 13 == 0) {
        event.channel = "FAULTLINE_CAN";
        event.datalen = 2400;
        log.writeEvent(&event);
      }
    }
    cycles += kCycles;
  }
  std::filesystem::remove(log_file());
  state.counters["cycles/s"] =
      benchmark::Counter(static_cast<double>(cycles), benchmark::Counter::kIsRate);
}
BENCHMARK(FloorLibLcmWritesTheSameEvents)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace faultline

BENCHMARK_MAIN();
