// Run inside tools/with-vcan: needs vcan0.
#include <array>
#include <chrono>
#include <filesystem>

#include <unistd.h>

#include <boost/asio/io_context.hpp>
#include <boost/asio/posix/stream_descriptor.hpp>
#include <gtest/gtest.h>

#include "drivers/can/socketcan_bus.h"
#include "tests/tools/bench/log_comparison.h"
#include "tools/bench/bench.h"

namespace faultline {
namespace {

const std::filesystem::path kExamples = std::filesystem::path(FAULTLINE_EXAMPLES_DIR) / "hou2015";

BenchResult run(const BenchInputs& inputs, const std::string& bus, bool is_realtime,
                const std::filesystem::path& log) {
  BenchOptions options;
  options.bus = bus;
  options.is_realtime = is_realtime;
  options.log = log;
  return run_bench(inputs, options);
}

TEST(BenchOnVcan, GivesTheSameBitsAsTheLoopBusInLockStep) {
  const BenchInputs inputs = load_bench_inputs(kExamples / "fig13.toml");
  const TemporaryFolder folder;
  const BenchResult on_loop = run(inputs, "loop", false, folder.path() / "loop.lcm");
  const BenchResult on_vcan = run(inputs, "can:vcan0", false, folder.path() / "vcan.lcm");
  const auto loop = logged_residuals(folder.path() / "loop.lcm");
  const auto vcan = logged_residuals(folder.path() / "vcan.lcm");
  ASSERT_EQ(loop.size(), 10001U);
  ASSERT_EQ(vcan.size(), 10001U);
  EXPECT_EQ(first_difference(loop, vcan), 10001U);
  EXPECT_TRUE(on_loop.history.are_expectations_met());
  EXPECT_TRUE(on_vcan.history.are_expectations_met());
  EXPECT_EQ(on_vcan.counters.frames_received, on_vcan.counters.frames_sent);
  EXPECT_EQ(on_vcan.counters.frames_dropped, 0U);
}

TEST(BenchOnVcan, DiagnosesInRealTimeAndAccountsForEveryFrame) {
  BenchInputs inputs = load_bench_inputs(kExamples / "demo.toml");
  inputs.scenario.duration_s = 3.0;
  inputs.scenario.expectations.clear();
  for (Injection& injection : inputs.scenario.injections) injection.at_s = 2.0;
  inputs.schedule = FaultSchedule(inputs.plant, inputs.scenario.injections);
  const TemporaryFolder folder;
  const BenchResult result = run(inputs, "can:vcan0", true, folder.path() / "run.lcm");
  EXPECT_EQ(result.counters.cycles, 301U);
  EXPECT_EQ(result.counters.send_errors, 0U);
  EXPECT_EQ(result.counters.frames_received + result.counters.frames_dropped,
            result.counters.frames_sent);
  ASSERT_FALSE(result.history.verdicts().empty());
  EXPECT_EQ(verdict_text(result.history.verdicts().back()), "isolated u2, u3");
}

TEST(SocketCan, IsReadyForAsioWhenAFrameIsThere) {
  const auto sender = open_socketcan("vcan0");
  const auto receiver = open_socketcan("vcan0");
  boost::asio::io_context context(1);
  // A duplicate: the descriptor closes what it owns.
  boost::asio::posix::stream_descriptor ready(context, ::dup(receiver->readiness_fd()));
  std::array<CanFrame, 4> frames{};
  std::size_t received = 0;
  ready.async_wait(boost::asio::posix::stream_descriptor::wait_read,
                   [&](const boost::system::error_code& error) {
                     ASSERT_FALSE(error);
                     received = receiver->receive(frames, std::chrono::nanoseconds(0)).count;
                   });
  context.poll();
  EXPECT_EQ(received, 0U);
  CanFrame frame;
  frame.id = 0x123;
  frame.length = 2;
  frame.data[1] = 7;
  ASSERT_TRUE(sender->send(frame));
  context.run_for(std::chrono::seconds(5));
  ASSERT_EQ(received, 1U);
  EXPECT_TRUE(same_on_wire(frames[0], frame));
}

TEST(BenchOnVcan, NamesAnInterfaceThatIsNotThere) {
  const BenchInputs inputs = load_bench_inputs(kExamples / "demo.toml");
  const TemporaryFolder folder;
  try {
    static_cast<void>(run(inputs, "can:nosuch0", false, folder.path() / "run.lcm"));
    FAIL() << "expected a BusError";
  } catch (const BusError& error) {
    EXPECT_NE(std::string(error.what()).find("nosuch0"), std::string::npos) << error.what();
    EXPECT_NE(std::string(error.what()).find("vcan0"), std::string::npos) << error.what();
  }
  EXPECT_FALSE(std::filesystem::exists(folder.path() / "run.lcm"));
}

}  // namespace
}  // namespace faultline
