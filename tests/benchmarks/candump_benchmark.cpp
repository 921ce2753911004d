// How fast candump text is parsed, beside a bare std::from_chars loop over the same text that
// checks nothing: for seconds, fraction, identifier, then each pair of digits.
#include <charconv>
#include <cstdint>
#include <cstring>
#include <random>
#include <string>
#include <string_view>

#include <benchmark/benchmark.h>

#include "drivers/can/candump_log.h"
#include "tests/support/random_can_frame.h"

namespace faultline {
namespace {

constexpr int kLines = 100'000;

enum class Kind { kClassic, kMixed };

/// What candump -L writes of a busy bus: classic frames of eight bytes, or frames of any kind.
std::string make_log(Kind kind) {
  std::mt19937_64 generator(1);
  std::string log;
  std::array<char, kLongestCandumpLine> line;
  for (int n = 0; n < kLines; ++n) {
    CanFrame frame = random_can_frame(generator, false);
    if (kind == Kind::kClassic) {
      frame = {};
      frame.id = static_cast<std::uint32_t>(generator()) & kMaxStandardId;
      frame.length = 8;
      for (std::size_t k = 0; k < 8; ++k) frame.data[k] = static_cast<std::uint8_t>(generator());
    }
    frame.stamp = Timestamp(std::chrono::seconds(1436509052) + std::chrono::microseconds(n * 137));
    log.append(line.data(), format_candump_line(frame, "vcan0", line));
  }
  return log;
}

void parse_with_from_chars(benchmark::State& state) {
  const std::string log = make_log(Kind::kClassic);
  for (auto _ : state) {
    const char* at = log.data();
    const char* const end = at + log.size();
    while (at != end) {
      std::int64_t seconds = 0, microseconds = 0;
      std::uint32_t id = 0;
      std::array<std::uint8_t, 8> data{};
      at = std::from_chars(at + 1, end, seconds).ptr;
      at = std::from_chars(at + 1, end, microseconds).ptr;
      at = std::from_chars(at + std::strlen(") vcan0 "), end, id, 16).ptr + 1;
      for (std::uint8_t& byte : data) at = std::from_chars(at, at + 2, byte, 16).ptr;
      ++at;
      benchmark::DoNotOptimize(seconds);
      benchmark::DoNotOptimize(microseconds);
      benchmark::DoNotOptimize(id);
      benchmark::DoNotOptimize(data);
    }
  }
  state.SetItemsProcessed(state.iterations() * kLines);
}
BENCHMARK(parse_with_from_chars);

void parse_lines(benchmark::State& state, Kind kind) {
  const std::string log = make_log(kind);
  for (auto _ : state) {
    const char* at = log.data();
    const char* const end = at + log.size();
    CandumpRecord record;
    CandumpProblem problem;
    while (at != end) {
      const auto* const newline =
          static_cast<const char*>(std::memchr(at, '\n', static_cast<std::size_t>(end - at)));
      const std::string_view line(at, static_cast<std::size_t>(newline - at));
      if (parse_candump_line(line, record, problem) != CandumpStatus::kRecord) {
        state.SkipWithError("a line that is none");
        return;
      }
      benchmark::DoNotOptimize(record);
      at = newline + 1;
    }
  }
  state.SetItemsProcessed(state.iterations() * kLines);
}
BENCHMARK_CAPTURE(parse_lines, classic, Kind::kClassic);
BENCHMARK_CAPTURE(parse_lines, of_any_kind, Kind::kMixed);

void format_lines(benchmark::State& state) {
  std::mt19937_64 generator(1);
  const CanFrame frame = random_can_frame(generator, false);
  std::array<char, kLongestCandumpLine> line;
  for (auto _ : state) {
    benchmark::DoNotOptimize(format_candump_line(frame, "vcan0", line));
  }
  state.SetItemsProcessed(state.iterations());
}
BENCHMARK(format_lines);

}  // namespace
}  // namespace faultline
