// Run inside tools/with-vcan: needs vcan0.
#include <array>
#include <chrono>
#include <filesystem>
#include <string>
#include <thread>
#include <vector>

#include <unistd.h>

#include "faultline/event_t.hpp"
#include <boost/asio/io_context.hpp>
#include <boost/asio/posix/stream_descriptor.hpp>
#include <gtest/gtest.h>

#include "drivers/can/socketcan_bus.h"
#include "tests/support/allocation_guard.h"
#include "tests/support/bus_traffic.h"
#include "tests/tools/bench/log_comparison.h"
#include "tools/bench/bench.h"

namespace faultline {
namespace {

using namespace std::chrono_literals;

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

TEST(BenchOnVcan, RunsANonlinearPlantWithNoiseToTheSameBits) {
  const BenchInputs inputs = load_bench_inputs(kExamples.parent_path() / "ma2024" / "fig2.toml");
  const TemporaryFolder folder;
  static_cast<void>(run(inputs, "loop", false, folder.path() / "loop.lcm"));
  const BenchResult on_vcan = run(inputs, "can:vcan0", false, folder.path() / "vcan.lcm");
  EXPECT_TRUE(on_vcan.history.are_expectations_met());
  EXPECT_EQ(on_vcan.counters.frames_dropped, 0U);
  const auto loop = logged_residuals(folder.path() / "loop.lcm");
  const auto vcan = logged_residuals(folder.path() / "vcan.lcm");
  ASSERT_EQ(loop.size(), 8001U);
  ASSERT_EQ(vcan.size(), 8001U);
  EXPECT_EQ(first_difference(loop, vcan), 8001U);
}

TEST(BenchOnUdp, GivesTheSameBitsAsTheLoopBusInLockStep) {
  const BenchInputs inputs = load_bench_inputs(kExamples / "fig13.toml");
  const TemporaryFolder folder;
  static_cast<void>(run(inputs, "loop", false, folder.path() / "loop.lcm"));
  const BenchResult on_udp =
      run(inputs, "udp:239.74.163.2:43113", false, folder.path() / "udp.lcm");
  const auto loop = logged_residuals(folder.path() / "loop.lcm");
  const auto udp = logged_residuals(folder.path() / "udp.lcm");
  ASSERT_EQ(udp.size(), 10001U);
  EXPECT_EQ(first_difference(loop, udp), 10001U);
  EXPECT_EQ(on_udp.counters.frames_received, on_udp.counters.frames_sent);
  EXPECT_EQ(on_udp.counters.frames_dropped, 0U);
}

/// With faults of frames the next cycle begins when all that was passed on has arrived: the same
/// frames in the same cycles on every bus.
void expect_same_bits_with_frame_faults(const std::string& bus) {
  for (const char* name : {"all_messages", "babbling_unmapped", "bus_off_plant", "delayed_command",
                           "intermittent", "with_actuator_fault"}) {
    SCOPED_TRACE(name);
    const BenchInputs inputs =
        load_bench_inputs(kExamples / "bus_faults" / (std::string(name) + ".toml"));
    const TemporaryFolder folder;
    const BenchResult on_loop = run(inputs, "loop", false, folder.path() / "loop.lcm");
    const BenchResult on_bus = run(inputs, bus, false, folder.path() / "bus.lcm");
    EXPECT_FALSE(on_bus.stop_reason.has_value()) << on_bus.stop_reason->text;
    EXPECT_TRUE(on_bus.history.are_expectations_met());
    EXPECT_EQ(on_bus.counters.frames_sent, on_loop.counters.frames_sent);
    EXPECT_EQ(on_bus.counters.frames_received, on_loop.counters.frames_received);
    EXPECT_EQ(on_bus.counters.late_cycles, on_loop.counters.late_cycles);
    const auto loop = logged_residuals(folder.path() / "loop.lcm");
    const auto residuals = logged_residuals(folder.path() / "bus.lcm");
    ASSERT_EQ(loop.size(), residuals.size());
    EXPECT_EQ(first_difference(loop, residuals), loop.size());
  }
}

TEST(BenchOnVcan, GivesTheSameBitsAsTheLoopBusWithFaultsOfFrames) {
  expect_same_bits_with_frame_faults("can:vcan0");
}

TEST(BenchOnUdp, GivesTheSameBitsAsTheLoopBusWithFaultsOfFrames) {
  expect_same_bits_with_frame_faults("udp:239.74.163.2:43115");
}

TEST(BenchOnVcan, DiagnosesInRealTimeAndAccountsForEveryFrame) {
  BenchInputs inputs = load_bench_inputs(kExamples / "demo.toml");
  inputs.scenario.duration_s = 3.0;
  inputs.scenario.expectations.clear();
  for (Injection& injection : inputs.scenario.injections) injection.at_s = 2.0;
  inputs.schedule = FaultSchedule(inputs.plant, inputs.scenario.injections);
  const TemporaryFolder folder;
  BenchOptions options;
  options.bus = "can:vcan0";
  options.is_realtime = true;
  options.log = folder.path() / "run.lcm";
  options.thread_allocations = []() noexcept {
    thread_local const AllocationGuard guard;
    return guard.heap_calls();
  };
  const BenchResult result = run_bench(inputs, options);
  EXPECT_EQ(result.counters.cycles, 301U);
  EXPECT_EQ(result.counters.allocations, 0U);
  EXPECT_EQ(result.counters.frames_unlogged, 0U);
  EXPECT_EQ(result.counters.send_errors, 0U);
  EXPECT_EQ(result.counters.frames_received + result.counters.frames_dropped,
            result.counters.frames_sent);
  ASSERT_FALSE(result.history.verdicts().empty());
  EXPECT_EQ(verdict_text(result.history.verdicts().back()), "isolated u2, u3");
}

/// Text of every EVENT of `source` in a log, in order.
std::vector<std::string> events_of(const std::filesystem::path& log, const std::string& source) {
  std::vector<std::string> texts;
  for (const auto& event : logged_messages<faultline::event_t>(log, "FAULTLINE_EVENT")) {
    if (event.source == source) texts.push_back(event.text);
  }
  return texts;
}

const std::vector<std::string> kDownAndBack{"bus can:vcantmp is down", "bus can:vcantmp is back"};

TEST(BenchOnVcan, WaitsInLockStepForABusThatIsGoneAndGoesOn) {
  TemporaryInterface interface;
  interface.set("up");
  const BenchInputs inputs = load_bench_inputs(kExamples / "fig13.toml");
  const TemporaryFolder folder;
  BenchOptions options;
  options.bus = "can:" + interface.name;
  options.log = folder.path() / "run.lcm";
  std::thread returning;
  options.on_progress = [&](double t_s, double, const std::string&) {
    if (t_s < 1.0 || returning.joinable()) return;
    interface.remove();
    returning = std::thread([&] {
      std::this_thread::sleep_for(300ms);
      interface.add();
      interface.set("up");
    });
  };
  const BenchResult result = run_bench(inputs, options);
  ASSERT_TRUE(returning.joinable());
  returning.join();
  EXPECT_FALSE(result.stop_reason.has_value()) << result.stop_reason->text;
  EXPECT_EQ(result.counters.cycles, 10001U);
  EXPECT_EQ(events_of(*options.log, "bus"), kDownAndBack);
  EXPECT_TRUE(result.history.are_expectations_met());
}

TEST(BenchOnVcan, EndsALockStepRunWhoseBusStaysAway) {
  TemporaryInterface interface;
  interface.set("up");
  const BenchInputs inputs = load_bench_inputs(kExamples / "fig13.toml");
  const TemporaryFolder folder;
  BenchOptions options;
  options.bus = "can:" + interface.name;
  options.log = folder.path() / "run.lcm";
  options.bus_patience = 200ms;
  bool is_down = false;
  options.on_progress = [&](double t_s, double, const std::string&) {
    if (t_s >= 1.0 && !is_down) interface.set("down");
    is_down = is_down || t_s >= 1.0;
  };
  const BenchResult result = run_bench(inputs, options);
  ASSERT_TRUE(result.stop_reason.has_value());
  EXPECT_EQ(result.stop_reason->kind, StopReason::Kind::kBus);
  EXPECT_NE(
      result.stop_reason->text.find("can:vcantmp was down, or took no frames, for 0.2 s in cycle "),
      std::string::npos)
      << result.stop_reason->text;
  EXPECT_EQ(events_of(*options.log, "bus"), std::vector<std::string>{kDownAndBack[0]});
}

TEST(BenchOnVcan, GoesOnInRealTimeWhileTheBusIsDown) {
  TemporaryInterface interface;
  interface.set("up");
  BenchInputs inputs = load_bench_inputs(kExamples / "demo.toml");
  inputs.scenario.duration_s = 5.0;
  inputs.scenario.expectations.clear();
  for (Injection& injection : inputs.scenario.injections) injection.at_s = 3.0;
  inputs.schedule = FaultSchedule(inputs.plant, inputs.scenario.injections);
  const TemporaryFolder folder;
  BenchOptions options;
  options.bus = "can:" + interface.name;
  options.is_realtime = true;
  options.log = folder.path() / "run.lcm";
  std::thread returning;
  const auto sender = open_socketcan(interface.name);
  options.on_progress = [&](double t_s, double, const std::string&) {
    if (t_s < 0.5 || returning.joinable()) return;
    CanFrame error;
    error.is_error = true;
    error.length = 8;
    error.id = 0x40;
    sender->send(error);
    sender->send(error);
    error.id = 0x100;
    sender->send(error);
    returning = std::thread([&] {
      std::this_thread::sleep_for(200ms);
      interface.set("down");
      std::this_thread::sleep_for(300ms);
      interface.set("up");
    });
  };
  const BenchResult result = run_bench(inputs, options);
  ASSERT_TRUE(returning.joinable());
  returning.join();
  EXPECT_FALSE(result.stop_reason.has_value()) << result.stop_reason->text;
  EXPECT_EQ(result.counters.cycles, 501U);
  EXPECT_GT(result.counters.send_errors, 0U);
  EXPECT_EQ(
      events_of(*options.log, "bus"),
      (std::vector<std::string>{"can:vcantmp: bus-off", "can:vcantmp: restarted, error-active",
                                kDownAndBack[0], kDownAndBack[1]}));
  ASSERT_FALSE(result.history.verdicts().empty());
  EXPECT_EQ(verdict_text(result.history.verdicts().back()), "isolated u2, u3");
}

TEST(BenchOnVcan, RunsOnSeveralBusesAtOnce) {
  const TemporaryInterface interface;
  interface.set("up");
  const BenchInputs inputs = load_bench_inputs(kExamples / "fig13.toml");
  const TemporaryFolder folder;
  const BenchResult result =
      run(inputs, "can:vcan0,can:" + interface.name, false, folder.path() / "run.lcm");
  EXPECT_FALSE(result.stop_reason.has_value()) << result.stop_reason->text;
  EXPECT_TRUE(result.history.are_expectations_met());
  EXPECT_EQ(result.counters.frames_received, result.counters.frames_sent);
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
