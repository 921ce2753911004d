#include "diagnosis/model/nonlinearity_file.h"

#include <filesystem>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "diagnosis/model/input_error.h"
#include "diagnosis/model/plant_file.h"

namespace faultline {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::StartsWith;

constexpr char kDirections[] = "E_o = [0, 1]\nE_i = [1, 0]\n";

std::vector<Nonlinearity> read(const std::string& text) {
  TomlTable root = TomlTable::parse(text, "p.toml");
  std::vector<Nonlinearity> nonlinearities = read_nonlinearities(root, 2);
  root.finish();
  return nonlinearities;
}

Nonlinearity one(const std::string& rest) {
  return read("[[nonlinearity]]\n" + rest + kDirections).at(0);
}

std::string refusal(const std::string& rest) {
  try {
    static_cast<void>(one(rest));
  } catch (const InputError& error) {
    return error.what();
  }
  return "accepted";
}

std::string refusal_of_directions(const std::string& directions) {
  try {
    static_cast<void>(read("[[nonlinearity]]\nfunction = \"sin\"\n" + directions));
  } catch (const InputError& error) {
    return error.what();
  }
  return "accepted";
}

constexpr char kCubic[] =
    "function = \"polynomial\"\ncoefficients = [0, 1, 0, 2]\ndomain = [-1, 2]\n";

TEST(NonlinearityFile, ReadsEveryKindOfFunction) {
  EXPECT_EQ(one("function = \"sin\"\n").function.kind, FunctionKind::kSin);
  EXPECT_EQ(one("function = \"cos\"\n").function.kind, FunctionKind::kCos);
  EXPECT_EQ(one("function = \"tanh\"\n").function.kind, FunctionKind::kTanh);
  EXPECT_EQ(one("function = \"atan\"\n").function.kind, FunctionKind::kAtan);
  EXPECT_EQ(one("function = \"dead_zone\"\nwidth = 0.5\n").function.width, 0.5);
  EXPECT_EQ(one("function = \"saturation\"\nwidth = 2\n").function.width, 2.0);
  const Nonlinearity cubic = one(kCubic);
  EXPECT_THAT(cubic.function.coefficients, ElementsAre(0.0, 1.0, 0.0, 2.0));
  EXPECT_EQ(cubic.function.domain_max, 2.0);
  EXPECT_EQ(cubic.slope_min, 1.0);
  EXPECT_EQ(cubic.slope_max, 25.0);
  const Nonlinearity points = one("function = \"table\"\nat = [0, 1]\nvalue = [3, -1]\ngain = 2\n");
  EXPECT_THAT(points.function.at, ElementsAre(0.0, 1.0));
  EXPECT_THAT(points.function.value, ElementsAre(3.0, -1.0));
  EXPECT_EQ(points.gain, 2.0);
  EXPECT_EQ(points.slope_min, -4.0);
  EXPECT_EQ(points.E_o, Eigen::Vector2d::UnitY());
  EXPECT_EQ(points.E_i, Eigen::Vector2d::UnitX());
}

TEST(NonlinearityFile, TakesWiderBoundsOfTheSlopeAndRefusesNarrowerOnes) {
  const Nonlinearity wide = one("function = \"tanh\"\nslope = [-0.5, 2]\n");
  EXPECT_EQ(wide.slope_min, -0.5);
  EXPECT_EQ(wide.slope_max, 2.0);
  EXPECT_EQ(refusal("function = \"tanh\"\nslope = [0.1, 1]\n"),
            "p.toml:3:9: nonlinearity, entry 1.slope: found [0.1, 1], expected bounds of the "
            "slopes of \"tanh\", which are 0 to 1; without `slope` these are taken");
  EXPECT_THAT(refusal("function = \"sin\"\nslope = [-1, 0.9]\n"), StartsWith("p.toml:3:9: "));
  EXPECT_THAT(refusal(std::string(kCubic) + "slope = [1, 24]\n"), HasSubstr("which are 1 to 25"));
  EXPECT_THAT(refusal("function = \"sin\"\nslope = [1, -1]\n"), StartsWith("p.toml:3:9: "));
  EXPECT_THAT(refusal("function = \"sin\"\nslope = [-1, 0, 1]\n"), StartsWith("p.toml:3:9: "));
}

TEST(NonlinearityFile, TakesTheWiderWhereDecimalsMissABoundByTheirRounding) {
  // 3·0.1² = 0.03 in decimals; of the doubles nearest to them the slope is another one.
  const std::string cubic =
      "function = \"polynomial\"\ncoefficients = [0, 0, 0, 1]\ndomain = [-0.1, 0.1]\n";
  const double own = one(cubic).slope_max;
  ASSERT_GT(own, 0.03);
  const Nonlinearity read_bounds = one(cubic + "slope = [0, 0.03]\n");
  EXPECT_EQ(read_bounds.slope_max, own);
  EXPECT_NE(refusal(cubic + "slope = [0, 0.0299999999]\n"), "accepted");
}

TEST(NonlinearityFile, RefusesAFunctionThatItDoesNotKnow) {
  EXPECT_THAT(refusal("function = \"sign\"\n"),
              StartsWith("p.toml:2:12: nonlinearity, entry 1.function: found \"sign\", expected "
                         "one of \"sin\""));
  EXPECT_THAT(refusal("gain = 1\n"), HasSubstr("function: found nothing"));
  EXPECT_THAT(refusal("function = \"sin\"\nwidth = 1\n"), HasSubstr("unknown key \"width\""));
  EXPECT_THAT(refusal(std::string(kCubic) + "at = [0, 1]\n"), HasSubstr("unknown key \"at\""));
}

TEST(NonlinearityFile, RefusesAWidthThatIsNone) {
  EXPECT_THAT(refusal("function = \"dead_zone\"\n"), HasSubstr("width: found nothing"));
  EXPECT_EQ(refusal("function = \"dead_zone\"\nwidth = 0\n"),
            "p.toml:3:9: nonlinearity, entry 1.width: found 0, expected a positive number");
  EXPECT_THAT(refusal("function = \"saturation\"\nwidth = -1\n"), StartsWith("p.toml:3:9: "));
  EXPECT_THAT(refusal("function = \"saturation\"\nwidth = inf\n"), StartsWith("p.toml:3:9: "));
}

TEST(NonlinearityFile, RefusesAPolynomialThatIsNone) {
  const auto with = [](const std::string& coefficients, const std::string& domain) {
    return refusal("function = \"polynomial\"\ncoefficients = " + coefficients +
                   "\ndomain = " + domain + "\n");
  };
  EXPECT_EQ(with("[]", "[0, 1]"),
            "p.toml:3:16: nonlinearity, entry 1.coefficients: found 0 numbers, expected at least "
            "1");
  std::string many = "[1";
  for (int i = 1; i < 33; ++i) many += ", 1";
  EXPECT_THAT(with(many + "]", "[0, 1]"), HasSubstr("found 33 numbers, expected at most 32"));
  EXPECT_THAT(with("[1, nan]", "[0, 1]"), StartsWith("p.toml:3:"));
  EXPECT_EQ(with("[1, 2]", "[1, 1]"),
            "p.toml:4:10: nonlinearity, entry 1.domain: found [1, 1], expected [smallest, "
            "largest]");
  EXPECT_THAT(with("[1, 2]", "[2, 1]"), StartsWith("p.toml:4:10: "));
  EXPECT_THAT(with("[1, 2]", "[1]"), StartsWith("p.toml:4:10: "));
  EXPECT_THAT(refusal("function = \"polynomial\"\ncoefficients = [1]\n"),
              HasSubstr("domain: found nothing"));
}

TEST(NonlinearityFile, RefusesFunctionsWithoutFiniteSlopesOrValues) {
  EXPECT_THAT(refusal("function = \"polynomial\"\ncoefficients = [0, 0, 1e200]\n"
                      "domain = [0, 1e200]\n"),
              HasSubstr("coefficients: found a polynomial that is beyond all numbers at 1e+200"));
  EXPECT_THAT(refusal("function = \"table\"\nat = [0, 1e-320]\nvalue = [0, 1]\n"),
              HasSubstr("function: found a \"table\" with slopes from 0 to inf, expected finite"));
  EXPECT_THAT(refusal("function = \"table\"\nat = [-1e308, 1e308]\nvalue = [0, 1]\n"),
              HasSubstr("at: found -1e+308 and 1e+308, expected numbers whose difference is one"));
  EXPECT_THAT(refusal("function = \"table\"\nat = [0, 1, 2]\nvalue = [1e308, 0, -1e308]\n"),
              HasSubstr("value: found -1e+308 and 1e+308"));
}

TEST(NonlinearityFile, RefusesATableThatIsNone) {
  const auto with = [](const std::string& at, const std::string& value) {
    return refusal("function = \"table\"\nat = " + at + "\nvalue = " + value + "\n");
  };
  EXPECT_EQ(with("[0, 2, 2]", "[0, 1, 2]"),
            "p.toml:3:6: nonlinearity, entry 1.at: found 2 behind 2, expected increasing numbers");
  EXPECT_THAT(with("[0, 2, 1]", "[0, 1, 2]"), HasSubstr("found 1 behind 2"));
  EXPECT_THAT(with("[0]", "[0]"), HasSubstr("found 1 numbers, expected at least 2"));
  EXPECT_EQ(with("[0, 1, 2]", "[0, 1]"),
            "p.toml:4:9: nonlinearity, entry 1.value: found 2 numbers, expected 3, one per number "
            "of `at`");
  EXPECT_THAT(with("[0, inf]", "[0, 1]"), StartsWith("p.toml:3:"));
}

TEST(NonlinearityFile, RefusesWhatHasNoEffect) {
  EXPECT_EQ(refusal("function = \"sin\"\ngain = 0\n"),
            "p.toml:3:8: nonlinearity, entry 1.gain: found 0, expected a nonzero factor");
  EXPECT_EQ(refusal_of_directions("E_o = [0, 0]\nE_i = [1, 0]\n"),
            "p.toml:3:7: nonlinearity, entry 1.E_o: found zeros only, expected a nonzero "
            "direction");
  EXPECT_THAT(refusal_of_directions("E_o = [1, 0]\nE_i = [0, 0]\n"), StartsWith("p.toml:4:7: "));
  EXPECT_THAT(refusal_of_directions("E_o = [1, 0, 0]\nE_i = [1, 0]\n"), StartsWith("p.toml:3:7: "));
  EXPECT_THAT(refusal_of_directions("E_o = [1, nan]\nE_i = [1, 0]\n"), StartsWith("p.toml:3:"));
  EXPECT_THAT(refusal_of_directions("E_o = [1, 0]\n"), HasSubstr("E_i: found nothing"));
}

TEST(NonlinearityFile, RefusesMoreThanEight) {
  const std::string entry = "[[nonlinearity]]\nfunction = \"sin\"\n" + std::string(kDirections);
  std::string text;
  for (int i = 0; i < 8; ++i) text += entry;
  EXPECT_EQ(read(text).size(), 8U);
  try {
    static_cast<void>(read(text + entry));
    FAIL() << "expected a refusal";
  } catch (const InputError& error) {
    EXPECT_STREQ(error.what(),
                 "p.toml:33:1: nonlinearity, entry 9: found one more, expected at most 8: designs "
                 "and proofs go through all 2^8 combinations of their slopes");
  }
}

TEST(NonlinearityFile, OfTheRobotIsGravityInBothOfItsPlants) {
  const std::filesystem::path folder = std::filesystem::path(FAULTLINE_EXAMPLES_DIR) / "ma2024";
  for (const char* file : {"plant.toml", "plant_euler.toml"}) {
    const PlantModel plant = read_plant(folder / file);
    ASSERT_EQ(plant.nonlinearities.size(), 1U);
    EXPECT_EQ(plant.nonlinearities[0].function.kind, FunctionKind::kSin);
    EXPECT_EQ(plant.nonlinearities[0].slope_min, -1.0);
    EXPECT_EQ(plant.nonlinearities[0].slope_max, 1.0);
    ASSERT_TRUE(plant.state_range);
    EXPECT_EQ((*plant.state_range)[1], 20.0);
    ASSERT_EQ(plant.noises.size(), 1U);
    EXPECT_EQ(plant.noises[0].name, "noise1");
  }
}

}  // namespace
}  // namespace faultline
