// Whole banks for random plants: what the filters as implemented do, at complex frequencies.
#include <algorithm>
#include <complex>
#include <vector>

#include <Eigen/LU>
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include "diagnosis/design/design_bank.h"
#include "tests/diagnosis/design/rapidcheck_plants.h"
#include "tests/diagnosis/design/reference_geometry.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;

// Outside the unit circle, where neither plant (|A| <= 0.9) nor filter has a pole.
const std::vector<std::complex<double>> kPoints = {{1.3, 0.4}, {-0.9, 1.1}, {0.2, -1.5}};
// Relative to what cancels: rounding, and what a well conditioned chain of ranks makes of it.
constexpr double kDecoupled = 1e-8;

BankRequest request_for(const PlantModel& plant, std::size_t concurrent) {
  BankRequest request;
  request.name = "random";
  request.concurrent = concurrent;
  request.domain = DesignDomain::kSampled;
  request.sample_time_s = plant.sample_time_s.value_or(0.01);
  request.threshold = 0.5;
  for (const double pole :
       {0.2, -0.3, 0.5, -0.6, 0.75, 0.02, -0.8, 0.35, -0.15, 0.65, -0.45, 0.85}) {
    request.poles.emplace_back(pole);
  }
  for (const Disturbance& disturbance : plant.disturbances) {
    request.decouple.push_back(disturbance.name);
  }
  return request;
}

struct Design {
  PlantRecipe recipe;
  PlantModel plant;
  BankRequest request;
  DesignResult result;
};

Design any_design(Index largest_n) {
  Design design;
  design.recipe = *recipes(largest_n);
  design.plant = as_discrete(random_plant(design.recipe));
  design.request = request_for(
      design.plant, *rc::gen::element<std::size_t>(0, 1) % (design.plant.faults.size() - 1) + 1);
  design.result = design_bank(design.plant, design.request);
  return design;
}

double worst_leak(const PlantModel& plant, const ResidualFilter& filter,
                  const Directions& directions) {
  double worst = 0.0;
  for (const std::complex<double> z : kPoints) {
    worst = std::max(worst, reference::leak_of(plant, filter, directions, z).relative());
  }
  return worst;
}

RC_GTEST_PROP(RandomBanks, NeitherInputsNorDisturbancesReachAResidual, ()) {
  const Design design = any_design(8);
  for (const ResidualFilter& filter : design.result.bank.filters) {
    for (const std::complex<double> z : kPoints) {
      RC_ASSERT(reference::leak_of_inputs(design.plant, filter, z).relative() < kDecoupled);
    }
    RC_ASSERT(worst_leak(design.plant, filter, reference::disturbance_directions(design.plant)) <
              kDecoupled);
  }
}

RC_GTEST_PROP(RandomBanks, SeeExactlyTheFaultsTheySayTheySee, ()) {
  const Design design = any_design(8);
  for (const ResidualFilter& filter : design.result.bank.filters) {
    for (std::size_t j = 0; j < design.plant.faults.size(); ++j) {
      const double leak =
          worst_leak(design.plant, filter, reference::fault_directions(design.plant, {j}));
      if (filter.sees[j] == Sensitivity::kNone) {
        RC_ASSERT(leak < kDecoupled);
      } else {
        RC_ASSERT(leak > 10.0 * kDecoupled);
      }
    }
    for (const std::size_t j : filter.ignores) {
      RC_ASSERT(filter.sees[j] == Sensitivity::kNone);
    }
  }
}

// A fault can be seen beside what is ignored iff it adds to the normal rank.
RC_GTEST_PROP(RandomBanks, SeeWhatAddsToTheNormalRank, ()) {
  const Design design = any_design(8);
  const Directions disturbances = reference::disturbance_directions(design.plant);
  std::size_t next = 0;
  for (const ResidualReport& report : design.result.residuals) {
    const Directions ignored = reference::side_by_side(
        reference::fault_directions(design.plant, report.ignores), disturbances);
    const Index taken =
        reference::rank(reference::transfer(design.plant, ignored, kPoints.front()));
    for (std::size_t j = 0; j < design.plant.faults.size(); ++j) {
      const Directions both =
          reference::side_by_side(ignored, reference::fault_directions(design.plant, {j}));
      const bool is_seeable =
          reference::rank(reference::transfer(design.plant, both, kPoints.front())) > taken;
      const bool is_seen =
          report.exists && design.result.bank.filters[next].sees[j] != Sensitivity::kNone;
      RC_ASSERT(is_seen == is_seeable);
    }
    next += report.exists ? 1 : 0;
  }
}

RC_GTEST_PROP(RandomBanks, DoNotUseTheInputsTheyIgnore, ()) {
  const Design design = any_design(8);
  for (const ResidualFilter& filter : design.result.bank.filters) {
    for (const std::size_t j : filter.ignores) {
      if (design.plant.faults[j].kind == FaultKind::kActuator) {
        RC_ASSERT(filter.G.col(static_cast<Index>(j)).norm() == 0.0);
      }
    }
  }
}

// The internal form that a bank carries is that of the filter: same transfer from faults.
RC_GTEST_PROP(RandomBanks, CarryTheResponseToTheirFaults, ()) {
  const Design design = any_design(8);
  for (const ResidualFilter& filter : design.result.bank.filters) {
    const Index d = filter.F.rows();
    for (const std::complex<double> z : kPoints) {
      const Eigen::MatrixXcd pencil = z * Eigen::MatrixXcd::Identity(d, d) - filter.F;
      Eigen::MatrixXcd T = -filter.J.cast<std::complex<double>>();
      if (d > 0) {
        T -= filter.M * pencil.partialPivLu().solve(filter.L.cast<std::complex<double>>());
      }
      for (std::size_t j = 0; j < design.plant.faults.size(); ++j) {
        const reference::Leak leak = reference::leak_of(
            design.plant, filter, reference::fault_directions(design.plant, {j}), z);
        RC_ASSERT(std::abs(T.col(static_cast<Index>(j)).norm() - leak.gain) <=
                  kDecoupled * leak.size);
      }
    }
  }
}

