// The nonlinear plants that ship, stepped by two methods that share nothing but the equations:
// Runge-Kutta with fixed steps, and Dormand-Prince with steps controlled to tolerances.
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <functional>
#include <memory>
#include <numbers>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "diagnosis/model/plant_file.h"
#include "sim/equation_plant.h"
#include "sim/model_plant.h"
#include "sim/perturbation_schedule.h"
#include "sim/plants/azimuth_vessel.h"
#include "sim/plants/electric_car.h"
#include "sim/plants/three_tank.h"

namespace faultline {
namespace {

using Eigen::VectorXd;

using MakePlant =
    std::function<std::unique_ptr<SimulatedPlant>(const PlantModel&, double, const Integration&)>;

template <class P>
MakePlant by_equations() {
  return [](const PlantModel& model, double sample_time_s, const Integration& integration) {
    return std::make_unique<EquationPlant>(plant_table<P>(), model, sample_time_s, integration);
  };
}

std::unique_ptr<SimulatedPlant> by_file(const PlantModel& model, double sample_time_s,
                                        const Integration& integration) {
  return std::make_unique<ModelPlant>(model, sample_time_s, integration);
}

struct ShippedPlant {
  std::string name, folder;
  MakePlant make;
  double sample_time_s;
};

// Inputs of all frequencies that the plant follows, a fifth of their range; 20 s.
std::vector<VectorXd> course(const ShippedPlant& shipped, const PlantModel& model,
                             const Integration& integration) {
  const auto plant = shipped.make(model, shipped.sample_time_s, integration);
  plant->reset(model.x_operating);
  const PerturbationSchedule quiet(model, {}, {}, 1, shipped.sample_time_s);
  const ActivePerturbations none = quiet.none();
  const std::vector<double> components(plant->components().size());
  std::vector<double> u(static_cast<std::size_t>(model.m()));
  std::vector<VectorXd> states;
  const auto samples = static_cast<int>(std::lround(20.0 / shipped.sample_time_s));
  for (int k = 0; k < samples; ++k) {
    const double t_s = k * shipped.sample_time_s;
    for (std::size_t i = 0; i < u.size(); ++i) {
      const auto at = static_cast<Eigen::Index>(i);
      const double frequency_Hz = 0.13 * static_cast<double>(i + 1);
      u[i] = model.u_operating[at] +
             0.2 * model.input_range[at] * std::sin(2.0 * std::numbers::pi * frequency_Hz * t_s);
    }
    plant->step({u, components, none});
    EXPECT_TRUE(plant->is_finite()) << plant->failure();
    states.push_back(plant->state());
  }
  return states;
}

// Largest |a - b| over time, per state.
VectorXd distance(const std::vector<VectorXd>& a, const std::vector<VectorXd>& b) {
  VectorXd largest = VectorXd::Zero(a.front().size());
  for (std::size_t k = 0; k < a.size(); ++k) largest = largest.cwiseMax((a[k] - b[k]).cwiseAbs());
  return largest;
}

class IntegrationMethods : public testing::TestWithParam<ShippedPlant> {};

// Halving the steps of a method of order p takes away all but 2^-p of its error, so that the half
// steps are nearer to the truth than to the whole steps. Where the equations have a kink (|v| v of
// the drag at v = 0, valves, rims) the error is that of the one step of h = 5 ms with the kink in
// it, by wherever it lies there: h³ times what the second derivative jumps by, some 1e-7 of the
// motion. The truth is Dormand-Prince's, whose own error is that of its tolerances.
TEST_P(IntegrationMethods, AgreeOnWhatThePlantDoes) {
  const ShippedPlant& shipped = GetParam();
  const PlantModel model =
      read_plant(std::filesystem::path(FAULTLINE_EXAMPLES_DIR) / shipped.folder / "plant.toml");
  const Integration whole{.method = IntegrationMethod::kRk4, .substeps = 10};
  const Integration half{.method = IntegrationMethod::kRk4, .substeps = 20};
  const Integration controlled{.method = IntegrationMethod::kDormandPrince,
                               .absolute_tolerance = 1e-11,
                               .relative_tolerance = 1e-11};
  const auto by_whole = course(shipped, model, whole);
  const auto by_half = course(shipped, model, half);
  const auto by_control = course(shipped, model, controlled);
  const VectorXd step_error = distance(by_whole, by_half);
  const VectorXd difference = distance(by_half, by_control);
  for (Eigen::Index i = 0; i < step_error.size(); ++i) {
    double moved = 0.0;
    for (const VectorXd& x : by_control) {
      moved = std::max(moved, std::abs(x[i] - model.x_operating[i]));
    }
    EXPECT_GT(moved, 0.0) << model.state_names[static_cast<std::size_t>(i)];
    EXPECT_LE(difference[i], step_error[i] + 1e-7 * moved)
        << model.state_names[static_cast<std::size_t>(i)] << " moved by " << moved;
    EXPECT_LE(difference[i], 1e-4 * moved) << model.state_names[static_cast<std::size_t>(i)];
  }
}

INSTANTIATE_TEST_SUITE_P(
    Shipped, IntegrationMethods,
    testing::Values(ShippedPlant{"ThreeTank", "three_tank", by_equations<ThreeTank>(), 0.1},
                    ShippedPlant{"AzimuthVessel", "azimuth_vessel", by_equations<AzimuthVessel>(),
                                 0.1},
                    ShippedPlant{"ElectricCar", "electric_car", by_equations<ElectricCar>(), 0.01},
                    ShippedPlant{"FlexibleJoint", "ma2024", by_file, 0.01}),
    [](const auto& shipped) { return shipped.param.name; });

}  // namespace
}  // namespace faultline
