#include <array>
#include <cmath>
#include <filesystem>
#include <optional>
#include <vector>

#include <gtest/gtest.h>

#include "diagnosis/model/plant_file.h"
#include "sim/model_plant.h"
#include "sim/perturbation_schedule.h"
#include "sim/plant_faults.h"
#include "tests/sim/test_plants.h"
#include "tests/support/allocation_guard.h"

namespace faultline {
namespace {

using enum IntegrationMethod;

PlantModel robot(const char* file) {
  return read_plant(std::filesystem::path(FAULTLINE_EXAMPLES_DIR) / "ma2024" / file);
}

// x'' = -sin x
PlantModel pendulum() {
  PlantModel plant = double_integrator();
  plant.x_operating.setZero();
  plant.u_operating.setZero();
  plant.y_operating.setZero();
  plant.nonlinearities = {{.function = {.kind = FunctionKind::kSin},
                           .gain = -1.0,
                           .E_o = Eigen::Vector2d::UnitY(),
                           .E_i = Eigen::Vector2d::UnitX()}};
  return plant;
}

// |x(2) - exact| of x' = -tanh x, x(0) = 2, four samples of half a second; sinh x = e^-t sinh 2.
double rk4_error(int substeps) {
  const PlantModel model = scalar_plant(0.0, -1.0, {.kind = FunctionKind::kTanh});
  ModelPlant plant(model, 0.5, {.method = kRk4, .substeps = substeps});
  plant.reset(Eigen::VectorXd::Constant(1, 2.0));
  const std::vector<double> none = no_faults(model);
  const std::array<double, 1> u{0.0};
  for (int k = 0; k < 4; ++k) plant.step({u, none, {}});
  return std::abs(plant.state()[0] - std::asinh(std::exp(-2.0) * std::sinh(2.0)));
}

TEST(NonlinearPlant, ConvergesToTheAnalyticSolutionWithOrderFour) {
  EXPECT_LT(rk4_error(10), 1e-7);
  EXPECT_LT(rk4_error(200), 1e-12);
  for (const int substeps : {4, 8, 16}) {
    const double order = std::log2(rk4_error(substeps) / rk4_error(2 * substeps));
    EXPECT_NEAR(order, 4.0, 0.15) << substeps;
  }
}

TEST(NonlinearPlant, KeepsTheEnergyOfAPendulum) {
  const PlantModel model = pendulum();
  ModelPlant plant(model, 0.01);  // Runge-Kutta by itself
  plant.reset(Eigen::Vector2d(2.5, 0.0));
  const std::vector<double> none = no_faults(model);
  const std::array<double, 1> u{0.0};
  for (int k = 0; k < 10'000; ++k) {
    plant.step({u, none, {}});
    const double energy = 0.5 * plant.state()[1] * plant.state()[1] - std::cos(plant.state()[0]);
    ASSERT_NEAR(energy, -std::cos(2.5), 1e-11) << k;
  }
}

TEST(NonlinearPlant, HoldsCommandsFaultsAndDisturbancesOverTheSample) {
  // x' = -2 x + 3 + 0.5 - 0.2·0.5: φ adds nothing, the solution is that of a linear equation.
  const PlantModel model = scalar_plant(-2.0, 0.0, {.kind = FunctionKind::kSin});
  const std::vector<double> faults{0.5};
  const ActivePerturbations acting{Eigen::VectorXd::Constant(1, -0.2), Eigen::VectorXd::Zero(2)};
  const std::array<double, 1> u{3.0};
  constexpr double kT_s = 0.25;
  constexpr double kDrive = 3.0 + 0.5 - 0.1;
  const double expected =
      std::exp(-2.0 * kT_s) * 0.7 + (1.0 - std::exp(-2.0 * kT_s)) / 2.0 * kDrive;
  for (const IntegrationMethod method : {kZoh, kRk4}) {
    ModelPlant plant(model, kT_s, {.method = method, .substeps = 200});
    plant.reset(Eigen::VectorXd::Constant(1, 0.7));
    plant.step({u, faults, acting});
    EXPECT_NEAR(plant.state()[0], expected, 1e-12) << integration_method_name(method);
  }
}

TEST(NonlinearPlant, HoldsTheNonlinearityUnderZohAndFollowsTheTangentUnderEuler) {
  const PlantModel model = scalar_plant(-2.0, 3.0, {.kind = FunctionKind::kSin});
  const std::vector<double> none = no_faults(model);
  const std::array<double, 1> u{1.5};
  constexpr double kT_s = 0.25;
  const double drive = 1.5 + 3.0 * std::sin(0.7);
  ModelPlant zoh(model, kT_s, {.method = kZoh});
  zoh.reset(Eigen::VectorXd::Constant(1, 0.7));
  zoh.step({u, none, {}});
  EXPECT_NEAR(zoh.state()[0],
              std::exp(-2.0 * kT_s) * 0.7 + (1.0 - std::exp(-2.0 * kT_s)) / 2.0 * drive, 1e-15);
  ModelPlant euler(model, kT_s, {.method = kEuler});
  euler.reset(Eigen::VectorXd::Constant(1, 0.7));
  euler.step({u, none, {}});
  EXPECT_NEAR(euler.state()[0], 0.7 + kT_s * (-2.0 * 0.7 + drive), 1e-15);
}

TEST(NonlinearPlant, StepsInDiscreteTimeByItsOwnEquation) {
  PlantModel model = scalar_plant(0.9, 3.0, {.kind = FunctionKind::kSaturation, .width = 0.5});
  model.time = TimeDomain::kDiscrete;
  model.sample_time_s = 0.1;
  ModelPlant plant(model, 0.1);
  plant.reset(Eigen::VectorXd::Constant(1, 0.7));
  const ActivePerturbations acting{Eigen::VectorXd::Constant(1, 0.1), Eigen::VectorXd::Zero(2)};
  plant.step({std::array<double, 1>{-1.0}, no_faults(model), acting});
  EXPECT_DOUBLE_EQ(plant.state()[0], 0.9 * 0.7 - 1.0 + 3.0 * 0.5 + 0.5 * 0.1);
}

TEST(NonlinearPlant, TakesTheNonlinearityAboutTheOperatingPoint) {
  PlantModel model = scalar_plant(0.0, 1.0, {.kind = FunctionKind::kSin});
  model.x_operating[0] = 5.0;
  ModelPlant plant(model, 0.1, {.method = kEuler});
  plant.reset(Eigen::VectorXd::Constant(1, 5.5));
  plant.step({std::array<double, 1>{0.0}, no_faults(model), {}});
  EXPECT_DOUBLE_EQ(plant.state()[0], 5.0 + 0.5 + 0.1 * std::sin(0.5));
}

TEST(NonlinearPlant, MeasuresDisturbancesAndNoise) {
  const PlantModel model = scalar_plant(0.0, 1.0, {.kind = FunctionKind::kSin});
  ModelPlant plant(model, 0.1);
  plant.reset(Eigen::VectorXd::Constant(1, 0.7));
  const std::vector<double> faults = no_faults(model);
  const ActivePerturbations acting{Eigen::VectorXd::Constant(1, 0.01), Eigen::Vector2d(0.02, 0.03)};
  std::array<double, 1> y{};
  plant.measure({std::array<double, 1>{4.0}, faults, acting}, y);
  EXPECT_NEAR(y[0], 0.7 + 0.25 * 4.0 + 2.0 * 0.01 + 3.0 * 0.02 + 4.0 * 0.03, 1e-14);
}

TEST(NonlinearPlant, IsNotFiniteOnceItHasDiverged) {
  const PlantModel model = scalar_plant(50.0, 1.0, {.kind = FunctionKind::kTanh});
  for (const IntegrationMethod method : {kZoh, kEuler, kRk4}) {
    ModelPlant plant(model, 1.0, {.method = method});
    plant.reset(Eigen::VectorXd::Constant(1, 1.0));
    const std::vector<double> none = no_faults(model);
    EXPECT_TRUE(plant.is_finite());
    for (int k = 0; k < 1000; ++k) plant.step({std::array<double, 1>{0.0}, none, {}});
    EXPECT_FALSE(plant.is_finite());
  }
}

// The linear part, with nothing but commands and faults, must not change by what else there is.
TEST(NonlinearPlant, AnswersToTheBitAsALinearPlantWhereNothingNonlinearActs) {
  PlantModel linear = double_integrator();
  PlantModel model = linear;
  model.disturbances = {{.name = "d",
                         .state = Eigen::Vector2d(100.0, 7.0),
                         .output = Eigen::Vector2d::Zero(),
                         .bound = 1.0}};
  model.noises = {{.name = "n", .output = Eigen::Vector2d::Ones(), .bound = 1.0, .sigma = {}}};
  ModelPlant alone(linear, 0.1), beside(model, 0.1), zoh(model, 0.1, {.method = kZoh});
  const FaultSchedule schedule(linear, {{.target = "leak", .value = 0.3, .at_s = 1.0}});
  PlantFaults faults(schedule, 0.1);
  for (int k = 0; k < 100; ++k) {
    faults.advance(k * 0.1);
    std::array<double, 1> u{std::sin(0.3 * k)};
    faults.actuate(u, u);
    for (ModelPlant* plant : {&alone, &beside, &zoh}) plant->step({u, faults.components(), {}});
    ASSERT_EQ(alone.state(), beside.state());
    ASSERT_EQ(alone.state(), zoh.state());
  }
}

TEST(NonlinearPlant, StepsARobotByEulerAsItsDiscreteFileSays) {
  const PlantModel continuous = robot("plant.toml");
  const PlantModel discrete = robot("plant_euler.toml");
  ModelPlant a(continuous, 0.01, {.method = kEuler}), b(discrete, 0.01);
  const std::vector<Perturbation> all{{.target = "all"}};
  PerturbationSchedule source_a(continuous, all, all, 3), source_b(discrete, all, all, 3);
  ActivePerturbations acting_a = source_a.none(), acting_b = source_b.none();
  const FaultSchedule schedule(continuous, {{.target = "u1", .value = 0.3, .at_s = 1.0}});
  PlantFaults faults(schedule, 0.01);
  std::array<double, 3> y_a{}, y_b{};
  double largest = 0.0;
  for (int k = 0; k < 1000; ++k) {
    const double t_s = 0.01 * k;
    faults.advance(t_s);
    source_a.advance(t_s, acting_a);
    source_b.advance(t_s, acting_b);
    std::array<double, 1> u{std::sin(t_s)};
    faults.actuate(u, u);
    a.measure({u, faults.components(), acting_a}, y_a);
    b.measure({u, faults.components(), acting_b}, y_b);
    for (std::size_t i = 0; i < 3; ++i) ASSERT_NEAR(y_a[i], y_b[i], 1e-11) << k;
    a.step({u, faults.components(), acting_a});
    b.step({u, faults.components(), acting_b});
    largest = std::max(largest, a.state().cwiseAbs().maxCoeff());
  }
  EXPECT_GT(largest, 0.1) << "it must have moved";
}

TEST(NonlinearPlant, DoesNotAllocateWhileItRuns) {
  const PlantModel model = robot("plant.toml");
  const FaultSchedule schedule(model, {{.target = "u1",
                                        .kind = InjectionKind::kSinusoid,
                                        .value = 1.0,
                                        .at_s = 1.0,
                                        .frequency_Hz = 5.0}});
  const std::vector<Perturbation> all{{.target = "all"}};
  for (const IntegrationMethod method : {kZoh, kEuler, kRk4}) {
    ModelPlant plant(model, 0.01, {.method = method});
    PerturbationSchedule perturbations(model, all, all, 1);
    PlantFaults faults(schedule, 0.01);
    ActivePerturbations acting = perturbations.none();
    std::array<double, 1> u{0.5};
    std::array<double, 3> y{};
    const AllocationGuard guard;
    for (int k = 0; k < 1000; ++k) {
      faults.advance(k * 0.01);
      faults.actuate(u, u);
      perturbations.advance(k * 0.01, acting);
      plant.measure({u, faults.components(), acting}, y);
      plant.step({u, faults.components(), acting});
    }
    EXPECT_EQ(guard.heap_calls(), 0U) << integration_method_name(method);
  }
}

}  // namespace
}  // namespace faultline
