// Plants and requests no one should design for: each is refused with what was found and expected,
// answered with "not solvable, because", or designed correctly. Never a crash, a NaN, a wrong bank.
#include <cmath>
#include <complex>
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "diagnosis/design/design_bank.h"
#include "tests/diagnosis/design/reference_geometry.h"
#include "tests/diagnosis/hou_plant.h"
#include "tests/support/random_plant.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using testing::AllOf;
using testing::AnyOf;
using testing::HasSubstr;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();
// A residual that leaks more than this part of what cancels in it is no decoupled one.
constexpr double kDecoupled = 1e-7;

BankRequest request_for(std::size_t concurrent = 1) {
  BankRequest request;
  request.name = "bad";
  request.concurrent = concurrent;
  request.sample_time_s = 0.1;
  request.domain = DesignDomain::kSampled;
  request.threshold = 0.5;
  for (const double pole : {0.3, -0.2, 0.5, -0.4, 0.65, 0.05, -0.6, 0.8}) {
    request.poles.emplace_back(pole);
  }
  return request;
}

PlantModel good_plant() {
  PlantModel plant = as_discrete(random_plant({PlantKind::kGeneric, 4, 3, 3, 7}));
  plant.sample_time_s = 0.1;
  return plant;
}

/// What became of a design: refused with a text, or a result.
struct Outcome {
  std::string refusal;
  DesignResult result;
};

Outcome design(const PlantModel& plant, const BankRequest& request) {
  Outcome outcome;
  try {
    outcome.result = design_bank(plant, request);
  } catch (const InputError& error) {
    outcome.refusal = error.what();
    EXPECT_THAT(outcome.refusal, AnyOf(AllOf(HasSubstr("found"), HasSubstr("expected")),
                                       AllOf(HasSubstr("poles: "), HasSubstr("different"))));
  }
  return outcome;
}

bool is_finite(const ResidualFilter& f) {
  for (const MatrixXd* X : {&f.F, &f.E, &f.G, &f.M, &f.H, &f.K, &f.L, &f.J}) {
    if (!X->allFinite()) {
      return false;
    }
  }
  return true;
}

// Everything a bank claims of the loop it was designed for; `plant` discrete.
void expect_correct(const PlantModel& plant, const DesignResult& result) {
  const std::complex<double> z(1.4, 0.6);
  for (const ResidualFilter& filter : result.bank.filters) {
    SCOPED_TRACE(filter.name);
    EXPECT_TRUE(is_finite(filter));
    EXPECT_LT(spectral_radius(filter.F), 1.0);
    EXPECT_LT(reference::leak_of_inputs(plant, filter, z).relative(), kDecoupled);
    for (std::size_t j = 0; j < plant.faults.size(); ++j) {
      const double leak =
          reference::leak_of(plant, filter, reference::fault_directions(plant, {j}), z).relative();
      if (filter.sees[j] == Sensitivity::kNone) {
        EXPECT_LT(leak, kDecoupled) << "fault " << j;
      }
    }
  }
  for (const ResidualReport& report : result.residuals) {
    EXPECT_EQ(report.exists, report.reason.empty()) << report.name;
    for (const double margin : report.margin) {
      EXPECT_TRUE(std::isfinite(margin)) << report.name;
    }
  }
  EXPECT_EQ(result.is_solvable, result.failing.empty());
}

void expect_refused_or_correct(const PlantModel& plant, const BankRequest& request) {
  const Outcome outcome = design(plant, request);
  if (outcome.refusal.empty()) {
    EXPECT_FALSE(outcome.result.residuals.empty());
    expect_correct(plant, outcome.result);
  }
}

TEST(BadPlants, WithUnobservableModesAreDesignedOnWhatIsSeen) {
  PlantModel plant = good_plant();
  plant.A.topRightCorner(3, 1).setZero();
  plant.C.rightCols(1).setZero();
  const Outcome outcome = design(plant, request_for());
  EXPECT_EQ(outcome.refusal, "");
  EXPECT_TRUE(outcome.result.is_solvable);
  expect_correct(plant, outcome.result);
  for (const ResidualReport& report : outcome.result.residuals) {
    EXPECT_LE(report.quotient_dim, 3);
  }
}

TEST(BadPlants, WhoseOutputsRepeatLoseTheRowsTheyLack) {
  PlantModel plant = good_plant();
  plant.C.row(2) = 2.0 * plant.C.row(0);
  const Outcome outcome = design(plant, request_for());
  EXPECT_EQ(outcome.refusal, "");
  expect_correct(plant, outcome.result);
  for (const ResidualReport& report : outcome.result.residuals) {
    EXPECT_EQ(report.rows, 1);
  }
}

