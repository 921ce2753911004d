#include "sim/integration.h"

#include <stdexcept>
#include <string>

#include <gtest/gtest.h>

#include "tests/sim/test_plants.h"

namespace faultline {
namespace {

using enum IntegrationMethod;

PlantModel discrete(PlantModel plant) {
  plant.time = TimeDomain::kDiscrete;
  plant.sample_time_s = 0.1;
  return plant;
}

PlantModel nonlinear() { return scalar_plant(0.0, 1.0, {.kind = FunctionKind::kSin}); }

std::string refusal(const PlantModel& plant, const Integration& integration) {
  try {
    static_cast<void>(method_for(plant, integration));
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "accepted";
}

TEST(MethodFor, IsExactWhereverThatCanBe) {
  EXPECT_EQ(method_for(double_integrator(), {}), kExact);
  EXPECT_EQ(method_for(discrete(double_integrator()), {}), kExact);
  EXPECT_EQ(method_for(discrete(nonlinear()), {}), kExact);
  EXPECT_EQ(method_for(nonlinear(), {}), kRk4);
}

TEST(MethodFor, IsWhatWasAskedForOfAContinuousPlant) {
  for (const IntegrationMethod method : {kZoh, kEuler, kRk4}) {
    EXPECT_EQ(method_for(double_integrator(), {.method = method}), method);
    EXPECT_EQ(method_for(nonlinear(), {.method = method}), method);
  }
}

TEST(MethodFor, RefusesWhatThePlantCannotBeSteppedBy) {
  EXPECT_EQ(refusal(nonlinear(), {.method = kExact}),
            "method: found \"exact\", expected \"zoh\", \"euler\" or \"rk4\": plant \"scalar\" is "
            "nonlinear and in continuous time");
  for (const IntegrationMethod method : {kZoh, kEuler, kRk4}) {
    EXPECT_NE(refusal(discrete(double_integrator()), {.method = method}), "accepted");
  }
  EXPECT_EQ(refusal(discrete(nonlinear()), {.method = kEuler}),
            "method: found \"euler\", expected \"exact\": plant \"scalar\" is in discrete time and "
            "steps by its own equation");
  EXPECT_EQ(refusal(nonlinear(), {.substeps = 0}), "substeps: found 0, expected 1 to 1000");
  EXPECT_EQ(refusal(nonlinear(), {.substeps = 1001}), "substeps: found 1001, expected 1 to 1000");
}

}  // namespace
}  // namespace faultline
