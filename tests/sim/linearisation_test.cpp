#include "sim/linearisation.h"

#include <cmath>
#include <filesystem>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "diagnosis/model/plant_file.h"
#include "diagnosis/model/plant_text.h"
#include "sim/plants/catalogue.h"
#include "sim/plants/three_tank.h"

namespace faultline {
namespace {

using ::testing::HasSubstr;

PlantModel example(const char* file) {
  return read_plant(std::filesystem::path(FAULTLINE_EXAMPLES_DIR) / file);
}

TEST(Linearisation, OfHousPlantIsItsFileToTheBit) {
  const PlantModel found = linearise(catalogue_plant("hou2015")).model;
  const PlantModel file = example("hou2015/plant.toml");
  EXPECT_EQ(found.A, file.A);
  EXPECT_EQ(found.B, file.B);
  EXPECT_EQ(found.C, file.C);
  EXPECT_EQ(found.D, file.D);
  EXPECT_EQ(found.input_range, file.input_range);
  EXPECT_EQ(found.x_operating, file.x_operating);
}

TEST(Linearisation, OfTheFlexibleJointIsItsFileWithTheSlopeOfSin) {
  const Linearisation found = linearise(catalogue_plant("flexible_joint"));
  const PlantModel file = example("ma2024/plant.toml");
  Eigen::MatrixXd A = file.A;
  A(3, 2) += -0.333;  // sin's slope at zero is one
  EXPECT_LT((found.model.A - A).cwiseAbs().maxCoeff(), 1e-11);
  EXPECT_LT((found.model.B - file.B).cwiseAbs().maxCoeff(), 1e-12);
  EXPECT_LT((found.model.C - file.C).cwiseAbs().maxCoeff(), 1e-12);
  ASSERT_EQ(found.model.disturbances.size(), file.disturbances.size());
  for (std::size_t i = 0; i < file.disturbances.size(); ++i) {
    EXPECT_LT((found.model.disturbances[i].state - file.disturbances[i].state).norm(), 1e-12);
    EXPECT_EQ(found.model.disturbances[i].bound, file.disturbances[i].bound);
  }
  EXPECT_LT(found.largest_error, 1e-9);
}

// By hand: a pipe's flow a √(2 g Δh) has the slope a √(g / (2 Δh)).
TEST(Linearisation, OfTheThreeTankIsTheOneDerivedByHand) {
  const PlantModel model = linearise(catalogue_plant("three_tank")).model;
  const Eigen::VectorXd& h = model.x_operating;
  const auto slope = [](double az, double head_cm) {
    return az * ThreeTank::kPipeArea_cm2 * std::sqrt(ThreeTank::kGravity_cm_s2 / (2.0 * head_cm)) /
           ThreeTank::kTankArea_cm2;
  };
  const double s13 = slope(ThreeTank::kOutflow13, h[0] - h[2]);
  const double s32 = slope(ThreeTank::kOutflow32, h[2] - h[1]);
  const double s20 = slope(ThreeTank::kOutflow20, h[1]);
  Eigen::Matrix3d A;
  A << -s13, 0.0, s13, 0.0, -s32 - s20, s32, s13, s32, -s13 - s32;
  EXPECT_LT((model.A - A).cwiseAbs().maxCoeff(), 1e-10 * s13);
  EXPECT_NEAR(model.B(0, 0) * ThreeTank::kTankArea_cm2, 1.0, 1e-9);
  const auto leak = std::find_if(model.faults.begin(), model.faults.end(),
                                 [](const Fault& fault) { return fault.name == "leak2"; });
  ASSERT_NE(leak, model.faults.end());
  EXPECT_NEAR(leak->state[1],
              -0.01 * std::sqrt(2.0 * ThreeTank::kGravity_cm_s2 * h[1]) / ThreeTank::kTankArea_cm2,
              1e-9);  // a leak is in mm²
  EXPECT_EQ(model.noises.size(), 3U);
}

TEST(Linearisation, OfEveryPlantIsAtRestAndAgreesWithPlainDifferences) {
  for (const faultline_plant_table* table : plant_catalogue()) {
    const PlantModel model = linearise(*table).model;
    const std::vector<double> p = parameter_values(*table, {});
    const std::vector<double> d(table->disturbance_count, 0.0);
    const auto f = [&](const Eigen::VectorXd& x) {
      Eigen::VectorXd dx(model.n());
      table->derivative(x.data(), model.u_operating.data(), p.data(), d.data(), dx.data());
      return dx;
    };
    EXPECT_LT(f(model.x_operating).cwiseQuotient(*model.state_range).cwiseAbs().maxCoeff(), 1e-9)
        << table->name;
    for (Eigen::Index j = 0; j < model.n(); ++j) {
      const double step = 1e-5 * (*model.state_range)[j];
      Eigen::VectorXd ahead = model.x_operating;
      Eigen::VectorXd behind = model.x_operating;
      ahead[j] += step;
      behind[j] -= step;
      const Eigen::VectorXd column = (f(ahead) - f(behind)) / (2.0 * step);
      EXPECT_LT((model.A.col(j) - column).cwiseAbs().maxCoeff(),
                1e-5 * std::max(1.0, model.A.cwiseAbs().maxCoeff()))
          << table->name << " " << model.state_names[static_cast<std::size_t>(j)];
    }
  }
}

TEST(Linearisation, IsWrittenAndReadBackToTheBit) {
  for (const faultline_plant_table* table : plant_catalogue()) {
    const PlantModel model = linearise(*table).model;
    const PlantModel back = parse_plant(plant_text(model, {"head"}), "text");
    EXPECT_EQ(plant_digest(back), plant_digest(model)) << table->name;
    EXPECT_EQ(plant_text(back), plant_text(model)) << table->name;
    EXPECT_EQ(back.A, model.A);
    EXPECT_EQ(back.x_operating, model.x_operating);
    EXPECT_EQ(back.state_units, model.state_units);
  }
  const PlantModel file = example("ma2024/plant.toml");
  EXPECT_EQ(plant_digest(parse_plant(plant_text(file), "text")), plant_digest(file));
}

TEST(Linearisation, HoldsWhatItIsToldTo) {
  const PlantModel model =
      linearise(catalogue_plant("three_tank"), {.parameters = {}, .hold = {{"h1", 45.0}}}).model;
  EXPECT_EQ(model.x_operating[0], 45.0);
  EXPECT_GT(model.u_operating[0], 35.0);
}

TEST(Linearisation, SaysWhatItCannotDo) {
  const auto refusal = [](const LinearisationOptions& options) -> std::string {
    try {
      static_cast<void>(linearise(catalogue_plant("three_tank"), options));
    } catch (const std::exception& error) {
      return error.what();
    }
    return "";
  };
  EXPECT_THAT(refusal({.parameters = {{"leek1", 0.0}}, .hold = {}}),
              HasSubstr("did you mean \"leak1\""));
  EXPECT_THAT(refusal({.parameters = {}, .hold = {{"pump3", 0.0}}}),
              HasSubstr("did you mean \"pump"));
  EXPECT_THAT(
      refusal({.parameters = {},
               .hold = {{"h1", 0.4}, {"h2", 0.4}, {"h3", 0.2}, {"pump1", 0}, {"pump2", 0}}}),
      HasSubstr("found no equilibrium near the nominal point: what is left moves h1 ("));
}

}  // namespace
}  // namespace faultline
