#include "diagnosis/certify/certify.h"

#include <array>
#include <cmath>
#include <complex>
#include <numbers>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "diagnosis/certify/filter_loop.h"
#include "diagnosis/certify/sampled_plant.h"
#include "diagnosis/design/design_bank.h"
#include "tests/diagnosis/certify/certify_cases.h"
#include "tests/diagnosis/hou_plant.h"
#include "tests/support/random_seed.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXcd;
using Eigen::VectorXd;
using ::testing::HasSubstr;

constexpr std::array kDomains = {DesignDomain::kContinuous, DesignDomain::kSampled};

void expect_finite(const Bank& bank) {
  for (const ResidualFilter& filter : bank.filters) {
    const FilterCertificate& certificate = filter.certificate;
    for (const auto* values :
         {&certificate.input_gain, &certificate.disturbance_gain, &certificate.fault_gain,
          &certificate.dc_gain, &certificate.band_gain, &certificate.margin,
          &certificate.smallest_fault, &certificate.delay_s}) {
      for (const double value : *values) {
        EXPECT_TRUE(std::isfinite(value) && value >= 0.0) << filter.name << " " << value;
      }
    }
    EXPECT_TRUE(std::isfinite(certificate.band_Hz));
    EXPECT_TRUE(std::isfinite(certificate.rank.smallest_kept));
  }
}

// Response to an impulse of the internal form: gain at DC from L and J.
double internal_dc_gain(const ResidualFilter& filter, Index j) {
  const Index d = filter.F.rows();
  VectorXd r = filter.J.col(j);
  if (d > 0) {
    r += filter.M * (MatrixXd::Identity(d, d) - filter.F).lu().solve(filter.L.col(j));
  }
  return r.norm();
}

