#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <gtest/gtest.h>

#include "sim/equation_plant.h"
#include "sim/linearisation.h"
#include "sim/plants/catalogue.h"

namespace faultline {
namespace {

using enum IntegrationMethod;

struct Excited {
  const char* plant;
  double sample_time_s;  // of RK4's coarsest step too
  double swing;          // of every input, in its size
};

constexpr double kDuration_s = 20.0;

// States in their sizes, sample by sample, under inputs that swing about the operating point, each
// at a frequency of its own.
std::vector<Eigen::VectorXd> course(const Excited& excited, const Integration& integration) {
  const faultline_plant_table& table = catalogue_plant(excited.plant);
  EquationPlant plant(table, linearise(table).model, excited.sample_time_s, integration);
  const auto states = static_cast<Eigen::Index>(table.state_count);
  Eigen::VectorXd size(states);
  for (Eigen::Index i = 0; i < states; ++i) size[i] = table.states[i].size;
  EXPECT_GT(size.minCoeff(), 0.0) << excited.plant;
  std::vector<double> u(table.input_count);
  const std::vector<double> none(table.parameter_count, 0.0);
  std::vector<Eigen::VectorXd> found;
  const auto samples = std::lround(kDuration_s / excited.sample_time_s);
  for (long k = 0; k < samples; ++k) {
    const double t_s = static_cast<double>(k) * excited.sample_time_s;
    for (std::size_t i = 0; i < u.size(); ++i) {
      const double phase = (0.5 + 0.3 * static_cast<double>(i)) * t_s;
      u[i] = table.inputs[i].nominal + excited.swing * table.inputs[i].size * std::sin(phase);
    }
    plant.step({u, none, {}});
    found.emplace_back(plant.state().cwiseQuotient(size));
  }
  EXPECT_TRUE(plant.is_finite()) << excited.plant << ": " << plant.failure();
  return found;
}

double largest_difference(const std::vector<Eigen::VectorXd>& a,
                          const std::vector<Eigen::VectorXd>& b) {
  double largest = 0.0;
  for (std::size_t k = 0; k < a.size(); ++k) {
    largest = std::max(largest, (a[k] - b[k]).cwiseAbs().maxCoeff());
  }
  return largest;
}

class IntegratorsAgree : public ::testing::TestWithParam<Excited> {};

// Where a finer method at least halves the error e of a coarser one, and differs from it by δ,
// e <= δ + e / 2: so e <= 2 δ. That holds for RK4 with half the step (e / 16, or e / 2 where a
// kink of the equations falls into the step) and for Dormand-Prince with a hundredth of the
// tolerance. Two methods of one plant then differ by the sum of both bounds at most.
TEST_P(IntegratorsAgree, WithinTheErrorsThatRefiningThemShows) {
  const auto rk4 = [&](int substeps) {
    return course(GetParam(), {.method = kRk4, .substeps = substeps});
  };
  const auto dormand_prince = [&](double tolerance) {
    return course(GetParam(), {.method = kDormandPrince,
                               .absolute_tolerance = tolerance,
                               .relative_tolerance = tolerance});
  };
  const auto coarse = rk4(1);
  const auto fine = rk4(10);
  const auto controlled = dormand_prince(1e-9);
  const double coarse_bound = 2.0 * largest_difference(coarse, rk4(2));
  const double fine_bound = 2.0 * largest_difference(fine, rk4(20));
  const double controlled_bound = 2.0 * largest_difference(controlled, dormand_prince(1e-11));
  constexpr double kRounding = 1e-12;  // 20 s of a few 1000 steps, each off by 1e-16

  EXPECT_LE(largest_difference(coarse, controlled), coarse_bound + controlled_bound + kRounding);
  EXPECT_LE(largest_difference(fine, controlled), fine_bound + controlled_bound + kRounding);
  EXPECT_LT(coarse_bound, 1e-2) << "a bound that bounds nothing";
  EXPECT_LT(fine_bound, 1e-5);
  EXPECT_LT(controlled_bound, 1e-5);
  const auto record = [](const char* name, double value) {
    RecordProperty(name, fmt::format("{:.2e}", value));
  };
  record("rk4_1_step", largest_difference(coarse, controlled));
  record("rk4_1_step_bound", coarse_bound);
  record("rk4_10_steps", largest_difference(fine, controlled));
  record("rk4_10_steps_bound", fine_bound);
  record("dormand_prince_bound", controlled_bound);

  double moved = 0.0;
  for (const Eigen::VectorXd& x : controlled) {
    moved = std::max(moved, (x - controlled.front()).cwiseAbs().maxCoeff());
  }
  EXPECT_GT(moved, 0.05) << "it must have moved";
}

INSTANTIATE_TEST_SUITE_P(Plants, IntegratorsAgree,
                         ::testing::Values(Excited{"three_tank", 1.0, 1.0},
                                           Excited{"azimuth_vessel", 0.1, 0.5},
                                           Excited{"electric_car", 0.005, 0.2},
                                           Excited{"flexible_joint", 0.02, 0.5}),
                         [](const auto& instance) { return std::string(instance.param.plant); });

}  // namespace
}  // namespace faultline
