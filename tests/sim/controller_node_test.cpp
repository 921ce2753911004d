#include "sim/controller_node.h"

#include <array>
#include <cmath>

#include <gtest/gtest.h>

#include "drivers/signal/message_integrity.h"
#include "sim/plant_node.h"
#include "tests/sim/test_plants.h"
#include "tests/support/allocation_guard.h"

namespace faultline {
namespace {

Eigen::MatrixXd gain(double position, double speed) {
  return (Eigen::MatrixXd(1, 2) << position, speed).finished();
}

const Eigen::VectorXd kNoFeedforward = Eigen::VectorXd::Zero(1);

TEST(ControlLaw, OfStateFeedbackReadsTheStateFromTheOutputs) {
  PlantModel model = double_integrator();
  model.C = (Eigen::MatrixXd(2, 2) << 2, 0, 0, 4).finished();
  const ControlLaw law = state_feedback(model, gain(6.0, 8.0), kNoFeedforward);
  EXPECT_NEAR(law.gain(0, 0), 3.0, 1e-14);
  EXPECT_NEAR(law.gain(0, 1), 2.0, 1e-14);
}

TEST(ControlLaw, RefusesAPlantWhoseStateIsNotMeasured) {
  PlantModel model = double_integrator();
  model.C = (Eigen::MatrixXd(2, 2) << 1, 0, 2, 0).finished();
  EXPECT_THROW(static_cast<void>(state_feedback(model, gain(1.0, 1.0), kNoFeedforward)),
               std::invalid_argument);
}

TEST(ControlLaw, RefusesAPlantWithFeedthrough) {
  PlantModel model = double_integrator();
  model.D(0, 0) = 1.0;
  EXPECT_THROW(static_cast<void>(state_feedback(model, gain(1.0, 1.0), kNoFeedforward)),
               std::invalid_argument);
}

TEST(ControllerNode, AddsASineOnEachInputByTheCycle) {
  const PlantModel model = double_integrator();
  const SignalMap map = double_integrator_map();
  const FaultSchedule schedule(model, {});
  PlantNode plant(model, map, schedule, 0.1, model.x_operating);
  ControlLaw law = open_loop(model, kNoFeedforward);
  law.base.amplitude[0] = 4.0;
  law.base.omega_rad[0] = 0.3;
  ControllerNode controller(map, law);
  for (const std::uint32_t k : {0U, 1U, 7U}) {
    RecordingSink from_plant;
    RecordingSink from_controller;
    plant.on_cycle(k, from_plant);
    for (const CanFrame& frame : from_plant.frames) controller.on_frame(frame, from_controller);
    ASSERT_EQ(from_controller.frames.size(), 1U);
    std::array<double, 1> u{};
    ASSERT_EQ(map.command_messages[0].decode(from_controller.frames[0], u), CodecStatus::kOk);
    EXPECT_NEAR(u[0], model.u_operating[0] + 4.0 * std::sin(0.3 * k), 1e-2);
  }
}

TEST(ControllerNode, AnswersACompleteMeasurementWithCommandsOfItsCounter) {
  const PlantModel model = double_integrator();
  const SignalMap map = double_integrator_map();
  const FaultSchedule schedule(model, {});
  Eigen::VectorXd x(2);
  x << 2.0, 1.0;  // deviation (1, -1)
  PlantNode plant(model, map, schedule, 0.1, x);
  ControllerNode controller(
      map, state_feedback(model, gain(0.5, 0.25), Eigen::VectorXd::Constant(1, 10.0)));
  RecordingSink from_plant;
  RecordingSink from_controller;
  plant.on_cycle(300, from_plant);
  for (std::size_t i = 0; i + 1 < from_plant.frames.size(); ++i) {
    controller.on_frame(from_plant.frames[i], from_controller);
  }
  EXPECT_TRUE(from_controller.frames.empty());
  controller.on_frame(from_plant.frames.back(), from_controller);
  ASSERT_EQ(from_controller.frames.size(), 1U);
  std::array<double, 1> u{};
  EXPECT_EQ(map.command_messages[0].decode(from_controller.frames[0], u), CodecStatus::kOk);
  EXPECT_EQ(u[0], 3.0 + 10.0 - (0.5 * 1.0 + 0.25 * -1.0));
  plant.on_frame(from_controller.frames[0]);
  EXPECT_TRUE(plant.has_command(300));
}

TEST(ControllerNode, DrivesAPlantToItsOperatingPoint) {
  const PlantModel model = double_integrator();
  const SignalMap map = double_integrator_map();
  const FaultSchedule schedule(model, {});
  Eigen::VectorXd x(2);
  x << 5.0, -3.0;
  PlantNode plant(model, map, schedule, 0.1, x);
  const Eigen::MatrixXd K =
      lqr_gain(model, 0.1, Eigen::MatrixXd::Identity(2, 2), Eigen::MatrixXd::Identity(1, 1));
  ControllerNode controller(map, state_feedback(model, K, kNoFeedforward));
  for (std::uint32_t k = 0; k < 300; ++k) {
    RecordingSink from_plant;
    RecordingSink from_controller;
    plant.on_cycle(k, from_plant);
    for (const CanFrame& frame : from_plant.frames) controller.on_frame(frame, from_controller);
    for (const CanFrame& frame : from_controller.frames) plant.on_frame(frame);
  }
  EXPECT_EQ(plant.late_cycles(), 0U);
  // Quantisation of 2^-10 leaves a little motion.
  EXPECT_NEAR(plant.state()[0], 1.0, 0.01);
  EXPECT_NEAR(plant.state()[1], 2.0, 0.01);
}

TEST(ControllerNode, DoesNotAllocateWhileItRuns) {
  class NullSink final : public FrameSink {
    bool send(const CanFrame& /*frame*/) noexcept override { return true; }
  } sink;
  const PlantModel model = double_integrator();
  const SignalMap map = double_integrator_map();
  const FaultSchedule schedule(model, {});
  PlantNode plant(model, map, schedule, 0.1, model.x_operating);
  ControllerNode controller(map, open_loop(model, kNoFeedforward));
  RecordingSink frames;
  for (std::uint32_t k = 0; k < 200; ++k) plant.on_cycle(k, frames);
  const AllocationGuard guard;
  for (const CanFrame& frame : frames.frames) controller.on_frame(frame, sink);
  EXPECT_EQ(guard.heap_calls(), 0U);
}

TEST(ControllerNode, ProtectsItsCommands) {
  const PlantModel model = double_integrator();
  const SignalMap map = protected_double_integrator_map();
  const FaultSchedule schedule(model, {});
  PlantNode plant(model, map, schedule, 0.1, model.x_operating);
  ControllerNode controller(map, state_feedback(model, gain(0.5, 0.25), kNoFeedforward));
  MessageIntegrity command(map.command_messages[0].protection);
  for (std::uint32_t k = 0xFFFF'FFC0; k != 100; ++k) {
    RecordingSink from_plant;
    RecordingSink from_controller;
    plant.on_cycle(k, from_plant);
    for (const CanFrame& frame : from_plant.frames) controller.on_frame(frame, from_controller);
    ASSERT_EQ(from_controller.frames.size(), 1U);
    EXPECT_EQ(command.check(from_controller.frames[0]).status, IntegrityStatus::kOk);
    plant.on_frame(from_controller.frames[0]);
  }
  EXPECT_EQ(command.counters().frames, 164U);
}

}  // namespace
}  // namespace faultline