std::string refusal(const PlantModel& plant, Bank bank) {
  try {
    certify(plant, bank);
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "";
}

CertifyCase case_with_everything(std::uint64_t seed, DesignDomain domain) {
  CertifyCase result = random_case(seed, 6, 3, 6, 1, domain);
  PlantModel& plant = result.plant;
  plant.D = 0.3 * MatrixXd::Ones(6, 3);
  for (Index j = 0; j < 3; ++j) {
    plant.faults[static_cast<std::size_t>(j)].output = plant.D.col(j);
  }
  plant.faults.push_back({"y2", FaultKind::kSensor, VectorXd::Zero(6), VectorXd::Unit(6, 1), 0.5});
  plant.disturbances.push_back({"d1", VectorXd::Unit(6, 1), VectorXd::Zero(6), std::nullopt});
  plant.disturbances.push_back({"d2", VectorXd::Unit(6, 2), VectorXd::Unit(6, 0), std::nullopt});
  result.request.decouple = {"d2"};
  return result;
}

TEST(FilterLoop, HasTheGainsOfASimulationWithSines) {
  for (const DesignDomain domain : kDomains) {
    const std::uint64_t seed = test_seed(40);
    SCOPED_TRACE(seed_message(seed));
    const CertifyCase random = case_with_everything(seed, domain);
    const Bank bank = random.designed();
    ASSERT_FALSE(bank.filters.empty());
    for (const ResidualFilter& filter : bank.filters) {
      SampledPlant plant(random.plant, bank, spectral_radius(filter.F));
      const FilterLoop loop(plant, filter);
      for (const double angle : {0.0, 0.003, 0.1, 1.0, 3.0, std::numbers::pi}) {
        const FilterLoop::Gains gains = loop.at(angle);
        for (Index i = 0; i < plant.inputs(); ++i) {
          // e^(iωk) as a cosine and a sine; both have settled long before the last sample.
          LoopSimulation cosine(random.plant, bank, filter);
          LoopSimulation sine(random.plant, bank, filter);
          VectorXcd r;
          for (int k = 0; k < 4000; ++k) {
            const VectorXd w = VectorXd::Unit(plant.inputs(), i);
            const VectorXd real = cosine.step(std::cos(angle * k) * w);
            const VectorXd imaginary = sine.step(std::sin(angle * k) * w);
            r = real.cast<std::complex<double>>() + std::complex<double>(0.0, 1.0) * imaginary;
          }
          EXPECT_NEAR(gains.gain[i], r.norm(), 1e-9 * (1.0 + r.norm()))
              << filter.name << " input " << i << " angle " << angle;
        }
      }
    }
  }
}

TEST(Certify, GivesTheLargestGainOfAFineGrid) {
  for (const DesignDomain domain : kDomains) {
    const CertifyCase random = case_with_everything(test_seed(41), domain);
    const Bank bank = random.certified();
    for (const ResidualFilter& filter : bank.filters) {
      SampledPlant plant(random.plant, bank, spectral_radius(filter.F));
      const FilterLoop loop(plant, filter);
      VectorXd largest = VectorXd::Zero(plant.inputs());
      for (int i = 0; i <= 2000; ++i) {
        largest = largest.cwiseMax(loop.at(std::numbers::pi * i / 2000.0).gain);
      }
      for (Index j = 0; j < 4; ++j) {
        const auto at = static_cast<std::size_t>(j);
        const double expected = largest[3 + j] * random.plant.faults[at].size;
        EXPECT_NEAR(filter.certificate.fault_gain[at], expected, 0.02 * expected + 1e-9);
      }
    }
  }
}

TEST(Certify, GivesTheGainsSmallestFaultsAndDelaysOfASimulationWithSteps) {
  for (const DesignDomain domain : kDomains) {
    const CertifyCase random = case_with_everything(test_seed(42), domain);
    const Bank bank = random.certified();
    const Index m = random.plant.m();
    for (const ResidualFilter& filter : bank.filters) {
      const FilterCertificate& certificate = filter.certificate;
      for (std::size_t j = 0; j < random.plant.faults.size(); ++j) {
        if (filter.sees[j] != Sensitivity::kSteady) {
          EXPECT_EQ(certificate.smallest_fault[j], 0.0);
          EXPECT_EQ(certificate.delay_s[j], 0.0);
          continue;
        }
        LoopSimulation simulation(random.plant, bank, filter);
        const VectorXd unit = VectorXd::Unit(simulation.inputs(), m + static_cast<Index>(j));
        std::uint32_t exceeded = 0;
        double fired_s = -1.0;
        double norm = 0.0;
        for (int k = 0; k < 4000; ++k) {
          norm = simulation.step(2.0 * certificate.smallest_fault[j] * unit).norm();
          exceeded = norm > filter.threshold ? exceeded + 1 : 0;
          if (exceeded == bank.decision.dwell && fired_s < 0.0) {
            fired_s = bank.sample_time_s * k;
          }
        }
        EXPECT_NEAR(norm, 2.0 * filter.threshold, 1e-9);  // by definition of the smallest fault
        EXPECT_NEAR(certificate.dc_gain[j] * certificate.smallest_fault[j],
                    filter.threshold * random.plant.faults[j].size, 1e-12);
        EXPECT_DOUBLE_EQ(certificate.delay_s[j], fired_s) << filter.name << " fault " << j;
      }
    }
  }
}

TEST(Certify, GivesTheSmallestFaultAndDelayOfAFaultSeenInTransients) {
  // The measurement disturbance e1 decoupled from Hou's plant: r2 sees u4 only while it changes.
  CertifyCase hou{hou_plant(), hou_request()};
  hou.plant.disturbances.push_back({"d", VectorXd::Zero(3), VectorXd::Unit(3, 0), std::nullopt});
  hou.request.concurrent = 1;
  hou.request.decouple = {"d"};
  hou.request.domain = DesignDomain::kSampled;
  hou.request.poles = {std::exp(-0.1), std::exp(-0.11)};
  const Bank bank = hou.certified();
  int transients = 0;
  for (const ResidualFilter& filter : bank.filters) {
    for (std::size_t j = 0; j < 4; ++j) {
      if (filter.sees[j] != Sensitivity::kTransient) {
        continue;
      }
      ++transients;
      const double smallest = filter.certificate.smallest_fault[j];
      EXPECT_EQ(filter.certificate.dc_gain[j], 0.0);
      ASSERT_GT(smallest, 0.0);
      for (const double part : {0.999, 1.001, 2.0}) {
        LoopSimulation simulation(hou.plant, bank, filter);
        std::uint32_t exceeded = 0;
        double fired_s = 0.0;
        for (int k = 0; k < 200 && fired_s == 0.0; ++k) {
          const VectorXd r = simulation.step(
              part * smallest * VectorXd::Unit(simulation.inputs(), 4 + static_cast<Index>(j)));
          exceeded = r.norm() > filter.threshold ? exceeded + 1 : 0;
          fired_s = exceeded == bank.decision.dwell ? 0.01 * k : 0.0;
        }
        EXPECT_EQ(fired_s > 0.0, part > 1.0) << filter.name << " fault " << j << " part " << part;
        if (part == 2.0) {
          EXPECT_DOUBLE_EQ(filter.certificate.delay_s[j], fired_s);
        }
      }
    }
  }
  EXPECT_GE(transients, 2);
}

TEST(Certify, GivesHousNumbersInClosedForm) {
  const PlantModel plant = hou_plant();
  Bank bank = hou_bank();
  certify(plant, bank);
  // DC gains, normalised, and ‖b_j - Π_S b_j‖ / ‖b_j‖ = |p·b_j| / ‖b_j‖ with p ∝ b_i × b_l.
  const std::vector<std::vector<double>> gains = {{0, 0, 1, 1}, {0, 1, 0, 1}, {0, 1, 1, 0},
                                                  {1, 0, 0, 2}, {1, 0, 2, 0}, {1, 2, 0, 0}};
  const std::vector<std::pair<Index, Index>> pairs = {{0, 1}, {0, 2}, {0, 3},
                                                      {1, 2}, {1, 3}, {2, 3}};
  ASSERT_EQ(bank.filters.size(), 6u);
  for (std::size_t i = 0; i < 6; ++i) {
    const FilterCertificate& certificate = bank.filters[i].certificate;
    SCOPED_TRACE(bank.filters[i].name);
    EXPECT_NEAR(certificate.spectral_radius, std::exp(-0.1), 1e-12);
    EXPECT_NEAR(certificate.band_Hz, 10.0 / (2.0 * std::numbers::pi), 1e-6);
    EXPECT_EQ(certificate.rank.dim_w, 2u);
    EXPECT_EQ(certificate.rank.dim_s, 2u);
    const Eigen::Vector3d b_i = plant.B.col(pairs[i].first);
    const Eigen::Vector3d b_l = plant.B.col(pairs[i].second);
    const Eigen::Vector3d p = b_i.cross(b_l).normalized();
    for (std::size_t j = 0; j < 4; ++j) {
      const VectorXd b = plant.B.col(static_cast<Index>(j));
      EXPECT_NEAR(certificate.margin[j], std::abs(p.dot(b)) / b.norm(), 1e-12);
      EXPECT_NEAR(certificate.dc_gain[j], gains[i][j], 1e-8);
      EXPECT_LT(certificate.input_gain[j], 1e-3);
      if (gains[i][j] == 0.0) {
        EXPECT_LT(certificate.fault_gain[j], 1e-3);
        continue;
      }
      EXPECT_NEAR(certificate.smallest_fault[j], 0.05 / gains[i][j], 1e-8);
      // 2 (1 - e^(-0.1 k)) > 1 from k = 7 on, and two samples more.
      EXPECT_NEAR(certificate.delay_s[j], 0.09, 1e-12);
      EXPECT_NEAR(certificate.fault_gain[j], gains[i][j], 1e-3);  // a low-pass
      // Of first order: 1/√2 at its corner, up to the sampling.
      EXPECT_NEAR(certificate.band_gain[j], gains[i][j] / std::numbers::sqrt2, 0.01 * gains[i][j]);
    }
  }
}

TEST(Certify, LeavesOnlyRoundingErrorsInTheSampledDomain) {
  for (std::uint64_t seed = 43; seed < 46; ++seed) {
    const CertifyCase random = case_with_everything(test_seed(seed), DesignDomain::kSampled);
    for (const ResidualFilter& filter : random.certified().filters) {
      for (const double gain : filter.certificate.input_gain) {
        EXPECT_LT(gain, 1e-9);
      }
      EXPECT_LT(filter.certificate.disturbance_gain[1], 1e-9);
      EXPECT_GT(filter.certificate.disturbance_gain[0], 1e-3);
    }
  }
}

// Integrators in chain, and an unstable mode; all of them measured.
CertifyCase integrating_case(DesignDomain domain) {
  CertifyCase result;
  MatrixXd A = MatrixXd::Zero(4, 4);
  A(0, 1) = 1.0;  // a double integrator
  A(2, 2) = 2.0;
  A(2, 0) = 0.5;
  A(3, 3) = -1.0;
  A(3, 2) = 1.0;
  MatrixXd B(4, 3);
  B << 0, 0, 1, 1, 0, 0, 0, 1, 0, 0, 0, 1;
  MatrixXd C(4, 4);
  C << 1, 0, 0, 0, 0, 1, 0, 0, 1, 0, 1, 0, 0, 0, 0, 1;
  result.plant = plant_of(A, B, C);
  result.request.name = "integrators";
  result.request.sample_time_s = 0.01;
  result.request.threshold = 0.1;
  result.request.domain = domain;
  for (const double pole : {-5.0, -6.0, -7.0, -8.0}) {
    result.request.poles.emplace_back(domain == DesignDomain::kSampled ? std::exp(0.01 * pole)
                                                                       : pole);
  }
  return result;
}

TEST(Certify, IsRightForUnstableAndIntegratingPlants) {
  for (const DesignDomain domain : kDomains) {
    const CertifyCase integrating = integrating_case(domain);
    const Bank bank = integrating.certified();
    ASSERT_EQ(bank.filters.size(), 3u);
    expect_finite(bank);
    const double exact = domain == DesignDomain::kSampled ? 1e-8 : 1e-2;
    for (const ResidualFilter& filter : bank.filters) {
      for (std::size_t j = 0; j < 3; ++j) {
        SCOPED_TRACE(filter.name);
        const double expected = internal_dc_gain(filter, static_cast<Index>(j));
        EXPECT_NEAR(filter.certificate.dc_gain[j], expected, exact * (1.0 + expected));
        EXPECT_LT(filter.certificate.input_gain[j], exact);
        if (filter.sees[j] == Sensitivity::kNone) {
          EXPECT_LT(filter.certificate.fault_gain[j], exact);
        } else {
          EXPECT_GT(filter.certificate.fault_gain[j], 0.1);
        }
        if (filter.sees[j] == Sensitivity::kSteady) {
          EXPECT_GT(filter.certificate.delay_s[j], 0.0);
        }
      }
    }
  }
}

TEST(Certify, GivesFiniteGainsAtTheResonanceOfAnUndampedPlant) {
  for (const DesignDomain domain : kDomains) {
    CertifyCase oscillator = integrating_case(domain);
    oscillator.plant.A.setZero();
    oscillator.plant.A(0, 1) = 20.0;
    oscillator.plant.A(1, 0) = -20.0;
    oscillator.plant.A(2, 3) = 3.0;
    oscillator.plant.A(3, 2) = -3.0;
    const Bank bank = oscillator.certified();
    ASSERT_FALSE(bank.filters.empty());
    expect_finite(bank);
    for (const ResidualFilter& filter : bank.filters) {
      if (domain == DesignDomain::kSampled) {
        EXPECT_LT(filter.certificate.input_gain[0], 1e-8);
      } else {
        // First-order hold of y is only nearly right, and resonance finds out.
        EXPECT_GT(filter.certificate.input_gain[0], 1e-3);
      }
    }
  }
}

TEST(Certify, TakesFiltersOfOrderZero) {
  PlantModel plant =
      plant_of(-MatrixXd::Identity(1, 1), MatrixXd::Ones(1, 1), MatrixXd::Ones(2, 1));
  plant.faults.push_back({"y1", FaultKind::kSensor, VectorXd::Zero(1), VectorXd::Unit(2, 0), 2.0});
  plant.faults.push_back({"y2", FaultKind::kSensor, VectorXd::Zero(1), VectorXd::Unit(2, 1)});
  CertifyCase twins{plant, {}};
  twins.request.poles = {-5.0};
  twins.request.sample_time_s = 0.01;
  twins.request.threshold = 0.1;
  twins.request.normalise = false;
  const Bank bank = twins.certified();
  const FilterCertificate& certificate =
      bank.filters.front().certificate;  // r = y1 - y2, of norm 1
  ASSERT_EQ(bank.filters.front().F.rows(), 0);
  EXPECT_EQ(certificate.spectral_radius, 0.0);
  EXPECT_NEAR(certificate.band_Hz, 50.0, 1e-9);  // Nyquist
  EXPECT_LT(certificate.fault_gain[0], 1e-12);
  EXPECT_NEAR(certificate.dc_gain[1], 2.0 / std::numbers::sqrt2, 1e-12);
  EXPECT_NEAR(certificate.fault_gain[2], 1.0 / std::numbers::sqrt2, 1e-12);
  EXPECT_NEAR(certificate.smallest_fault[2], 0.1 * std::numbers::sqrt2, 1e-12);
  EXPECT_NEAR(certificate.delay_s[2], 0.02, 1e-12);  // at once, and two samples of dwell more
}

TEST(Certify, TakesPlantsWithoutInputs) {
  CertifyCase random = random_case(test_seed(47), 4, 2, 4, 1, DesignDomain::kContinuous);
  PlantModel& plant = random.plant;
  plant.B = MatrixXd(4, 0);
  plant.D = MatrixXd(4, 0);
  plant.input_names.clear();
  plant.input_range = VectorXd(0);
  plant.u_operating = VectorXd(0);
  const Bank bank = random.certified();
  ASSERT_FALSE(bank.filters.empty());
  expect_finite(bank);
  EXPECT_TRUE(bank.filters.front().certificate.input_gain.empty());
}

TEST(Certify, TakesUnobservableModesOfAnyKind) {
  for (const double mode : {-1.0, 0.0, 3.0}) {
    CertifyCase random = random_case(test_seed(48), 4, 2, 4, 1, DesignDomain::kSampled);
    PlantModel& plant = random.plant;
    plant.state_names.emplace_back("hidden");
    plant.A.conservativeResizeLike(MatrixXd::Zero(5, 5));
    plant.A(4, 4) = mode;
    plant.B.conservativeResizeLike(MatrixXd::Ones(5, 2));
    plant.C.conservativeResizeLike(MatrixXd::Zero(4, 5));
    plant.x_operating = VectorXd::Zero(5);
    for (Index j = 0; j < 2; ++j) {
      plant.faults[static_cast<std::size_t>(j)].state = plant.B.col(j);
    }
    random.request.poles.emplace_back(0.9);
    const Bank bank = random.certified();
    ASSERT_FALSE(bank.filters.empty());
    expect_finite(bank);
    for (const ResidualFilter& filter : bank.filters) {
      EXPECT_LT(filter.certificate.input_gain[0], 1e-9);
      EXPECT_GT(filter.certificate.dc_gain[filter.ignores[0] == 0 ? 1 : 0], 0.1);
    }
  }
}

TEST(Certify, DependsOnTheUnitsOfTheStatesOnlyAsItMust) {
  // Gains do not depend on state coordinates at all.
  const CertifyCase random = random_case(test_seed(49), 5, 2, 4, 1, DesignDomain::kContinuous);
  Bank bank = random.certified();
  PlantModel scaled = random.plant;
  const VectorXd scales = (VectorXd(5) << 1e12, 1e-12, 1.0, 1e4, 1e-4).finished();
  scaled.A = scales.asDiagonal() * random.plant.A * scales.cwiseInverse().asDiagonal();
  scaled.B = scales.asDiagonal() * random.plant.B;
  scaled.C = random.plant.C * scales.cwiseInverse().asDiagonal();
  for (Index j = 0; j < 2; ++j) {
    scaled.faults[static_cast<std::size_t>(j)].state = scaled.B.col(j);
  }
  Bank again = bank;
  certify(scaled, again);
  expect_finite(again);
  for (std::size_t i = 0; i < bank.filters.size(); ++i) {
    const FilterCertificate& a = bank.filters[i].certificate;
    const FilterCertificate& b = again.filters[i].certificate;
    EXPECT_EQ(a.rank.dim_w, b.rank.dim_w);
    EXPECT_EQ(a.rank.dim_s, b.rank.dim_s);
    for (std::size_t j = 0; j < 2; ++j) {
      EXPECT_NEAR(a.fault_gain[j], b.fault_gain[j], 1e-9 * (1.0 + a.fault_gain[j]));
      EXPECT_NEAR(a.dc_gain[j], b.dc_gain[j], 1e-9 * (1.0 + a.dc_gain[j]));
      EXPECT_DOUBLE_EQ(a.delay_s[j], b.delay_s[j]);
    }
  }
}

TEST(Certify, TakesInputsAndOutputsInAnyUnit) {
  for (const double unit : {1e-12, 1e12}) {
    CertifyCase random = random_case(test_seed(50), 5, 2, 4, 1, DesignDomain::kContinuous);
    random.plant.B.col(0) *= unit;
    random.plant.faults[0].state *= unit;
    random.plant.faults[0].size = 1.0 / unit;
    const Bank bank = random.certified();
    ASSERT_EQ(bank.filters.size(), 2u);
    expect_finite(bank);
    EXPECT_NEAR(bank.filters[1].certificate.dc_gain[0], 1.0, 1e-6);
    EXPECT_NEAR(bank.filters[1].certificate.smallest_fault[0], 0.5 / unit, 1e-6 / unit);
  }
}

TEST(Certify, TakesTheGainOfAConstantDisturbanceAtDcOnly) {
  const CertifyCase random = case_with_everything(test_seed(51), DesignDomain::kContinuous);
  Bank bank = random.designed();
  certify(random.plant, bank);
  const double everywhere = bank.filters[0].certificate.disturbance_gain[0];
  bank.disturbances[0].treatment = BankDisturbance::Treatment::kConstant;
  certify(random.plant, bank);
  SampledPlant plant(random.plant, bank, spectral_radius(bank.filters[0].F));
  const double at_dc = FilterLoop(plant, bank.filters[0]).at(0.0).gain[3 + 4 + 0];
  EXPECT_DOUBLE_EQ(bank.filters[0].certificate.disturbance_gain[0], at_dc);
  EXPECT_LE(at_dc, everywhere);
}

TEST(Certify, IsTheSameEachTime) {
  const CertifyCase random = random_case(test_seed(52), 6, 3, 5, 1, DesignDomain::kContinuous);
  Bank bank = random.certified();
  const Bank first = bank;
  certify(random.plant, bank);
  for (std::size_t i = 0; i < bank.filters.size(); ++i) {
    EXPECT_EQ(bank.filters[i].certificate.fault_gain, first.filters[i].certificate.fault_gain);
    EXPECT_EQ(bank.filters[i].certificate.margin, first.filters[i].certificate.margin);
  }
}

TEST(Certify, RefusesWhatItCannotProve) {
  const PlantModel plant = hou_plant();
  Bank bank = hou_bank();
  bank.fault_names.pop_back();
  EXPECT_THAT(refusal(plant, bank), HasSubstr("3 faults, expected the plant's 4"));
  bank = hou_bank();
  bank.filters[2].F(0, 0) = 1.5;
  EXPECT_THAT(refusal(plant, bank), HasSubstr("residual r14: spectral radius 1.5"));
  PlantModel wild = plant;
  wild.A *= 1e300;
  EXPECT_THAT(refusal(wild, hou_bank()), HasSubstr("not finite"));
  PlantModel discrete = plant;
  discrete.time = TimeDomain::kDiscrete;
  discrete.sample_time_s = 0.5;
  EXPECT_THAT(refusal(discrete, hou_bank()), HasSubstr("sample time is 0.01 s, expected"));
}

}  // namespace
}  // namespace faultline
