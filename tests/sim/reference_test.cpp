#include "sim/reference.h"

#include <array>

#include <gtest/gtest.h>

#include "sim/static_feedback.h"
#include "tests/sim/test_plants.h"
#include "tests/support/allocation_guard.h"

namespace faultline {
namespace {

constexpr double kSampleTime_s = 0.5;

double at(const Reference& reference, std::uint32_t k, Eigen::Index output = 0) {
  Eigen::VectorXd y(reference.start().size());
  reference.at(k, y);
  return y[output];
}

TEST(Reference, StaysWhereItStartsWithoutSteps) {
  const Reference reference((Eigen::VectorXd(2) << 3.0, -1.0).finished());
  EXPECT_EQ(at(reference, 0, 0), 3.0);
  EXPECT_EQ(at(reference, 4'000'000'000, 1), -1.0);
}

TEST(Reference, StepsAtItsTimeAndOnItsOutputOnly) {
  const Reference reference(Eigen::VectorXd::Zero(2), {{.output = 1, .at_s = 2.0, .value = 5.0}},
                            kSampleTime_s);
  EXPECT_EQ(at(reference, 3, 1), 0.0);
  EXPECT_EQ(at(reference, 4, 1), 5.0);
  EXPECT_EQ(at(reference, 4, 0), 0.0);
}

TEST(Reference, RampsOnAStraightLine) {
  const Reference reference(Eigen::VectorXd::Constant(1, 1.0),
                            {{.output = 0, .at_s = 1.0, .value = 3.0, .ramp_s = 2.0}},
                            kSampleTime_s);
  EXPECT_EQ(at(reference, 2), 1.0);
  EXPECT_EQ(at(reference, 3), 1.5);
  EXPECT_EQ(at(reference, 5), 2.5);
  EXPECT_EQ(at(reference, 6), 3.0);
  EXPECT_EQ(at(reference, 7), 3.0);
}

TEST(Reference, GoesOnFromWhereAnInterruptedRampHasComeTo) {
  const Reference reference(Eigen::VectorXd::Zero(1),
                            {{.output = 0, .at_s = 0.0, .value = 4.0, .ramp_s = 4.0},
                             {.output = 0, .at_s = 2.0, .value = 0.0, .ramp_s = 1.0}},
                            kSampleTime_s);
  EXPECT_EQ(at(reference, 3), 1.5);
  EXPECT_EQ(at(reference, 4), 2.0);
  EXPECT_EQ(at(reference, 5), 1.0);
  EXPECT_EQ(at(reference, 6), 0.0);
}

TEST(Reference, DoesNotAllocateWhileItRuns) {
  const Reference reference(Eigen::VectorXd::Zero(2),
                            {{.output = 1, .at_s = 2.0, .value = 5.0, .ramp_s = 100.0}},
                            kSampleTime_s);
  Eigen::VectorXd y(2);
  const AllocationGuard guard;
  for (std::uint32_t k = 0; k < 1000; ++k) reference.at(k, y);
  EXPECT_EQ(guard.heap_calls(), 0U);
}

TEST(StaticFeedback, PullsTowardsTheReferenceAndStaysWithinItsLimits) {
  const PlantModel model = double_integrator();  // u₀ = 3, y₀ = (1, 2)
  ControlLaw law = state_feedback(model, (Eigen::MatrixXd(1, 2) << 2.0, 1.0).finished(),
                                  Eigen::VectorXd::Zero(1));
  law.reference = Reference(Eigen::Vector2d(5.0, 2.0));
  law.base.lower[0] = 0.0;
  law.base.upper[0] = 10.0;
  StaticFeedback feedback(law);
  const auto command = [&](double y1, double y2) {
    const std::array<double, 2> y{y1, y2};
    std::array<double, 1> u{};
    feedback.command(0, y, u);
    return u[0];
  };
  EXPECT_EQ(command(4.0, 2.0), 3.0 + 2.0 * 1.0);
  EXPECT_EQ(command(5.0, 3.0), 3.0 - 1.0);
  EXPECT_EQ(command(1.0, 2.0), 10.0);
  EXPECT_EQ(command(9.0, 2.0), 0.0);
}

}  // namespace
}  // namespace faultline