// Same residuals, same existence, same structure matrix in other coordinates of the state.
void compare(const DesignResult& a, const DesignResult& b) {
  RC_ASSERT(a.residuals.size() == b.residuals.size());
  for (std::size_t i = 0; i < a.residuals.size(); ++i) {
    RC_LOG() << "residual " << a.residuals[i].name << '\n';
    RC_ASSERT(a.residuals[i].dim_w == b.residuals[i].dim_w);
    RC_ASSERT(a.residuals[i].dim_s == b.residuals[i].dim_s);
    RC_ASSERT(a.residuals[i].rows == b.residuals[i].rows);
    RC_ASSERT(a.residuals[i].exists == b.residuals[i].exists);
  }
  for (std::size_t i = 0; i < a.bank.filters.size(); ++i) {
    RC_ASSERT(a.bank.filters[i].sees == b.bank.filters[i].sees);
  }
}

RC_GTEST_PROP(RandomBanks, AreTheSameInOtherCoordinatesOfTheState, ()) {
  const Design design = any_design(8);
  if (design.plant.C.isZero(0.0)) {
    return;
  }
  const Index n = design.plant.n();
  RandomNumbers random(design.recipe.seed + 8);
  const MatrixXd T =
      random.orthogonal(n) * random_scaling(n, 0.5, design.recipe.seed + 9) * random.orthogonal(n);
  compare(design.result, design_bank(transformed(design.plant, T), design.request));
}

// A continuous plant designed in the sampled domain, sampled by the test itself.
RC_GTEST_PROP(RandomBanks, DecoupleInTheSampledLoopOfAContinuousPlant, ()) {
  const PlantRecipe recipe = *recipes(6);
  PlantModel plant = random_plant(recipe);
  // Fast enough for the poles asked for: a slow plant would have to be sped up a thousandfold.
  plant.A *= 2.0 / std::max(plant.A.norm(), 1.0);
  BankRequest request = request_for(plant, 1);
  request.sample_time_s = 1.0;
  const DesignResult result = design_bank(plant, request);
  const PlantModel sampled = reference::sampled(plant, 1.0);
  for (const ResidualFilter& filter : result.bank.filters) {
    // Outside exp(2), the largest eigenvalue there can be.
    const std::complex<double> z(9.0, 3.0);
    RC_ASSERT(reference::leak_of_inputs(sampled, filter, z).relative() < kDecoupled);
    for (std::size_t j = 0; j < plant.faults.size(); ++j) {
      const double leak =
          reference::leak_of(sampled, filter, reference::fault_directions(sampled, {j}), z)
              .relative();
      if (filter.sees[j] == Sensitivity::kNone) {
        RC_ASSERT(leak < kDecoupled);
      }
    }
  }
}

// Units of 1e-4 to 1e4 in the states.
RC_GTEST_PROP(RandomBanks, AreTheSameInAnyUnitsOfTheState, ()) {
  const Design design = any_design(8);
  const PlantModel moved =
      transformed(design.plant, random_scaling(design.plant.n(), 4.0, design.recipe.seed + 10));
  const DesignResult result = design_bank(moved, design.request);
  compare(design.result, result);
  for (const ResidualFilter& filter : result.bank.filters) {
    for (const std::complex<double> z : kPoints) {
      RC_ASSERT(reference::leak_of_inputs(design.plant, filter, z).relative() < kDecoupled);
    }
    for (const std::size_t j : filter.ignores) {
      RC_ASSERT(worst_leak(design.plant, filter, reference::fault_directions(design.plant, {j})) <
                kDecoupled);
    }
  }
}

// P b of the ignored actuator is 2.5e-13, for rounding.
TEST(RandomBanks, DoNotUseAnInputTheyIgnoreForRounding) {
  const PlantModel plant =
      as_discrete(random_plant({PlantKind::kHighRelativeDegree, 2, 2, 1, 163076}));
  for (const ResidualFilter& filter : design_bank(plant, request_for(plant, 1)).bank.filters) {
    for (const std::size_t j : filter.ignores) {
      EXPECT_EQ(filter.G.col(static_cast<Index>(j)).norm(), 0.0) << filter.name;
    }
  }
}

// An actuator and a sensor of its own on a state must not hide that its unit differs.
TEST(RandomBanks, AreTheSameInUnitsThatOnlyAFewEntriesTell) {
  for (const PlantRecipe& recipe : {PlantRecipe{PlantKind::kWholeDisturbances, 2, 2, 1, 297969},
                                    PlantRecipe{PlantKind::kWholeDisturbances, 5, 2, 3, 25055}}) {
    const PlantModel plant = as_discrete(random_plant(recipe));
    const MatrixXd T = random_scaling(recipe.n, 4.0, recipe.seed + 10);
    for (const std::size_t p : {std::size_t{1}, std::size_t{2}}) {
      const BankRequest request = request_for(plant, p);
      const DesignResult usual = design_bank(plant, request);
      const DesignResult moved = design_bank(transformed(plant, T), request);
      for (std::size_t i = 0; i < usual.residuals.size(); ++i) {
        SCOPED_TRACE(testing::Message() << recipe << ' ' << usual.residuals[i].name);
        EXPECT_EQ(usual.residuals[i].dim_w, moved.residuals[i].dim_w);
        EXPECT_EQ(usual.residuals[i].dim_s, moved.residuals[i].dim_s);
      }
    }
  }
}

}  // namespace
}  // namespace faultline