TEST(BadPlants, WithOneOutputAreNotSolvableAndSayWhy) {
  PlantModel plant = good_plant();
  plant.C = plant.C.topRows(1).replicate(3, 1).eval();
  const Outcome outcome = design(plant, request_for());
  EXPECT_EQ(outcome.refusal, "");
  EXPECT_FALSE(outcome.result.is_solvable);
  for (const ResidualReport& report : outcome.result.residuals) {
    EXPECT_FALSE(report.exists);
    EXPECT_NE(report.reason, "");
  }
}

TEST(BadPlants, WhoseOutputsSeeNothingAreNotSolvable) {
  PlantModel plant = good_plant();
  plant.C.setZero();
  const Outcome outcome = design(plant, request_for());
  EXPECT_EQ(outcome.refusal, "");
  EXPECT_FALSE(outcome.result.is_solvable);
  EXPECT_TRUE(outcome.result.bank.filters.empty());
}

TEST(BadPlants, WithRepeatedFaultDirectionsNameTheFaultsThatCannotBeTold) {
  PlantModel plant = good_plant();
  plant.faults[1].state = -3.0 * plant.faults[0].state;
  plant.B.col(1) = plant.faults[1].state;
  const Outcome outcome = design(plant, request_for());
  EXPECT_EQ(outcome.refusal, "");
  EXPECT_FALSE(outcome.result.is_solvable);
  EXPECT_FALSE(outcome.result.are_signatures_distinct);
  expect_correct(plant, outcome.result);
  ASSERT_EQ(outcome.result.failing.size(), 2u);
  EXPECT_EQ(outcome.result.failing[0].ignores, std::vector<std::size_t>{0});
  EXPECT_EQ(outcome.result.failing[0].fault, 1u);
  EXPECT_EQ(outcome.result.failing[1].fault, 0u);
}

TEST(BadPlants, WithAZeroFaultDirectionDoNotSeeThatFault) {
  PlantModel plant = good_plant();
  plant.faults[2].state.setZero();
  plant.B.col(2).setZero();
  const Outcome outcome = design(plant, request_for());
  if (outcome.refusal.empty()) {
    EXPECT_FALSE(outcome.result.is_solvable);
    expect_correct(plant, outcome.result);
    for (const ResidualFilter& filter : outcome.result.bank.filters) {
      EXPECT_EQ(filter.sees[2], Sensitivity::kNone);
    }
  }
}

TEST(BadPlants, WithNoInputsAreDiagnosedByTheirOutputsAlone) {
  PlantModel plant = good_plant();
  plant.B.resize(4, 0);
  plant.D.resize(3, 0);
  plant.input_names.clear();
  plant.input_range.resize(0);
  plant.u_operating.resize(0);
  const Outcome outcome = design(plant, request_for());
  EXPECT_EQ(outcome.refusal, "");
  EXPECT_TRUE(outcome.result.is_solvable);
  expect_correct(plant, outcome.result);
}

TEST(BadPlants, AreRefusedWithMoreConcurrentFaultsThanThereAre) {
  for (const std::size_t p : {std::size_t{0}, std::size_t{3}, std::size_t{4}, SIZE_MAX}) {
    EXPECT_THAT(design(good_plant(), request_for(p)).refusal, HasSubstr("concurrent: found")) << p;
  }
}

TEST(BadPlants, AreNotSolvableForAsManyFaultsAsTheyHaveOutputs) {
  const PlantModel plant = as_discrete(random_plant({PlantKind::kGeneric, 4, 4, 2, 3}));
  BankRequest request = request_for(2);
  request.sample_time_s = 1.0;
  const Outcome outcome = design(plant, request);
  EXPECT_EQ(outcome.refusal, "");
  EXPECT_FALSE(outcome.result.is_solvable);
  for (const ResidualReport& report : outcome.result.residuals) {
    EXPECT_FALSE(report.exists);
    EXPECT_NE(report.reason, "");
  }
}

TEST(BadRequests, WithPolesThatAreNoneAreRefused) {
  using Poles = std::vector<std::complex<double>>;
  const std::vector<Poles> sampled = {{},
                                      {1.0},
                                      {-1.5},
                                      {{0.8, 0.8}, {0.8, -0.8}},
                                      {{0.1, 0.2}},
                                      {{0.1, 0.2}, 0.3},
                                      {0.5, {0.1, -0.2}},
                                      {{0.1, 0.2}, {0.1, 0.2}}};
  for (const Poles& poles : sampled) {
    BankRequest request = request_for();
    request.poles = poles;
    EXPECT_THAT(design(good_plant(), request).refusal, HasSubstr("poles: found"));
  }
  for (const Poles& poles : {Poles{0.0}, Poles{2.0}, Poles{{0.0, 1.0}, {0.0, -1.0}}}) {
    BankRequest request = hou_request();
    request.poles = poles;
    EXPECT_THAT(design(hou_plant(), request).refusal, HasSubstr("poles: found"));
  }
}

