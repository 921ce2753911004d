#include "diagnosis/design/recorded_unknown_inputs.h"

#include <cmath>
#include <optional>
#include <string>

#include <Eigen/QR>
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "diagnosis/model/discretize.h"
#include "tests/support/random_plant.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using ::testing::HasSubstr;

constexpr double kSampleTime_s = 0.01;

// A stable plant of three states with two outputs; noise of sigma 0.001.
PlantModel plant_of(std::uint64_t seed) {
  BenchPlantRecipe recipe;
  recipe.n = 3;
  recipe.m = 1;
  recipe.q = 2;
  recipe.seed = seed;
  PlantModel plant = random_bench_plant(recipe);
  for (Index i = 0; i < 2; ++i) {
    plant.noises.push_back({fmt::format("v{}", i), VectorXd::Unit(2, i), std::nullopt, 0.001});
  }
  return plant;
}

// White d through E, white noise, an input that moves.
RecordedStretch record(const PlantModel& plant, const MatrixXd& E, Index samples,
                       std::uint64_t seed) {
  RandomNumbers random(seed);
  MatrixXd inputs(3, 1 + E.cols());
  inputs << plant.B, E;
  const SampledSystem system = discretize_zoh(plant.A, inputs, kSampleTime_s);
  RecordedStretch stretch{MatrixXd(2, samples), MatrixXd(1, samples)};
  VectorXd x = VectorXd::Zero(3);
  for (Index k = 0; k < samples; ++k) {
    stretch.u(0, k) = std::sin(0.05 * static_cast<double>(k));
    stretch.y.col(k) = plant.C * x + 0.001 * random.normal(2, 1);
    VectorXd drive(inputs.cols());
    drive << stretch.u(0, k), random.normal(E.cols(), 1).col(0);
    x = system.A * x + system.B * drive;
  }
  return stretch;
}

double angle_deg(const VectorXd& a, const VectorXd& b) {
  return std::acos(std::min(1.0, std::abs(a.normalized().dot(b.normalized())))) * 180.0 / M_PI;
}

TEST(RecordedUnknownInputs, FindsTheDirectionThatActed) {
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    SCOPED_TRACE(fmt::format("seed {}", seed));
    const PlantModel plant = plant_of(seed);
    const MatrixXd E = RandomNumbers(seed + 100).normal(3, 1);
    const auto found =
        find_unknown_inputs(plant, kSampleTime_s, {record(plant, E, 60000, seed)}, std::nullopt);
    EXPECT_GT(found.innovation_before, 2.0);
    EXPECT_NEAR(found.innovation_after, 1.0, 0.15);
    ASSERT_EQ(found.rank, 1) << testing::PrintToString(found.likelihood_gains);
    EXPECT_LT(angle_deg(found.directions.col(0), E.col(0)), 5.0);
    EXPECT_NEAR(found.directions.col(0).norm(), 1.0, 1e-12);
    EXPECT_LT(found.halves_deg, 20.0);
    EXPECT_GT(found.largest[0], E.norm());  // d is normal: some exceed three sigma
    EXPECT_LT(found.largest[0], 8.0 * E.norm());
  }
}

TEST(RecordedUnknownInputs, FindsNoneWhereTheFileExplainsTheRecord) {
  const PlantModel plant = plant_of(1);
  const auto found = find_unknown_inputs(plant, kSampleTime_s,
                                         {record(plant, MatrixXd(3, 0), 20000, 3)}, std::nullopt);
  EXPECT_NEAR(found.innovation_before, 1.0, 0.05);
  EXPECT_EQ(found.rank, 0);
  EXPECT_EQ(found.directions.cols(), 0);
}

TEST(RecordedUnknownInputs, TakesSeveralStretchesAsOneRecord) {
  const PlantModel plant = plant_of(2);
  const MatrixXd E = RandomNumbers(102).normal(3, 1);
  const auto found = find_unknown_inputs(
      plant, kSampleTime_s,
      {record(plant, E, 9000, 1), record(plant, E, 3, 2), record(plant, E, 9000, 3)}, 1);
  EXPECT_LT(angle_deg(found.directions.col(0), E.col(0)), 5.0);
  EXPECT_EQ(found.samples, 18003u);
}

TEST(RecordedUnknownInputs, FindsSeveralAndGivesAsManyAsAreAskedFor) {
  const PlantModel plant = plant_of(3);
  const MatrixXd E = RandomNumbers(103).normal(3, 2);
  const RecordedStretch stretch = record(plant, E, 20000, 4);
  for (const std::optional<Index> rank : {std::optional<Index>(), std::optional<Index>(2)}) {
    const auto found = find_unknown_inputs(plant, kSampleTime_s, {stretch}, rank);
    ASSERT_EQ(found.rank, 2);
    // Both columns lie in what was found.
    const MatrixXd U = found.directions.householderQr().householderQ() * MatrixXd::Identity(3, 2);
    for (Index j = 0; j < 2; ++j) {
      EXPECT_LT((E.col(j) - U * U.transpose() * E.col(j)).norm(), 0.15 * E.col(j).norm());
    }
  }
  EXPECT_EQ(find_unknown_inputs(plant, kSampleTime_s, {stretch}, 1).rank, 1);
}

TEST(RecordedUnknownInputs, RefusesARecordThatIsTooShort) {
  const PlantModel plant = plant_of(1);
  try {
    static_cast<void>(find_unknown_inputs(plant, kSampleTime_s,
                                          {record(plant, MatrixXd(3, 0), 100, 1)}, std::nullopt));
    FAIL();
  } catch (const UnusableRecord& error) {
    EXPECT_THAT(error.what(), HasSubstr("found 100 good samples, expected at least 150"));
  }
}

}  // namespace
}  // namespace faultline
