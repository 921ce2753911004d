#include "sim/model_plant.h"

#include <array>

#include <gtest/gtest.h>

#include "sim/plant_faults.h"
#include "tests/sim/test_plants.h"
#include "tests/support/allocation_guard.h"

namespace faultline {
namespace {

constexpr double kPeriod_s = 0.1;

TEST(ModelPlant, StaysAtItsOperatingPoint) {
  const PlantModel model = double_integrator();
  // At speed 2 the position of a double integrator moves; held there by x₀ it does not: the model
  // is one of deviations.
  ModelPlant plant(model, kPeriod_s);
  const std::vector<double> none = no_faults(model);
  const std::array<double, 1> u{3.0};
  std::array<double, 2> y{};
  for (int k = 0; k < 100; ++k) {
    plant.measure({u, none, {}}, y);
    EXPECT_DOUBLE_EQ(y[0], 1.0);
    EXPECT_DOUBLE_EQ(y[1], 2.0);
    plant.step({u, none, {}});
  }
}

TEST(ModelPlant, StepsAConstantInputExactly) {
  const PlantModel model = double_integrator();
  ModelPlant plant(model, kPeriod_s);
  const std::vector<double> none = no_faults(model);
  const std::array<double, 1> u{3.0 + 5.0};
  constexpr int kSteps = 37;
  for (int k = 0; k < kSteps; ++k) plant.step({u, none, {}});
  const double t_s = kSteps * kPeriod_s;
  EXPECT_NEAR(plant.state()[0], 1.0 + 0.5 * 5.0 * t_s * t_s, 1e-11);
  EXPECT_NEAR(plant.state()[1], 2.0 + 5.0 * t_s, 1e-12);
}

TEST(ModelPlant, AddsFaultsOfThePlantFile) {
  const PlantModel model = double_integrator();
  ModelPlant plant(model, kPeriod_s);
  const std::vector<double> faults{4.0};  // position' += 4, y2 += 0.5·4
  const std::array<double, 1> u{5.0};     // deviation 2
  std::array<double, 2> y{};
  plant.step({u, faults, {}});
  plant.measure({u, faults, {}}, y);
  EXPECT_NEAR(y[0], 1.0 + 0.5 * 2.0 * 0.01 + 4.0 * 0.1, 1e-14);
  EXPECT_NEAR(y[1], 2.0 + 2.0 * 0.1 + 0.5 * 4.0, 1e-14);
}

TEST(ModelPlant, RefusesWhatItCannotStep) {
  PlantModel model = double_integrator();
  EXPECT_THROW(ModelPlant(model, 0.0), std::invalid_argument);
  EXPECT_THROW(ModelPlant(model, -1.0), std::invalid_argument);
  model.time = TimeDomain::kDiscrete;
  model.sample_time_s = 0.2;
  EXPECT_NO_THROW(ModelPlant(model, 0.2));
  EXPECT_THROW(ModelPlant(model, 0.1), std::invalid_argument);
  EXPECT_THROW(ModelPlant(model, 0.2, {.method = IntegrationMethod::kRk4}), std::invalid_argument);
}

TEST(ModelPlant, DoesNotAllocateWhileItRuns) {
  const PlantModel model = double_integrator();
  const FaultSchedule schedule(model, {{.target = "force", .value = 1.0, .at_s = 1.0}});
  ModelPlant plant(model, kPeriod_s);
  PlantFaults faults(schedule, kPeriod_s);
  std::array<double, 1> u{8.0};
  std::array<double, 2> y{};
  const AllocationGuard guard;
  for (int k = 0; k < 1000; ++k) {
    faults.advance(k * kPeriod_s);
    faults.actuate(u, u);
    plant.measure({u, faults.components(), {}}, y);
    plant.step({u, faults.components(), {}});
  }
  EXPECT_EQ(guard.heap_calls(), 0U);
}

}  // namespace
}  // namespace faultline