TEST(BadRequests, WithNumbersThatAreNoneAreRefused) {
  for (const double bad : {0.0, -1.0, kNan}) {
    BankRequest request = hou_request();
    request.sample_time_s = bad;
    EXPECT_THAT(design(hou_plant(), request).refusal, HasSubstr("sample_time_s: found")) << bad;
    request = hou_request();
    request.threshold = bad;
    EXPECT_THAT(design(hou_plant(), request).refusal, HasSubstr("threshold")) << bad;
  }
}

// Repeated requests of a pole, beyond what the rows allow.
TEST(BadRequests, WithOnePoleForAResidualOfOneRowAreRefused) {
  BankRequest request = request_for();
  request.poles = {0.4};
  PlantModel plant = good_plant();
  plant.C.row(2) = plant.C.row(0);
  EXPECT_THAT(design(plant, request).refusal, HasSubstr("different poles"));
}

class BadlyScaledPlants : public testing::TestWithParam<double> {};

// Units of 1e±12 in a state, an output, an input, a fault: nothing of the answer depends on them.
TEST_P(BadlyScaledPlants, GiveTheSameAnswer) {
  const double unit = GetParam();
  const PlantModel plant = good_plant();
  const DesignResult usual = design_bank(plant, request_for());
  ASSERT_TRUE(usual.is_solvable);
  std::vector<std::pair<std::string, PlantModel>> variants;
  PlantModel variant = plant;
  variant.C.row(1) *= unit;
  variants.emplace_back("output", variant);
  variant = plant;
  variant.B.col(0) *= unit;
  variant.faults[0].state *= unit;
  variants.emplace_back("input", variant);
  variant = plant;
  variant.faults[1].state *= unit;
  variants.emplace_back("fault", variant);
  VectorXd T = VectorXd::Ones(4);
  T[2] = unit;
  variants.emplace_back("state", transformed(plant, T.asDiagonal()));
  variants.emplace_back("all states", transformed(plant, unit * MatrixXd::Identity(4, 4)));
  for (const auto& [name, scaled] : variants) {
    SCOPED_TRACE(name);
    const Outcome outcome = design(scaled, request_for());
    EXPECT_EQ(outcome.refusal, "");
    EXPECT_TRUE(outcome.result.is_solvable);
    ASSERT_EQ(outcome.result.bank.filters.size(), usual.bank.filters.size());
    expect_correct(scaled, outcome.result);
    for (std::size_t i = 0; i < usual.bank.filters.size(); ++i) {
      EXPECT_EQ(outcome.result.bank.filters[i].sees, usual.bank.filters[i].sees);
    }
  }
}
INSTANTIATE_TEST_SUITE_P(Units, BadlyScaledPlants, testing::Values(1e-12, 1e-4, 1e4, 1e12),
                         [](const auto& unit) {
                           return unit.param < 1.0
                                      ? fmt::format("down{:.0f}", -std::log10(unit.param))
                                      : fmt::format("up{:.0f}", std::log10(unit.param));
                         });

TEST(BadPlants, WithSingleEntriesOfAnySizeAreRefusedOrCorrect) {
  for (const double size : {1e-300, 1e-12, 1e12, 1e100}) {
    for (int which = 0; which < 3; ++which) {
      PlantModel plant = good_plant();
      if (which == 0) {
        plant.A(1, 2) = size;
      } else if (which == 1) {
        plant.B(1, 0) = plant.faults[0].state[1] = size;
      } else {
        plant.C(1, 2) = size;
      }
      SCOPED_TRACE(fmt::format("{} in matrix {}", size, "ABC"[which]));
      expect_refused_or_correct(plant, request_for());
    }
  }
}

TEST(BadPlants, WithNumbersThatAreNoneAreRefused) {
  for (const double bad : {kNan, kInfinity}) {
    const auto refuses = [&](const std::string& what, auto change) {
      SCOPED_TRACE(fmt::format("{} in {}", bad, what));
      PlantModel plant = good_plant();
      change(plant);
      EXPECT_NE(design(plant, request_for()).refusal, "");
    };
    refuses("A", [&](PlantModel& plant) { plant.A(0, 1) = bad; });
    refuses("B", [&](PlantModel& plant) { plant.B(0, 1) = bad; });
    refuses("C", [&](PlantModel& plant) { plant.C(0, 1) = bad; });
    refuses("D", [&](PlantModel& plant) { plant.D(0, 1) = bad; });
    refuses("fault state", [&](PlantModel& plant) { plant.faults[0].state[0] = bad; });
    refuses("fault output", [&](PlantModel& plant) { plant.faults[0].output[0] = bad; });
    refuses("fault size", [&](PlantModel& plant) { plant.faults[0].size = bad; });
    refuses("output range", [&](PlantModel& plant) { plant.output_range[0] = bad; });
  }
}

