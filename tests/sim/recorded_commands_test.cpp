#include "sim/recorded_commands.h"

#include <array>
#include <cmath>

#include <gtest/gtest.h>

#include "tests/support/allocation_guard.h"

namespace faultline {
namespace {

/// Inputs (a, b, c) with u₀ + v = (1, 2, 3); the record has c and a.
RecordedCommands commands_of(const char* csv, double sample_time_s, CommandBase base) {
  auto record = std::make_shared<const RecordedSignal>(csv, "commands.csv");
  std::vector<std::optional<std::size_t>> columns{record->index_of("a"), std::nullopt,
                                                  record->index_of("c")};
  return {std::move(record), std::move(columns), std::move(base), sample_time_s};
}

CommandBase base() { return CommandBase(Eigen::Vector3d(1.0, 2.0, 3.0)); }
constexpr char kRecord[] = "t_s,c,a\n5.0,10,20\n5.1,11,21\n5.2,12,22\n";

std::array<double, 3> at(RecordedCommands& commands, std::uint32_t k) {
  std::array<double, 3> u{};
  commands.command(k, {}, u);
  return u;
}

TEST(RecordedCommands, HoldsEachRowUntilTheNext) {
  RecordedCommands commands = commands_of(kRecord, 0.05, base());
  EXPECT_EQ(at(commands, 0), (std::array{20.0, 2.0, 10.0}));
  EXPECT_EQ(at(commands, 1), (std::array{20.0, 2.0, 10.0}));
  EXPECT_EQ(at(commands, 2), (std::array{21.0, 2.0, 11.0}));
  EXPECT_EQ(at(commands, 4), (std::array{22.0, 2.0, 12.0}));
  EXPECT_EQ(at(commands, 4'000'000'000), (std::array{22.0, 2.0, 12.0}));
  EXPECT_EQ(at(commands, 0), (std::array{20.0, 2.0, 10.0}));
}

TEST(RecordedCommands, TakesEveryRowOfARecordAtTheSampleRate) {
  std::string csv = "t_s,a,c\n";
  for (int i = 0; i < 1000; ++i) csv += std::to_string(i * 0.01) + "," + std::to_string(i) + ",0\n";
  RecordedCommands commands = commands_of(csv.c_str(), 0.01, base());
  for (std::uint32_t k = 0; k < 1000; ++k) ASSERT_EQ(at(commands, k)[0], k);
}

TEST(RecordedCommands, AddsTheExcitationAndStaysWithinLimits) {
  CommandBase limited = base();
  limited.amplitude[0] = 4.0;
  limited.omega_rad[0] = 0.3;
  limited.upper[2] = 11.0;
  RecordedCommands commands = commands_of(kRecord, 0.1, limited);
  EXPECT_EQ(at(commands, 2)[0], 22.0 + 4.0 * std::sin(0.6));
  EXPECT_EQ(at(commands, 2)[2], 11.0);
}

TEST(RecordedCommands, DoesNotAllocateWhileItRuns) {
  RecordedCommands commands = commands_of(kRecord, 0.001, base());
  const AllocationGuard guard;
  for (std::uint32_t k = 0; k < 1000; ++k) at(commands, k);
  EXPECT_EQ(guard.heap_calls(), 0U);
}

}  // namespace
}  // namespace faultline
