#include "diagnosis/design/uio/observer_plant.h"

#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/diagnosis/flexible_joint.h"

namespace faultline {
namespace {

using Eigen::MatrixXd;
using testing::HasSubstr;

constexpr double kRounding = 1e-12;

template <class Call>
std::string refusal(Call call) {
  try {
    call();
  } catch (const InputError& error) {
    return error.what();
  }
  return "accepted";
}

TEST(ObserverPlant, OfTheEulerDomainIsThePlantThatEulerSteps) {
  BankRequest request = joint_request("");
  request.domain = DesignDomain::kEuler;
  const ObserverPlant stepped = observer_plant(flexible_joint(), request);
  const ObserverPlant discrete = observer_plant(flexible_joint_euler(), request);
  EXPECT_LT((stepped.A - discrete.A).norm(), kRounding);
  EXPECT_LT((stepped.B - discrete.B).norm(), kRounding);
  EXPECT_LT((stepped.fault_states - discrete.fault_states).norm(), kRounding);
  EXPECT_LT((stepped.disturbance_states - discrete.disturbance_states).norm(), kRounding);
  EXPECT_LT((stepped.E_o - discrete.E_o).norm(), kRounding);
}

TEST(ObserverPlant, OfTheSampledDomainHoldsTheNonlinearityLikeAnInput) {
  const PlantModel plant = flexible_joint();
  const ObserverPlant sampled = observer_plant(plant, joint_request(""));
  // exp(A T) and ∫ exp(A s) ds by their series, term by term.
  const double T = 0.01;
  MatrixXd power = MatrixXd::Identity(4, 4);
  MatrixXd exponential = power;
  MatrixXd integral = T * power;
  for (int i = 1; i < 30; ++i) {
    power = (power * plant.A * T / i).eval();
    exponential += power;
    integral += power * T / (i + 1);
  }
  EXPECT_LT((sampled.A - exponential).norm(), kRounding);
  EXPECT_LT((sampled.B - integral * plant.B).norm(), kRounding);
  EXPECT_LT((sampled.E_o - integral * plant.nonlinearities[0].E_o).norm(), kRounding);
}

TEST(ObserverModel, CarriesAFaultAsAStateThatChangesAnOutput) {
  const PlantModel plant = flexible_joint_euler();
  const BankRequest request = joint_request("");
  const ObserverModel model =
      observer_model(plant, request, observer_plant(plant, request), {{1}, {0}, 0.001}, {});
  EXPECT_EQ(model.n(), 5);
  EXPECT_EQ(model.A(4, 4), 1.0);
  EXPECT_TRUE(model.A.col(4).head(4).isZero(0.0));
  EXPECT_EQ(model.C.col(4), Eigen::Vector3d::UnitX());
  EXPECT_EQ(model.M.cols(), 5);  // three disturbances, one noise, one drift
  EXPECT_EQ(model.M.col(4), (Eigen::VectorXd::Unit(5, 4)));
  EXPECT_EQ(model.W.col(3), Eigen::Vector3d(0.1, -0.02, 0.0));
  EXPECT_EQ(model.w_bound[3], 0.1);
  EXPECT_EQ(model.w_bound[4], 0.001);
  EXPECT_EQ(model.slope_radius[0], 0.333);
  EXPECT_EQ(model.F_x(1, 0), 0.216);
  EXPECT_EQ(model.x_bound[4], 0.0);
}

TEST(ObserverModel, HasTheMiddleOfTheSlopesInA) {
  PlantModel plant = flexible_joint_euler();
  plant.nonlinearities[0].slope_min = 0.0;  // as of a dead zone
  const BankRequest request = joint_request("");
  const ObserverPlant sampled = observer_plant(plant, request);
  const ObserverModel model = observer_model(plant, request, sampled, {{}, {0}, 0.0}, {});
  // The corners are those of the slopes: A + E_o gain {0, 1} E_i.
  const MatrixXd all = -0.333 * sampled.E_o * sampled.E_i;
  const MatrixXd low = model.A + model.vertex(0);
  const MatrixXd high = model.A + model.vertex(1);
  EXPECT_LT(std::min((low - sampled.A).norm(), (high - sampled.A).norm()), kRounding);
  EXPECT_LT(std::min((low - sampled.A - all).norm(), (high - sampled.A - all).norm()), kRounding);
}

TEST(ObserverModel, RefusesMissingBoundsByName) {
  const BankRequest request = joint_request("");
  const ObserverTask task{{}, {0}, 0.0};
  const auto model_of = [&](const PlantModel& plant, const std::vector<std::size_t>& decoupled) {
    return observer_model(plant, request, observer_plant(plant, request), task, decoupled);
  };
  PlantModel plant = flexible_joint_euler();
  plant.disturbances[1].bound.reset();
  EXPECT_THAT(refusal([&] { static_cast<void>(model_of(plant, {})); }),
              HasSubstr("disturbance \"zd2\" without a bound"));
  EXPECT_EQ(refusal([&] { static_cast<void>(model_of(plant, {0, 1, 2})); }), "accepted");
  plant = flexible_joint_euler();
  plant.noises[0].bound.reset();
  plant.noises[0].sigma = 1.0;
  EXPECT_THAT(refusal([&] { static_cast<void>(model_of(plant, {})); }), HasSubstr("`bound`"));
  plant = flexible_joint_euler();
  plant.state_range.reset();
  EXPECT_THAT(refusal([&] { static_cast<void>(model_of(plant, {})); }),
              HasSubstr("without `range` in [states]"));
  plant = flexible_joint_euler();
  plant.nonlinearities.resize(7, plant.nonlinearities[0]);
  EXPECT_THAT(refusal([&] { static_cast<void>(model_of(plant, {})); }),
              HasSubstr("found 7 nonlinearities, expected at most 6"));
}

}  // namespace
}  // namespace faultline