TEST(BadPlants, WithoutStatesAreRefusedOrCorrect) {
  PlantModel plant = good_plant();
  plant.A.resize(0, 0);
  plant.B.resize(0, 3);
  plant.C.resize(3, 0);
  plant.state_names.clear();
  plant.x_operating.resize(0);
  for (Fault& fault : plant.faults) {
    fault.state.resize(0);
  }
  for (std::size_t j = 0; j < 3; ++j) {
    plant.faults[j].output = VectorXd::Unit(3, static_cast<Index>(j));
  }
  expect_refused_or_correct(plant, request_for());
}

TEST(BadPlants, WithoutOutputsAreRefusedOrNotSolvable) {
  PlantModel plant = good_plant();
  plant.C.resize(0, 4);
  plant.D.resize(0, 3);
  plant.output_names.clear();
  plant.output_range.resize(0);
  plant.y_operating.resize(0);
  for (Fault& fault : plant.faults) {
    fault.output.resize(0);
  }
  const Outcome outcome = design(plant, request_for());
  if (outcome.refusal.empty()) {
    EXPECT_FALSE(outcome.result.is_solvable);
    EXPECT_TRUE(outcome.result.bank.filters.empty());
  }
}

TEST(BadPlants, OfShapesThatDoNotFitAreRefused) {
  const auto refuses = [](const std::string& what, auto change) {
    SCOPED_TRACE(what);
    PlantModel plant = good_plant();
    change(plant);
    EXPECT_NE(design(plant, request_for()).refusal, "");
  };
  refuses("A", [](PlantModel& plant) { plant.A.conservativeResize(4, 3); });
  refuses("fault", [](PlantModel& plant) { plant.faults[0].state.conservativeResize(2); });
  refuses("names", [](PlantModel& plant) { plant.output_names.pop_back(); });
}

// Decoupling is not asked for at such sizes; a filter that is no filter must not be in a bank.
TEST(BadPlants, WithAnEntryOfAnySizeInAGetNoUnstableFilter) {
  for (const double size : {1e150, 1e200, 1e250, 1e300}) {
    PlantModel plant = good_plant();
    plant.A(1, 2) = size;
    const Outcome outcome = design(plant, request_for());
    for (const ResidualFilter& filter : outcome.result.bank.filters) {
      EXPECT_LT(spectral_radius(filter.F), 1.0) << filter.name << " with " << size << " in A";
    }
  }
}

// x' = A x, y = u-free of x: W* of a mixed direction has dimension 2, in any units.
TEST(BadPlants, WhoseOutputsSeeNothingHaveTheSameDimensionsInAnyUnits) {
  PlantModel plant = as_discrete(random_plant({PlantKind::kWholeMixed, 2, 2, 1, 39214}));
  ASSERT_TRUE(plant.C.isZero(0.0));
  const VectorXd T = Eigen::Vector2d(2.6441, 0.000265039);
  BankRequest request = request_for(2);
  request.sample_time_s = 1.0;
  const DesignResult usual = design_bank(plant, request);
  const DesignResult moved = design_bank(transformed(plant, T.asDiagonal()), request);
  for (std::size_t i = 0; i < usual.residuals.size(); ++i) {
    EXPECT_EQ(usual.residuals[i].dim_w, moved.residuals[i].dim_w) << usual.residuals[i].name;
  }
}

TEST(BadRequests, WithNumbersThatAreNotFiniteAreRefused) {
  for (const double bad : {kNan, -kInfinity}) {
    BankRequest request = request_for();
    request.poles.front() = bad;
    EXPECT_NE(design(good_plant(), request).refusal, "");
    request = hou_request();
    request.poles = {bad};
    EXPECT_NE(design(hou_plant(), request).refusal, "");
  }
  BankRequest request = hou_request();
  request.sample_time_s = kInfinity;
  EXPECT_NE(design(hou_plant(), request).refusal, "");
  request = hou_request();
  request.threshold = kInfinity;
  EXPECT_NE(design(hou_plant(), request).refusal, "");
}

}  // namespace
}  // namespace faultline
