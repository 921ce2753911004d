// The plant files of the examples are what their equations are near the operating point: against
// differences of the equations themselves.
#include <cmath>
#include <filesystem>
#include <functional>
#include <vector>

#include <gtest/gtest.h>

#include "diagnosis/model/plant_file.h"
#include "sim/plants/azimuth_vessel.h"
#include "sim/plants/electric_car.h"
#include "sim/plants/three_tank.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::VectorXd;

// Of a derivative, relative to the largest one of its column: |v| v of the vessel's drag has no
// second derivative at rest, and leaves an error of the order of the step.
constexpr double kTolerance = 1e-5;
constexpr double kStep = 1e-6;

// A plant's table, and where it is.
struct Point {
  const faultline_plant_table& table;
  VectorXd x, u, p, d;

  [[nodiscard]] VectorXd rate() const {
    VectorXd dx(x.size());
    table.derivative(x.data(), u.data(), p.data(), d.data(), dx.data());
    return dx;
  }
  [[nodiscard]] VectorXd output() const {
    VectorXd y(static_cast<Index>(table.output_count));
    table.measure(x.data(), u.data(), p.data(), d.data(), y.data());
    return y;
  }
};

Point operating_point(const faultline_plant_table& table, const PlantModel& model) {
  VectorXd p(static_cast<Index>(table.parameter_count));
  for (Index i = 0; i < p.size(); ++i) p[i] = table.parameters[i].nominal;
  return {table, model.x_operating, model.u_operating, p,
          VectorXd::Zero(static_cast<Index>(table.disturbance_count))};
}

// dg/dv[i] by central differences over kStep of `size`.
VectorXd slope(const std::function<VectorXd()>& g, VectorXd& v, Index i, double size) {
  const double at = v[i];
  const double h = kStep * size;
  v[i] = at + h;
  const VectorXd ahead = g();
  v[i] = at - h;
  const VectorXd behind = g();
  v[i] = at;
  return (ahead - behind) / (2.0 * h);
}

void expect_column(const VectorXd& expected, const VectorXd& found, const std::string& what) {
  const double scale = expected.size() == 0 ? 0.0 : expected.cwiseAbs().maxCoeff();
  ASSERT_EQ(expected.size(), found.size()) << what;
  EXPECT_LE((expected - found).cwiseAbs().maxCoeff(), kTolerance * scale + 1e-9)
      << what << "\nexpected " << expected.transpose() << "\nfound    " << found.transpose();
}

class PlantFile : public testing::TestWithParam<const faultline_plant_table*> {
 protected:
  const faultline_plant_table& table_ = *GetParam();
  PlantModel model_ =
      read_plant(std::filesystem::path(FAULTLINE_EXAMPLES_DIR) / table_.name / "plant.toml");
  Point point_ = operating_point(table_, model_);

  // Columns of `state` and `output` that v[i] acts through.
  void expect_slopes(VectorXd& v, Index i, double size, const VectorXd& state,
                     const VectorXd& output, const std::string& what) {
    expect_column(slope([&] { return point_.rate(); }, v, i, size), state, what + " on states");
    expect_column(slope([&] { return point_.output(); }, v, i, size), output, what + " on outputs");
  }
};

TEST_P(PlantFile, StandsStillAtItsOperatingPoint) {
  const VectorXd rate = point_.rate();
  for (Index i = 0; i < rate.size(); ++i) {
    EXPECT_NEAR(rate[i], 0.0, 1e-9 * table_.states[i].size) << table_.states[i].name;
  }
  expect_column(point_.output(), model_.y_operating, "y");
}

TEST_P(PlantFile, HasTheDerivativesOfTheEquations) {
  for (Index i = 0; i < model_.n(); ++i) {
    const PlantSignal& state = table_.states[i];
    expect_slopes(point_.x, i, state.size, model_.A.col(i), model_.C.col(i), state.name);
  }
  for (Index i = 0; i < model_.m(); ++i) {
    const PlantSignal& input = table_.inputs[i];
    expect_slopes(point_.u, i, input.size, model_.B.col(i), model_.D.col(i), input.name);
  }
}

TEST_P(PlantFile, HasAFaultForEachParameterWithASize) {
  std::vector<const Fault*> faults;
  for (const Fault& fault : model_.faults) {
    if (fault.kind == FaultKind::kComponent) faults.push_back(&fault);
  }
  std::size_t found = 0;
  for (std::size_t i = 0; i < table_.parameter_count; ++i) {
    const PlantSignal& parameter = table_.parameters[i];
    if (parameter.size == 0.0) continue;
    ASSERT_LT(found, faults.size());
    const Fault& fault = *faults[found++];
    EXPECT_EQ(fault.name, parameter.name);
    EXPECT_EQ(fault.size, parameter.size);
    expect_slopes(point_.p, static_cast<Index>(i), parameter.size, fault.state, fault.output,
                  parameter.name);
  }
  EXPECT_EQ(found, faults.size());
}

// What acts on outputs alone is noise.
TEST_P(PlantFile, HasEachDisturbanceAndNoiseWithItsBound) {
  ASSERT_EQ(model_.disturbances.size() + model_.noises.size(), table_.disturbance_count);
  std::size_t disturbances = 0;
  for (std::size_t i = 0; i < table_.disturbance_count; ++i) {
    const PlantSignal& signal = table_.disturbances[i];
    Disturbance found;
    if (disturbances < model_.disturbances.size() &&
        model_.disturbances[disturbances].name == signal.name) {
      found = model_.disturbances[disturbances++];
      EXPECT_FALSE(found.state.isZero(0.0)) << signal.name;
    } else {
      ASSERT_LT(i - disturbances, model_.noises.size()) << signal.name;
      const Noise& noise = model_.noises[i - disturbances];
      found = {noise.name, VectorXd::Zero(model_.n()), noise.output, noise.bound};
    }
    EXPECT_EQ(found.name, signal.name);
    EXPECT_EQ(found.bound, signal.size);
    expect_slopes(point_.d, static_cast<Index>(i), signal.size, found.state, found.output,
                  found.name);
  }
}

INSTANTIATE_TEST_SUITE_P(Examples, PlantFile,
                         testing::Values(&plant_table<ThreeTank>(), &plant_table<AzimuthVessel>(),
                                         &plant_table<ElectricCar>()),
                         [](const auto& table) { return std::string(table.param->name); });

}  // namespace
}  // namespace faultline
