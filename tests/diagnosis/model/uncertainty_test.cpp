#include "diagnosis/model/uncertainty.h"

#include <cmath>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "diagnosis/model/input_error.h"
#include "diagnosis/model/plant_file.h"
#include "diagnosis/model/plant_text.h"

namespace faultline {
namespace {

using Eigen::MatrixXd;
using ::testing::HasSubstr;
using ::testing::StartsWith;

std::string plant_with(const std::string& uncertainty,
                       const std::string& range = "range = [2, 4]\n") {
  return "schema = 1\nname = \"p\"\ntime = \"continuous\"\n"
         "[states]\nnames = [\"x1\", \"x2\"]\n" +
         range +
         "[inputs]\nnames = [\"u1\"]\nrange = [10]\n"
         "[outputs]\nnames = [\"y1\", \"y2\"]\n"
         "[dynamics]\nA = [[-1, 0], [1, -2]]\nB = [[1], [0]]\nC = [[1, 0], [0, 1]]\n"
         "[faults]\nactuators = \"all\"\nsensors = \"all\"\n"
         "[[disturbance]]\nname = \"d1\"\nstate = [1, 1]\n" +
         uncertainty;
}

constexpr char kFriction[] =
    "[[uncertainty]]\nname = \"friction\"\nA = [[0, 0], [0, -1]]\nrange = 0.5\n";
constexpr char kPoints[] =
    "[[uncertainty]]\nname = \"speed\"\n"
    "[[uncertainty.plant]]\nA = [[-1, 0.5], [1, -2]]\n"
    "[[uncertainty.plant]]\nA = [[-1, 0], [1, -3]]\nB = [[1.25], [0]]\n";

std::string refusal(const std::string& uncertainty) {
  try {
    static_cast<void>(parse_plant(plant_with(uncertainty), "plant.toml"));
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

TEST(Uncertainty, OfAParameterIsOneUnknownInput) {
  const PlantModel plant = parse_plant(plant_with(kFriction), "plant.toml");
  ASSERT_EQ(plant.uncertainties.size(), 1u);
  EXPECT_TRUE(plant.uncertainties[0].is_parameter);
  EXPECT_EQ(plant.uncertainties[0].delta_A[0](1, 1), -0.5);  // at the end of the range
  ASSERT_EQ(plant.disturbances.size(), 2u);
  const Disturbance& friction = plant.disturbances[1];
  EXPECT_EQ(friction.name, "friction");
  EXPECT_EQ(friction.uncertainty, "friction");
  EXPECT_EQ(friction.state, Eigen::Vector2d(0, 1));
  EXPECT_TRUE(friction.output.isZero(0.0));
  EXPECT_DOUBLE_EQ(*friction.bound, 0.5 * 4.0);
  EXPECT_EQ(plant.disturbances[0].uncertainty, "");
}

TEST(Uncertainty, OfOtherPlantsIsTheImageOfAllTheirDifferences) {
  const PlantModel plant = parse_plant(plant_with(kPoints), "plant.toml");
  const Uncertainty& speed = plant.uncertainties.at(0);
  EXPECT_FALSE(speed.is_parameter);
  ASSERT_EQ(speed.delta_A.size(), 2u);
  EXPECT_TRUE(speed.delta_B[0].isZero(0.0));
  EXPECT_EQ(speed.delta_B[1](0, 0), 0.25);
  ASSERT_EQ(plant.disturbances.size(), 3u);
  EXPECT_EQ(plant.disturbances[1].name, "speed.1");
  EXPECT_EQ(plant.disturbances[2].name, "speed.2");
  // Whatever mix of the plants, x and u: the difference is U d with |d| within the bounds.
  MatrixXd U(2, 2);
  U << plant.disturbances[1].state, plant.disturbances[2].state;
  EXPECT_LT((U.transpose() * U - MatrixXd::Identity(2, 2)).norm(), 1e-14);
  for (const double share : {0.0, 0.3, 1.0}) {
    for (const double sign : {-1.0, 1.0}) {
      const Eigen::Vector2d x(2.0, sign * 4.0);
      const Eigen::VectorXd u = Eigen::VectorXd::Constant(1, 10.0);
      const Eigen::VectorXd difference =
          share * (speed.delta_A[0] * x + speed.delta_B[0] * u) +
          (1.0 - share) * (speed.delta_A[1] * x + speed.delta_B[1] * u);
      const Eigen::VectorXd d = U.transpose() * difference;
      EXPECT_LT((U * d - difference).norm(), 1e-13);
      EXPECT_LE(std::abs(d[0]), *plant.disturbances[1].bound * (1.0 + 1e-14));
      EXPECT_LE(std::abs(d[1]), *plant.disturbances[2].bound * (1.0 + 1e-14));
    }
  }
}

TEST(Uncertainty, HasNoBoundWhereStatesHaveNoRange) {
  const PlantModel plant = parse_plant(plant_with(kFriction, ""), "plant.toml");
  EXPECT_FALSE(plant.disturbances[1].bound);
}

TEST(Uncertainty, MakesThePlantThatIsSimulated) {
  PlantModel plant = parse_plant(plant_with(kPoints), "plant.toml");
  const Uncertainty speed = plant.uncertainties[0];
  apply_uncertainty(speed, {0.5, 0.25}, plant);
  EXPECT_DOUBLE_EQ(plant.A(0, 1), 0.25);
  EXPECT_DOUBLE_EQ(plant.A(1, 1), -2.25);
  EXPECT_DOUBLE_EQ(plant.B(0, 0), 1.0625);
  ASSERT_EQ(plant.faults[0].kind, FaultKind::kActuator);
  EXPECT_EQ(plant.faults[0].state, plant.B.col(0));
}

TEST(Uncertainty, SurvivesThePlantsText) {
  for (const char* const uncertainty : {kFriction, kPoints}) {
    const PlantModel plant = parse_plant(plant_with(uncertainty), "plant.toml");
    const PlantModel again = parse_plant(plant_text(plant, {}), "again.toml");
    EXPECT_EQ(plant_digest(again), plant_digest(plant));
    ASSERT_EQ(again.disturbances.size(), plant.disturbances.size());
    EXPECT_EQ(again.disturbances.back().state, plant.disturbances.back().state);
  }
}

TEST(Uncertainty, IsPartOfTheDigest) {
  const PlantModel plant = parse_plant(plant_with(kFriction), "plant.toml");
  PlantModel other = plant;
  other.uncertainties[0].delta_A[0] *= 2.0;
  EXPECT_NE(plant_digest(other), plant_digest(plant));
}

TEST(Uncertainty, RefusesWhatIsNone) {
  const std::string head = "[[uncertainty]]\nname = \"friction\"\n";
  EXPECT_THAT(refusal(head + "range = 1\n"), HasSubstr("found neither, expected `A` or `B`"));
  EXPECT_THAT(refusal(head + "A = [[0, 0], [0, 0]]\nrange = 1\n"),
              HasSubstr("found no entry of A or B that it changes"));
  EXPECT_THAT(
      refusal(head + "A = [[0, 0], [0, 1]]\nrange = 0\n"),
      StartsWith("plant.toml:25:9: uncertainty, entry 1.range: found 0, expected a positive"));
  EXPECT_THAT(refusal(head + "A = [[0, 0]]\nrange = 1\n"), HasSubstr("A"));
  EXPECT_THAT(refusal(head + "A = [[0, 0], [0, nan]]\nrange = 1\n"), HasSubstr("nan"));
  EXPECT_THAT(refusal(head + "A = [[0, 0], [0, 1]]\n"), HasSubstr("range"));
  EXPECT_THAT(refusal(std::string(kFriction) + kFriction),
              HasSubstr("found \"friction\", expected a name that nothing else in the plant has"));
  for (const char* const taken : {"x1", "u1", "y1", "d1", "all"}) {
    EXPECT_THAT(refusal(std::string("[[uncertainty]]\nname = \"") + taken +
                        "\"\nA = [[0, 0], [0, 1]]\nrange = 1\n"),
                HasSubstr("expected a name that nothing else"));
  }
  EXPECT_THAT(refusal(head + "A = [[0, 0], [0, 1]]\n[[uncertainty.plant]]\nA = [[1, 0], [0, 1]]\n"),
              HasSubstr("found it beside [[uncertainty.plant]]"));
  EXPECT_THAT(refusal(head + "[[uncertainty.plant]]\nA = [[-1, 0], [1, -2]]\n"),
              HasSubstr("found no entry of A or B that it changes"));
}

}  // namespace
}  // namespace faultline
