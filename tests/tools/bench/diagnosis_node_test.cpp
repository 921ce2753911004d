#include "tools/bench/diagnosis_node.h"

#include <filesystem>
#include <vector>

#include <gtest/gtest.h>

#include "sim/controller_node.h"
#include "sim/plant_node.h"
#include "tests/support/allocation_guard.h"
#include "tools/bench/bench_inputs.h"

namespace faultline {
namespace {

/// The frames of a lock-step run, in bus order.
class FrameRecorder final : public FrameSink {
 public:
  bool send(const CanFrame& frame) noexcept override {
    frames.push_back(frame);
    return true;
  }
  std::vector<CanFrame> frames;
};

std::vector<CanFrame> record_frames(const BenchInputs& inputs, std::uint32_t cycles) {
  FrameRecorder bus;
  PlantNode plant(inputs.plant, inputs.map, inputs.schedule, inputs.bank.sample_time_s,
                  inputs.x_initial);
  ControllerNode controller(inputs.map, inputs.make_controller());
  std::size_t controller_read = 0;
  std::size_t plant_read = 0;
  for (std::uint32_t k = 0; k < cycles; ++k) {
    plant.on_cycle(k, bus);
    for (const std::size_t end = bus.frames.size(); controller_read < end; ++controller_read) {
      const CanFrame frame = bus.frames[controller_read];
      controller.on_frame(frame, bus);
    }
    for (; plant_read < bus.frames.size(); ++plant_read) plant.on_frame(bus.frames[plant_read]);
    controller_read = bus.frames.size();
  }
  return bus.frames;
}

struct CountingSink final : DiagnosisSink {
  void on_received(const CanFrame& /*frame*/) noexcept override { ++received; }
  void on_record(const DiagnosisRecord& record) noexcept override {
    ++records;
    last = record.decision;
    last_cycle = record.cycle;
    since_cycle = record.since_cycle;
    onset = record.onset;
    if (record.decision.verdict == Verdict::kInhibited) ++inhibited;
  }
  std::uint64_t received = 0;
  std::uint64_t records = 0;
  std::uint64_t inhibited = 0;
  std::uint32_t last_cycle = 0;
  std::uint32_t since_cycle = 0;
  Onset onset;
  Decision last;
};

class DiagnosisNodeTest : public testing::Test {
 protected:
  BenchInputs inputs_ =
      load_bench_inputs(std::filesystem::path(FAULTLINE_EXAMPLES_DIR) / "hou2015" / "demo.toml");
  CountingSink sink_;
};

TEST_F(DiagnosisNodeTest, DoesNotAllocateFromTheFirstFrameOn) {
  const std::vector<CanFrame> frames = record_frames(inputs_, 1001);
  DiagnosisNode node(inputs_.map, inputs_.bank, false);
  const AllocationGuard guard;
  for (const CanFrame& frame : frames) node.on_frame(frame, sink_);
  node.finish(sink_);
  EXPECT_EQ(guard.heap_calls(), 0U);
  EXPECT_EQ(sink_.records, 1001U);
  EXPECT_EQ(sink_.received, 5005U);
}

TEST_F(DiagnosisNodeTest, StartsInhibitedUnlessTheInitialStateIsKnown) {
  const std::vector<CanFrame> frames = record_frames(inputs_, 50);
  DiagnosisNode unknown(inputs_.map, inputs_.bank, false);
  for (const CanFrame& frame : frames) unknown.on_frame(frame, sink_);
  EXPECT_EQ(sink_.last.verdict, Verdict::kInhibited);
  DiagnosisNode known(inputs_.map, inputs_.bank, true);
  for (const CanFrame& frame : frames) known.on_frame(frame, sink_);
  EXPECT_EQ(sink_.last.verdict, Verdict::kHealthy);
}

TEST_F(DiagnosisNodeTest, InhibitsAfterALostFrameAndRecoversByItself) {
  std::vector<CanFrame> frames = record_frames(inputs_, 390);
  constexpr std::size_t kFramesPerCycle = 5;
  constexpr std::size_t kLostCycle = 200;
  frames.erase(frames.begin() + kLostCycle * kFramesPerCycle + 1);  // its first sensor message
  DiagnosisNode node(inputs_.map, inputs_.bank, true);
  std::size_t i = 0;
  for (; i < kLostCycle * kFramesPerCycle; ++i) node.on_frame(frames[i], sink_);
  // Only until the first signature had stood long enough.
  EXPECT_EQ(sink_.inhibited, inputs_.bank.decision.settle - 1);
  sink_.inhibited = 0;
  // The sample with the lost message closes with the first frame two cycles on.
  for (; i < (kLostCycle + 3) * kFramesPerCycle; ++i) node.on_frame(frames[i], sink_);
  EXPECT_EQ(sink_.last.verdict, Verdict::kInhibited);
  for (; i < frames.size(); ++i) node.on_frame(frames[i], sink_);
  node.finish(sink_);
  EXPECT_EQ(sink_.records, 390U);
  EXPECT_EQ(sink_.last.verdict, Verdict::kHealthy);
  std::uint32_t longest = 0;
  for (const ResidualFilter& filter : inputs_.bank.filters) {
    longest = std::max(longest, filter.forget_samples);
  }
  EXPECT_LE(sink_.inhibited, longest + inputs_.bank.decision.settle + 1);
  EXPECT_GT(sink_.inhibited, longest / 2);
}

TEST_F(DiagnosisNodeTest, ForgetsEverythingWhenThePlantRestarts) {
  const std::vector<CanFrame> faulty = record_frames(inputs_, 600);  // u2, u3 fail at cycle 400
  const std::vector<CanFrame> fresh = record_frames(inputs_, 300);
  DiagnosisNode node(inputs_.map, inputs_.bank, true);
  for (const CanFrame& frame : faulty) node.on_frame(frame, sink_);
  EXPECT_EQ(sink_.last.verdict, Verdict::kIsolated);
  for (std::size_t i = 0; i < 10; ++i) node.on_frame(fresh[i], sink_);
  EXPECT_EQ(sink_.last.verdict, Verdict::kInhibited);
  for (std::size_t i = 10; i < fresh.size(); ++i) node.on_frame(fresh[i], sink_);
  EXPECT_EQ(sink_.last.verdict, Verdict::kHealthy);
  EXPECT_EQ(node.sampler_counters().resets, 1U);
}

/// The bank with thresholds that hold from the first sample on for all its filters.
Bank with_courses(Bank bank) {
  for (ResidualFilter& filter : bank.filters) {
    const Eigen::Index rows = filter.H.rows();
    filter.course = ThresholdCourse{Eigen::MatrixXd::Identity(rows, rows),
                                    Eigen::VectorXd::Constant(1, filter.threshold),
                                    Eigen::MatrixXd::Constant(1, rows, filter.threshold)};
  }
  return bank;
}

TEST_F(DiagnosisNodeTest, DoesNotAllocateWithObservers) {
  const std::vector<CanFrame> frames = record_frames(inputs_, 1001);
  Bank bank = with_courses(inputs_.bank);
  for (ResidualFilter& filter : bank.filters) {
    FilterNonlinearity term;
    term.W = Eigen::VectorXd::Constant(filter.F.rows(), 1e-6);
    term.a_v = Eigen::VectorXd::Ones(filter.F.rows());
    term.a_y = Eigen::VectorXd::Ones(filter.H.cols());
    term.a_u = Eigen::VectorXd::Ones(filter.K.cols());
    filter.nonlinearities = {term};
    filter.transient_samples = 10;
  }
  DiagnosisNode node(inputs_.map, bank, false);
  const AllocationGuard guard;
  for (const CanFrame& frame : frames) node.on_frame(frame, sink_);
  node.finish(sink_);
  EXPECT_EQ(guard.heap_calls(), 0U);
  EXPECT_EQ(sink_.last.verdict, Verdict::kIsolated);
}

TEST_F(DiagnosisNodeTest, SpeaksAtOnceWhereThresholdsHoldFromTheFirstSample) {
  const std::vector<CanFrame> frames = record_frames(inputs_, 50);
  DiagnosisNode node(inputs_.map, with_courses(inputs_.bank), false);
  for (const CanFrame& frame : frames) node.on_frame(frame, sink_);
  EXPECT_EQ(sink_.last.verdict, Verdict::kHealthy);
  EXPECT_EQ(sink_.inhibited, inputs_.bank.decision.settle - 1);
}

TEST_F(DiagnosisNodeTest, SpeaksSoonAfterARestartWhereThresholdsHoldFromTheFirstSample) {
  const std::vector<CanFrame> frames = record_frames(inputs_, 300);
  DiagnosisNode node(inputs_.map, with_courses(inputs_.bank), false);
  for (const CanFrame& frame : frames) node.on_frame(frame, sink_);
  sink_.inhibited = 0;
  for (const CanFrame& frame : frames) node.on_frame(frame, sink_);
  EXPECT_EQ(node.sampler_counters().resets, 1U);
  EXPECT_EQ(sink_.last.verdict, Verdict::kHealthy);
  EXPECT_EQ(sink_.inhibited, inputs_.bank.decision.settle - 1);
}

TEST_F(DiagnosisNodeTest, DistrustsABadSampleAlsoWhereThresholdsHoldFromTheFirstSample) {
  std::vector<CanFrame> frames = record_frames(inputs_, 390);
  frames.erase(frames.begin() + 200 * 5 + 1);  // a sensor message
  DiagnosisNode node(inputs_.map, with_courses(inputs_.bank), false);
  for (const CanFrame& frame : frames) node.on_frame(frame, sink_);
  EXPECT_EQ(sink_.last.verdict, Verdict::kHealthy);
  EXPECT_GT(sink_.inhibited, inputs_.bank.filters[0].forget_samples / 2);
}

TEST_F(DiagnosisNodeTest, SaysSinceWhenItsVerdictStands) {
  const std::vector<CanFrame> frames = record_frames(inputs_, 600);
  DiagnosisNode node(inputs_.map, inputs_.bank, true);
  for (const CanFrame& frame : frames) node.on_frame(frame, sink_);
  EXPECT_EQ(sink_.last.verdict, Verdict::kIsolated);
  EXPECT_GT(sink_.since_cycle, 400U);
  EXPECT_LT(sink_.since_cycle, 420U);
}

TEST_F(DiagnosisNodeTest, TellsTheOnsetOfWhatItAnnouncesAndNoneAfterARestart) {
  const std::vector<CanFrame> faulty = record_frames(inputs_, 600);  // u2, u3 fail at cycle 400
  const std::vector<CanFrame> fresh = record_frames(inputs_, 300);
  DiagnosisNode node(inputs_.map, inputs_.bank, true);
  for (std::size_t i = 0; i < 2000; ++i) node.on_frame(faulty[i], sink_);
  EXPECT_EQ(sink_.onset, Onset());
  for (std::size_t i = 2000; i < faulty.size(); ++i) node.on_frame(faulty[i], sink_);
  const std::uint32_t announced_after = inputs_.bank.decision.dwell + inputs_.bank.decision.settle;
  EXPECT_GE(sink_.onset.cycle, 400);
  EXPECT_LE(sink_.onset.cycle, sink_.onset.last_cycle);
  EXPECT_EQ(sink_.onset.last_cycle, sink_.since_cycle - announced_after + 2);
  for (const CanFrame& frame : fresh) node.on_frame(frame, sink_);
  EXPECT_EQ(sink_.last.verdict, Verdict::kHealthy);
  EXPECT_EQ(sink_.onset, Onset());
}

}  // namespace
}  // namespace faultline
