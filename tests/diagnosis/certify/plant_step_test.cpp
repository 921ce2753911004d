#include "diagnosis/certify/plant_step.h"

#include <stdexcept>

#include <gtest/gtest.h>

#include "tests/diagnosis/certify/observer_cases.h"

namespace faultline {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

Bank bank_of(const char* method, DesignDomain domain) {
  Bank bank;
  bank.method = method;
  bank.domain = domain;
  bank.sample_time_s = 0.01;
  return bank;
}

constexpr double kRounding = 1e-14;

TEST(PlantStep, IsEulersInTheEulerDomain) {
  const PlantModel plant = tanh_plant();
  const VectorXd scales{{4.0, 0.5}};
  const SampledSystem step =
      plant_step(plant, bank_of("geometric", DesignDomain::kEuler), plant.B, scales);
  const MatrixXd A = MatrixXd::Identity(2, 2) + 0.01 * plant.A;
  const MatrixXd D = scales.asDiagonal();
  EXPECT_LE((D * step.A - A * D).norm(), kRounding);
  EXPECT_LE((D * step.B - 0.01 * plant.B).norm(), kRounding);
}

TEST(PlantStep, HasTheMiddleOfTheSlopesInItForObserversOnly) {
  const PlantModel plant = tanh_plant();
  const Nonlinearity& term = plant.nonlinearities[0];
  const VectorXd scales{{4.0, 0.5}};
  const MatrixXd D = scales.asDiagonal();
  for (const DesignDomain domain : {DesignDomain::kEuler, DesignDomain::kSampled}) {
    const SampledSystem plain = plant_step(plant, bank_of("geometric", domain), term.E_o, scales);
    const SampledSystem step = plant_step(plant, bank_of("uio", domain), term.E_o, scales);
    // gain -2, slopes 0 to 1; the term is held over the sample like an input.
    const MatrixXd expected = D * plain.A + -2.0 * 0.5 * (D * plain.B) * (term.E_i.transpose() * D);
    EXPECT_LE((D * step.A - expected).norm(), kRounding);
    EXPECT_EQ(step.B, plain.B);
  }
}

TEST(PlantStep, LeavesADiscretePlantAsItIs) {
  PlantModel plant = tanh_plant();
  plant.time = TimeDomain::kDiscrete;
  plant.sample_time_s = 0.01;
  for (const DesignDomain domain : {DesignDomain::kEuler, DesignDomain::kSampled}) {
    const SampledSystem step =
        plant_step(plant, bank_of("geometric", domain), plant.B, VectorXd::Ones(2));
    EXPECT_EQ(step.A, plant.A);
    EXPECT_EQ(step.B, plant.B);
  }
  plant.sample_time_s = 0.02;
  EXPECT_THROW(static_cast<void>(plant_step(plant, bank_of("geometric", DesignDomain::kEuler),
                                            plant.B, VectorXd::Ones(2))),
               std::invalid_argument);
}

}  // namespace
}  // namespace faultline
