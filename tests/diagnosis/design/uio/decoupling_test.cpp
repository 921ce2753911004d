#include "diagnosis/design/uio/decoupling.h"

#include <Eigen/QR>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "diagnosis/design/uio/observer_plant.h"
#include "tests/diagnosis/flexible_joint.h"

namespace faultline {
namespace {

using Eigen::MatrixXd;
using testing::ElementsAre;

constexpr double kExact = 1e-13;

ObserverPlant euler_joint() { return observer_plant(flexible_joint_euler(), joint_request("")); }

TEST(Decoupling, TakesDirectionsNotColumns) {
  // The third disturbance of the robot is -2 times the second: two directions, all of them.
  const ObserverPlant plant = euler_joint();
  const DecouplableDirections split = split_decouplable(plant.disturbance_states, plant.C);
  EXPECT_EQ(split.D_1.cols(), 2);
  EXPECT_EQ(split.D_2.cols(), 0);
  const DecouplingMatrices matrices = decoupling_matrices(split.D_1, plant.C);
  EXPECT_LT((matrices.S * plant.disturbance_states).norm(), kExact);
  EXPECT_THAT(annihilated_columns(matrices.S, plant.disturbance_states), ElementsAre(0, 1, 2));
  // Ma 2024, (42): the entries of T and S are sixths.
  MatrixXd T(4, 3);
  T << 2, 2, -2, 2, 5, 1, -2, -5, -1, 0, 6, 6;
  EXPECT_LT((6.0 * matrices.T - T).norm(), 1e-11) << 6.0 * matrices.T;
  EXPECT_LT((matrices.S - (MatrixXd::Identity(4, 4) - matrices.T * plant.C)).norm(), kExact);
}

TEST(Decoupling, LeavesOutWhatNoOutputShowsWithinASample) {
  const MatrixXd C = MatrixXd::Identity(2, 4);
  MatrixXd D = MatrixXd::Zero(4, 3);
  D.col(0) << 1, 0, 1, 0;
  D.col(1) << 0, 0, 0, 1;  // C D = 0
  D.col(2) << 2, 0, 2, 3;  // of both
  const DecouplableDirections split = split_decouplable(D, C);
  ASSERT_EQ(split.D_1.cols(), 1);
  ASSERT_EQ(split.D_2.cols(), 1);
  EXPECT_LT((C * split.D_2).norm(), kExact);
  // Together they span what D spans.
  MatrixXd both(4, 2);
  both << split.D_1, split.D_2;
  const MatrixXd coefficients = both.colPivHouseholderQr().solve(D);
  EXPECT_LT((both * coefficients - D).norm(), kExact);
  const DecouplingMatrices matrices = decoupling_matrices(split.D_1, C);
  EXPECT_LT((matrices.S * split.D_1).norm(), kExact);
}

TEST(Decoupling, OfNothingIsNothing) {
  const MatrixXd C = MatrixXd::Identity(2, 3);
  const DecouplableDirections none = split_decouplable(MatrixXd(3, 0), C);
  EXPECT_EQ(none.D_1.cols(), 0);
  const DecouplableDirections zero = split_decouplable(MatrixXd::Zero(3, 2), C);
  EXPECT_EQ(zero.D_1.cols() + zero.D_2.cols(), 0);
  const DecouplingMatrices matrices = decoupling_matrices(none.D_1, C);
  EXPECT_EQ(matrices.T, MatrixXd::Zero(3, 2));
  EXPECT_EQ(matrices.S, MatrixXd::Identity(3, 3));
}

}  // namespace
}  // namespace faultline
