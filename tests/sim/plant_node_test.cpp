#include "sim/plant_node.h"

#include <array>
#include <cmath>

#include <gtest/gtest.h>

#include "drivers/signal/message_integrity.h"
#include "tests/sim/test_plants.h"
#include "tests/support/allocation_guard.h"

namespace faultline {
namespace {

class PlantNodeTest : public testing::Test {
 protected:
  CanFrame command(std::uint32_t counter, double force) const {
    CanFrame frame;
    const std::array<double, 1> u{force};
    map_.command_messages[0].encode(u, counter, frame);
    return frame;
  }
  std::int64_t sync_field(const SignalCodec& codec, const CanFrame& frame) const {
    std::int64_t value = 0;
    EXPECT_EQ(codec.decode_raw(frame.payload(), value), CodecStatus::kOk);
    return value;
  }

  PlantModel model_ = double_integrator();
  SignalMap map_ = double_integrator_map();
  FaultSchedule schedule_{model_, {}};
  PlantNode node_{model_, map_, schedule_, 0.1, model_.x_operating};
  RecordingSink sink_;
};

TEST_F(PlantNodeTest, SendsSyncThenAllSensorMessages) {
  node_.on_cycle(0, sink_);
  ASSERT_EQ(sink_.frames.size(), 3U);
  EXPECT_TRUE(map_.sync->matches(sink_.frames[0]));
  EXPECT_TRUE(map_.sensor_messages[0].matches(sink_.frames[1]));
  EXPECT_TRUE(map_.sensor_messages[1].matches(sink_.frames[2]));
  std::array<double, 2> y{};
  EXPECT_EQ(map_.sensor_messages[0].decode(sink_.frames[1], y), CodecStatus::kOk);
  EXPECT_EQ(map_.sensor_messages[1].decode(sink_.frames[2], y), CodecStatus::kOk);
  EXPECT_EQ(y[0], 1.0);
  EXPECT_EQ(y[1], 2.0);
}

TEST_F(PlantNodeTest, SaysThatNoCommandActsYetAndAppliesZero) {
  node_.on_cycle(0, sink_);
  EXPECT_EQ(sync_field(*map_.sync->command_cycle, sink_.frames[0]), kNoCommand);
  node_.on_cycle(1, sink_);
  // u = 0 is a deviation of -3 from the operating point.
  EXPECT_NEAR(node_.state()[1], 2.0 - 3.0 * 0.1, 1e-14);
}

TEST_F(PlantNodeTest, LatchesTheNewestCompleteCommand) {
  node_.on_cycle(0, sink_);
  node_.on_frame(command(0, 4.0));
  EXPECT_TRUE(node_.has_command(0));
  EXPECT_FALSE(node_.has_command(1));
  sink_.frames.clear();
  node_.on_cycle(1, sink_);
  EXPECT_EQ(sync_field(map_.sync->cycle, sink_.frames[0]), 1);
  EXPECT_EQ(sync_field(*map_.sync->command_cycle, sink_.frames[0]), 0);
  EXPECT_FALSE(node_.truth().is_late);
  const double speed = node_.state()[1];
  node_.on_cycle(2, sink_);
  EXPECT_NEAR(node_.state()[1], speed + (4.0 - 3.0) * 0.1, 1e-14);
}

TEST_F(PlantNodeTest, CountsACycleThatActsOnAnOlderCommand) {
  node_.on_cycle(0, sink_);
  node_.on_frame(command(0, 4.0));
  node_.on_cycle(1, sink_);
  node_.on_cycle(2, sink_);
  EXPECT_TRUE(node_.truth().is_late);
  EXPECT_EQ(node_.truth().command_cycle, 0U);
  EXPECT_EQ(node_.late_cycles(), 1U);
}

TEST_F(PlantNodeTest, DoesNotGoBackToAnOlderCommand) {
  node_.on_cycle(5, sink_);
  node_.on_frame(command(5, 4.0));
  node_.on_frame(command(4, 9.0));
  node_.on_cycle(6, sink_);
  EXPECT_EQ(node_.truth().command_cycle, 5U);
}

TEST_F(PlantNodeTest, CountsValuesThatDoNotFitTheirSignals) {
  Eigen::VectorXd far(2);
  far << 1e9, 0.0;
  PlantNode node(model_, map_, schedule_, 0.1, far);
  node.on_cycle(0, sink_);
  EXPECT_EQ(node.clamped_values(), 1U);
}

// The cycle ends with 2^32 - 1, the counters of profile 1 with 14.
TEST_F(PlantNodeTest, ProtectsEveryFrameAlsoWhereTheCycleWraps) {
  const SignalMap map = protected_double_integrator_map();
  PlantNode node(model_, map, schedule_, 0.1, model_.x_operating);
  MessageIntegrity sync(map.sync->protection);
  MessageIntegrity position(map.sensor_messages[0].protection);
  MessageIntegrity speed(map.sensor_messages[1].protection);
  for (std::uint32_t k = 0xFFFF'FFC0; k != 100; ++k) {
    sink_.frames.clear();
    node.on_cycle(k, sink_);
    ASSERT_EQ(sink_.frames.size(), 3U);
    EXPECT_EQ(sync.check(sink_.frames[0]).status, IntegrityStatus::kOk) << k;
    EXPECT_EQ(position.check(sink_.frames[1]).status, IntegrityStatus::kOk) << k;
    EXPECT_EQ(speed.check(sink_.frames[2]).status, IntegrityStatus::kOk) << k;
  }
  EXPECT_EQ(speed.counters().frames, 164U);
}

TEST_F(PlantNodeTest, DoesNotAllocateWhileItProtectsItsFrames) {
  class NullSink final : public FrameSink {
    bool send(const CanFrame& /*frame*/) noexcept override { return true; }
  } sink;
  const SignalMap map = protected_double_integrator_map();
  PlantNode node(model_, map, schedule_, 0.1, model_.x_operating);
  const AllocationGuard guard;
  for (std::uint32_t k = 0; k < 1000; ++k) node.on_cycle(k, sink);
  EXPECT_EQ(guard.heap_calls(), 0U);
}

TEST_F(PlantNodeTest, LetsDisturbancesAndNoiseActAndSaysWhich) {
  PlantModel model = model_;
  model.disturbances = {{.name = "d",
                         .state = Eigen::Vector2d(0.0, 1.0),
                         .output = Eigen::Vector2d::Zero(),
                         .bound = 8.0}};
  model.noises = {{.name = "n", .output = Eigen::Vector2d(1.0, 0.0), .bound = 4.0, .sigma = {}}};
  PlantNode node(model, map_, schedule_, 0.1, model.x_operating,
                 PerturbationSchedule(model, {{.target = "d"}}, {{.target = "n"}}, 1));
  for (std::uint32_t k = 0; k < 20; ++k) {
    const Eigen::VectorXd x = node.state();
    const double d = k == 0 ? 0.0 : node.perturbations().disturbance[0];
    sink_.frames.clear();
    node.on_cycle(k, sink_);
    if (k > 0) {
      EXPECT_NEAR(node.state()[1], x[1] + (d - 3.0) * 0.1, 1e-12) << "no command: u = 0";
    }
    EXPECT_LE(std::abs(node.perturbations().disturbance[0]), 8.0);
    std::array<double, 2> y{};
    EXPECT_EQ(map_.sensor_messages[0].decode(sink_.frames[1], y), CodecStatus::kOk);
    EXPECT_NEAR(y[0], node.state()[0] + node.perturbations().noise[0], 0.5 / 1024.0);
  }
}

TEST_F(PlantNodeTest, DoesNotAllocateWhileANonlinearPlantIsDisturbed) {
  class NullSink final : public FrameSink {
    bool send(const CanFrame& /*frame*/) noexcept override { return true; }
  } sink;
  PlantModel model = model_;
  model.noises = {{.name = "n", .output = Eigen::Vector2d(1.0, 0.0), .bound = 4.0, .sigma = {}}};
  model.nonlinearities = {{.function = {.kind = FunctionKind::kTanh},
                           .E_o = Eigen::Vector2d::UnitY(),
                           .E_i = Eigen::Vector2d::UnitX()}};
  PlantNode node(model, map_, schedule_, 0.1, model.x_operating,
                 PerturbationSchedule(model, {}, {{.target = "n"}}, 1));
  const AllocationGuard guard;
  for (std::uint32_t k = 0; k < 1000; ++k) node.on_cycle(k, sink);
  EXPECT_EQ(guard.heap_calls(), 0U);
}

TEST_F(PlantNodeTest, DoesNotAllocateWhileItRuns) {
  class NullSink final : public FrameSink {
    bool send(const CanFrame& /*frame*/) noexcept override { return true; }
  } sink;
  const CanFrame frame = command(0, 3.0);
  const AllocationGuard guard;
  for (std::uint32_t k = 0; k < 1000; ++k) {
    node_.on_cycle(k, sink);
    node_.on_frame(frame);
  }
  EXPECT_EQ(guard.heap_calls(), 0U);
}

}  // namespace
}  // namespace faultline
