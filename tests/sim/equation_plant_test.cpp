#include "sim/equation_plant.h"

#include <array>
#include <filesystem>
#include <limits>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "diagnosis/model/plant_file.h"
#include "sim/linearisation.h"
#include "sim/model_plant.h"
#include "sim/perturbation_schedule.h"
#include "sim/plant_library.h"
#include "sim/plants/catalogue.h"
#include "tests/support/allocation_guard.h"

namespace faultline {
namespace {

using ::testing::HasSubstr;
using enum IntegrationMethod;

TEST(EquationPlant, RunsAsTheLipschitzPlantFileOfTheSameRobot) {
  const PlantModel file =
      read_plant(std::filesystem::path(FAULTLINE_EXAMPLES_DIR) / "ma2024/plant.toml");
  for (const IntegrationMethod method : {kRk4, kDormandPrince}) {
    const Integration integration{
        .method = method, .absolute_tolerance = 1e-11, .relative_tolerance = 1e-11};
    EquationPlant equations(catalogue_plant("flexible_joint"), file, 0.01, integration);
    ModelPlant model(file, 0.01, {.method = kRk4, .substeps = method == kRk4 ? 10 : 100});
    PerturbationSchedule source(file, {{.target = "all"}}, {{.target = "all"}}, 5);
    ActivePerturbations acting = source.none();
    std::array<double, 3> y_equations{}, y_model{};
    for (int k = 0; k < 1000; ++k) {
      source.advance(0.01 * k, acting);
      const std::array<double, 1> u{2.0 * std::sin(0.06 * k)};
      equations.measure({u, {}, acting}, y_equations);
      model.measure({u, {}, acting}, y_model);
      for (std::size_t i = 0; i < 3; ++i) ASSERT_NEAR(y_equations[i], y_model[i], 1e-9) << k;
      equations.step({u, {}, acting});
      model.step({u, {}, acting});
    }
    EXPECT_GT(equations.state().norm(), 0.1) << "it must have moved";
  }
}

PlantModel tank_file() { return linearise(catalogue_plant("three_tank")).model; }

TEST(EquationPlant, MatchesInputsAndOutputsByName) {
  PlantModel file = tank_file();
  EquationPlant plant(catalogue_plant("three_tank"), file, 0.1);
  std::swap(file.input_names[0], file.input_names[1]);
  std::swap(file.output_names[0], file.output_names[2]);
  EquationPlant other(catalogue_plant("three_tank"), file, 0.1);
  const std::vector<double> none(6, 0.0);
  for (int k = 0; k < 50; ++k) {
    plant.step({std::array{5e-5, 2e-5}, none, {}});
    other.step({std::array{2e-5, 5e-5}, none, {}});
  }
  EXPECT_EQ(plant.state(), other.state());
  std::array<double, 3> y{}, y_other{};
  plant.measure({std::array{5e-5, 2e-5}, none, {}}, y);
  other.measure({std::array{2e-5, 5e-5}, none, {}}, y_other);
  EXPECT_EQ(y[0], y_other[2]);
  EXPECT_EQ(y[2], y_other[0]);
  EXPECT_NE(y[0], y[2]);
}

TEST(EquationPlant, AddsDeviationsToItsParameters) {
  const PlantModel file = tank_file();
  EquationPlant plant(catalogue_plant("three_tank"), file, 1.0, {}, {{"leak1", 1.0}});
  EquationPlant leaking(catalogue_plant("three_tank"), file, 1.0);
  EXPECT_EQ(plant.components()[0].name, "leak1");
  EXPECT_EQ(plant.components()[0].nominal, 1.0);
  std::vector<double> none(6, 0.0), leak(6, 0.0);
  leak[0] = 1.0;
  const std::array<double, 2> u{file.u_operating[0], file.u_operating[1]};
  for (int k = 0; k < 100; ++k) {
    plant.step({u, none, {}});
    leaking.step({u, leak, {}});
  }
  EXPECT_EQ(plant.state(), leaking.state());
  EXPECT_LT(plant.state()[0], file.x_operating[0] - 1.0);
}

TEST(EquationPlant, RefusesWhatDoesNotFitItsFile) {
  const auto refusal = [](PlantModel file, const Integration& integration = {},
                          const PlantParameters& parameters = {}) -> std::string {
    try {
      const EquationPlant plant(catalogue_plant("three_tank"), file, 0.1, integration, parameters);
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "";
  };
  PlantModel file = tank_file();
  EXPECT_EQ(refusal(file), "");
  EXPECT_THAT(refusal(file, {}, {{"leak9", 0.0}}), HasSubstr("parameters: found \"leak9\""));
  EXPECT_THAT(refusal(file, {.method = kExact}), HasSubstr("expected \"rk4\" or"));
  file.input_names[0] = "pumb1";
  EXPECT_THAT(refusal(file), HasSubstr("inputs: found \"pumb1\""));
  EXPECT_THAT(refusal(file), HasSubstr("did you mean \"pump1\"?"));
  file = tank_file();
  std::swap(file.state_names[0], file.state_names[1]);
  EXPECT_THAT(refusal(file), HasSubstr("states: found h2, h1, h3, expected them in the order"));
  file = tank_file();
  file.disturbances[0].name = "inflaw";
  EXPECT_THAT(refusal(file), HasSubstr("disturbances: found \"inflaw\""));
}

TEST(EquationPlant, NamesTheStateThatIsNotFinite) {
  const PlantModel file = linearise(catalogue_plant("hou2015")).model;
  EquationPlant plant(catalogue_plant("hou2015"), file, 1.0);
  plant.reset(Eigen::Vector3d(1.0, 1.0, 1.0));
  EXPECT_EQ(plant.failure(), "");
  const std::array<double, 4> u{};
  for (int k = 0; k < 1000; ++k) plant.step({u, {}, {}});
  EXPECT_FALSE(plant.is_finite());
  EXPECT_EQ(plant.failure(), "x1 is not finite");
}

TEST(EquationPlant, DoesNotAllocateWhileItRuns) {
  const PlantModel file = tank_file();
  for (const IntegrationMethod method : {kRk4, kDormandPrince}) {
    EquationPlant plant(catalogue_plant("three_tank"), file, 0.1, {.method = method});
    PerturbationSchedule source(file, {{.target = "all"}}, {{.target = "all"}}, 5);
    ActivePerturbations acting = source.none();
    const std::vector<double> none(6, 0.0);
    std::array<double, 3> y{};
    const AllocationGuard guard;
    for (int k = 0; k < 1000; ++k) {
      source.advance(0.1 * k, acting);
      plant.measure({std::array{1.2e-4, 0.0}, none, acting}, y);
      plant.step({std::array{1.2e-4, 0.0}, none, acting});
    }
    EXPECT_EQ(guard.heap_calls(), 0U) << integration_method_name(method);
    EXPECT_TRUE(plant.is_finite());
  }
}

TEST(PlantTable, IsCheckedBeforeItIsUsed) {
  const auto refusal = [](auto change) -> std::string {
    faultline_plant_table table = catalogue_plant("three_tank");
    change(table);
    try {
      check_plant_table(table);
    } catch (const PlantLibraryError& error) {
      return error.what();
    }
    return "";
  };
  using Table = faultline_plant_table;
  static constexpr faultline_plant_signal kTwice[] = {{"a", "", 0, 1}, {"a", "", 0, 1}};
  static constexpr faultline_plant_signal kNameless[] = {{"", "", 0, 1}};
  static constexpr faultline_plant_signal kNoSize[] = {{"a", "", 0, 0}};
  EXPECT_EQ(refusal([](Table&) {}), "");
  EXPECT_THAT(refusal([](Table& t) { t.version = 2; }), HasSubstr("version: found 2, expected 1"));
  EXPECT_THAT(refusal([](Table& t) { t.size = 8; }), HasSubstr("size: found 8 bytes"));
  EXPECT_THAT(refusal([](Table& t) { t.name = nullptr; }), HasSubstr("name: found a null pointer"));
  EXPECT_THAT(refusal([](Table& t) { t.state_count = 0; }), HasSubstr("states: found none"));
  EXPECT_THAT(refusal([](Table& t) { t.inputs = nullptr; }), HasSubstr("inputs: found a null"));
  EXPECT_THAT(refusal([](Table& t) { t.derivative = nullptr; }), HasSubstr("derivative: found a"));
  EXPECT_THAT(refusal([](Table& t) { t.measure = nullptr; }), HasSubstr("measure: found a null"));
  EXPECT_THAT(refusal([](Table& t) { t.events = nullptr; }), HasSubstr("events: found a null"));
  EXPECT_THAT(refusal([](Table& t) { t.inputs = kTwice; }), HasSubstr("inputs: found \"a\" twice"));
  EXPECT_THAT(refusal([](Table& t) {
                t.inputs = kNameless;
                t.input_count = 1;
              }),
              HasSubstr("inputs: found no name at place 1"));
  EXPECT_THAT(refusal([](Table& t) {
                t.outputs = kNoSize;
                t.output_count = 1;
              }),
              HasSubstr("outputs: found size 0 of \"a\""));
}

}  // namespace
}  // namespace faultline
