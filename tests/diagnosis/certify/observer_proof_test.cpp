#include "diagnosis/certify/observer_proof.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "diagnosis/certify/certify.h"
#include "diagnosis/certify/check.h"
#include "tests/diagnosis/certify/observer_cases.h"
#include "tests/diagnosis/certify/observer_simulation.h"
#include "tests/support/random_seed.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using Sample = ObserverSimulation::Sample;

struct Certified {
  std::string name;
  PlantModel plant;
  Bank bank;
};

std::vector<Certified> certified_observers() {
  std::vector<Certified> all = {{"detection", joint_plant(), ObserverCase::detection().bank()},
                                {"combined", joint_plant(), ObserverCase::combined().bank()},
                                {"estimator", joint_plant(), ObserverCase::estimator().bank()},
                                {"tanh", tanh_plant(), tanh_bank()}};
  for (Certified& one : all) certify(one.plant, one.bank);
  return all;
}

VectorXd component_at(const ResidualFilter& filter, std::size_t k) {
  const MatrixXd& course = filter.course->component;
  return course.row(std::min(static_cast<Index>(k), course.rows() - 1)).transpose();
}

double norm_at(const ResidualFilter& filter, std::size_t k) {
  const VectorXd& course = filter.course->norm;
  return course[std::min(static_cast<Index>(k), course.size() - 1)];
}

// Room for the rounding errors of a few hundred steps.
constexpr double kRounding = 1e-9;

void for_each_filter(
    const std::function<void(const Certified&, const ResidualFilter&, ObserverSimulation&)>& run) {
  for (const Certified& one : certified_observers()) {
    for (const ResidualFilter& filter : one.bank.filters) {
      SCOPED_TRACE(one.name + " " + filter.name);
      ObserverSimulation simulation(one.plant, one.bank, filter);
      run(one, filter, simulation);
    }
  }
}

TEST(ObserverProof, NoRandomCourseCrossesItsThresholds) {
  SCOPED_TRACE(seed_message(test_seed(300)));
  std::mt19937_64 engine(test_seed(300));
  for_each_filter(
      [&](const Certified&, const ResidualFilter& filter, ObserverSimulation& simulation) {
        for (int run = 0; run < 1000; ++run) {
          simulation.start(simulation.random_state(engine));
          for (std::size_t k = 0; k < 60; ++k) {
            const VectorXd r = simulation.step(simulation.random_sample(engine));
            const VectorXd limit = component_at(filter, k);
            ASSERT_LE((r.cwiseAbs() - (1.0 + kRounding) * limit).maxCoeff(), 0.0)
                << "run " << run << ", sample " << k;
            if (filter.course->norm.size() > 0) {
              ASSERT_LE((filter.course->weight * r).norm(), (1.0 + kRounding) * norm_at(filter, k));
            }
          }
        }
      });
}

TEST(ObserverProof, TheWorstCourseReachesItsThresholdsButForAFewPercent) {
  for_each_filter(
      [&](const Certified& one, const ResidualFilter& filter, ObserverSimulation& simulation) {
        const auto samples = static_cast<std::size_t>(filter.course->component.rows()) + 20;
        for (Index row = 0; row < filter.H.rows(); ++row) {
          const WorstCourse worst = worst_course(one.plant, one.bank, filter, row, samples);
          simulation.start(worst.x);
          VectorXd r;
          for (std::size_t k = 0; k < samples; ++k) {
            r = simulation.step(worst.samples[k]);
            ASSERT_LE((r.cwiseAbs() - (1.0 + kRounding) * component_at(filter, k)).maxCoeff(), 0.0)
                << "row " << row << ", sample " << k;
          }
          // Small gain counts every Lipschitz term at its worst, whatever their signs.
          EXPECT_GE(std::abs(r[row]), 0.94 * component_at(filter, samples)[row]) << "row " << row;
          if (filter.name == "output") {
            EXPECT_GE(std::abs(r[row]), 0.95 * component_at(filter, samples)[row]) << "row " << row;
          }
        }
      });
}

TEST(ObserverProof, WithoutLipschitzTermsTheWorstCourseReachesTheLimitExactly) {
  for (Certified one : certified_observers()) {
    for (Nonlinearity& term : one.plant.nonlinearities) {
      term.slope_min = term.slope_max = 0.5 * (term.slope_min + term.slope_max);
    }
    for (const ResidualFilter& filter : one.bank.filters) {
      SCOPED_TRACE(one.name + " " + filter.name);
      ResidualFilter linear = filter;
      linear.observer->P.resize(0, 0);
      const ObserverThresholds found = observer_thresholds(one.plant, one.bank, linear);
      const auto samples = static_cast<std::size_t>(found.component.rows()) + 1;
      ObserverSimulation simulation(one.plant, one.bank, linear);
      for (Index row = 0; row < filter.H.rows(); ++row) {
        const WorstCourse worst = worst_course(one.plant, one.bank, linear, row, samples);
        simulation.start(worst.x);
        VectorXd r;
        for (const Sample& sample : worst.samples) r = simulation.step(sample);
        EXPECT_NEAR(std::abs(r[row]), found.component_limit[row],
                    kRounding * found.component_limit[row]);
      }
    }
  }
}

TEST(ObserverProof, AfterTheStartItsThresholdsAreAtMostTwiceTheWorstCourse) {
  for_each_filter(
      [&](const Certified& one, const ResidualFilter& filter, ObserverSimulation& simulation) {
        for (const std::size_t samples : {std::size_t{3}, std::size_t{8}}) {
          for (Index row = 0; row < filter.H.rows(); ++row) {
            const WorstCourse worst = worst_course(one.plant, one.bank, filter, row, samples);
            simulation.start(worst.x);
            VectorXd r;
            for (const Sample& sample : worst.samples) r = simulation.step(sample);
            const double limit = component_at(filter, samples - 1)[row];
            EXPECT_LE(std::abs(r[row]), (1.0 + kRounding) * limit);
            // The start and the first noise count apart, though they may cancel.
            EXPECT_LE(limit, 2.0 * std::abs(r[row])) << "row " << row << ", sample " << samples - 1;
          }
        }
      });
}

TEST(ObserverProof, AConstantFaultIsWithinTheBoundOfItsEstimateOnceThatHasSettled) {
  SCOPED_TRACE(seed_message(test_seed(301)));
  std::mt19937_64 engine(test_seed(301));
  int count = 0;
  for_each_filter(
      [&](const Certified& one, const ResidualFilter& filter, ObserverSimulation& simulation) {
        if (!filter.estimation) return;
        ++count;
        const FaultEstimation& claim = *filter.estimation;
        const auto onset = static_cast<std::size_t>(filter.course->component.rows());
        const double size = one.plant.faults[claim.fault].size;
        for (const double part : {10.0, -10.0, 3.0, 0.1}) {
          // Up to the onset the worst course of the healthy plant, then any.
          const WorstCourse worst = worst_course(one.plant, one.bank, filter, 0, onset + 1);
          simulation.start(worst.x);
          for (std::size_t k = 0; k < onset + claim.settle_samples + 100; ++k) {
            Sample sample = k < onset ? worst.samples[k] : simulation.random_sample(engine);
            if (k >= onset) sample.fault[static_cast<Index>(claim.fault)] = part * size;
            const double r = simulation.step(sample)[0];
            if (k >= onset + claim.settle_samples) {
              ASSERT_LE(std::abs(r - part * size), claim.bound) << k - onset << " samples later";
            }
          }
        }
      });
  EXPECT_EQ(count, 3);
}

// The part of the residual that comes from a fault alone, sample by sample; slopes at random.
std::vector<VectorXd> response_to(ObserverSimulation& simulation, Index fault, double size,
                                  std::size_t samples, std::mt19937_64& engine) {
  simulation.start(0.0 * simulation.random_state(engine));
  std::vector<VectorXd> response;
  for (std::size_t k = 0; k < samples; ++k) {
    Sample sample = simulation.random_sample(engine);
    sample.unknown.setZero();
    sample.fault[fault] = size;
    response.push_back(simulation.step(sample));
  }
  return response;
}

TEST(ObserverProof, AFaultSeenInTransientsAddsLittleToTheResidualAfterItsTime) {
  SCOPED_TRACE(seed_message(test_seed(302)));
  std::mt19937_64 engine(test_seed(302));
  int count = 0;
  for_each_filter(
      [&](const Certified& one, const ResidualFilter& filter, ObserverSimulation& simulation) {
        if (filter.transient_samples == 0) return;
        ++count;
        const std::size_t fault = 1;
        ASSERT_EQ(filter.sees[fault], Sensitivity::kTransient);
        const VectorXd limit = component_at(filter, 1'000'000);
        double before = 0.0;
        for (int run = 0; run < 20; ++run) {
          const std::vector<VectorXd> r =
              response_to(simulation, 1, 10.0 * one.plant.faults[fault].size,
                          filter.transient_samples + 100, engine);
          for (std::size_t k = 0; k < r.size(); ++k) {
            const double part = r[k].cwiseAbs().cwiseQuotient(limit).maxCoeff();
            if (k >= filter.transient_samples) {
              ASSERT_LE(part, 0.05) << k;
            } else if (k + 1 == filter.transient_samples) {
              before = std::max(before, part);
            }
          }
        }
        EXPECT_GE(before, 0.02) << "the time given is much longer than needed";
      });
  EXPECT_EQ(count, 2);
}

TEST(ObserverProof, SaysNothingOfTransientsThatTheSlopesMayKeepAlive) {
  Bank bank = ObserverCase::estimator().bank();
  certify(joint_plant(), bank);
  ASSERT_EQ(bank.filters[0].sees[0], Sensitivity::kTransient);
  EXPECT_EQ(bank.filters[0].transient_samples, 0u);
}

TEST(ObserverProof, ABadSampleIsForgottenWhenItSays) {
  SCOPED_TRACE(seed_message(test_seed(303)));
  std::mt19937_64 engine(test_seed(303));
  for_each_filter(
      [&](const Certified& one, const ResidualFilter& filter, ObserverSimulation& simulation) {
        const VectorXd limit = component_at(filter, 1'000'000);
        for (int run = 0; run < 50; ++run) {
          simulation.start(VectorXd::Zero(one.plant.n()));
          VectorXd error = one.plant.output_range;
          for (double& value : error) value *= engine() % 2 == 0 ? 1.0 : -1.0;
          for (std::uint32_t k = 0; k < filter.forget_samples + 50; ++k) {
            Sample sample = simulation.random_sample(engine);
            sample.unknown.setZero();
            const VectorXd r = simulation.step(sample, k == 0 ? error : VectorXd());
            if (k < filter.forget_samples) continue;
            ASSERT_LE(r.cwiseAbs().cwiseQuotient(limit).maxCoeff(), 0.01) << k;
          }
        }
      });
}

TEST(ObserverProof, WithoutLipschitzTermsABadSampleIsForgottenWhenOnePercentIsLeftOfIt) {
  for (Certified one : certified_observers()) {
    for (Nonlinearity& term : one.plant.nonlinearities) {
      term.slope_min = term.slope_max = 0.5 * (term.slope_min + term.slope_max);
    }
    for (ResidualFilter& filter : one.bank.filters) {
      SCOPED_TRACE(one.name + " " + filter.name);
      filter.observer->P.resize(0, 0);
      for (FilterNonlinearity& term : filter.nonlinearities) term.radius = 0.0;
      const ObserverProof proof = prove_observer(one.plant, one.bank, filter);
      const VectorXd limit = proof.thresholds.component_limit;
      const VectorXd left = filter.E.cwiseAbs() * one.plant.output_range +
                            filter.G.cwiseAbs() * one.plant.input_range;
      std::uint32_t last = 0;
      MatrixXd seen = filter.M;
      for (std::uint32_t i = 1; i < 5000; ++i) {
        const VectorXd rows = seen.cwiseAbs() * left;
        if (rows.cwiseQuotient(limit).maxCoeff() > 0.01) last = i;
        seen = (seen * filter.F).eval();
      }
      EXPECT_EQ(proof.forget.value, last + 1);
    }
  }
}

TEST(ObserverProof, SmallestFaultsAndDelaysCountByTheFiltersOwnEvaluation) {
  std::vector<Certified> observers = certified_observers();
  Certified by_norm{"norm", joint_plant(), ObserverCase::detection().bank()};
  by_norm.bank.filters[0].evaluation = Evaluation::kNorm;
  certify(by_norm.plant, by_norm.bank);
  observers.push_back(by_norm);
  int count = 0;
  for (const Certified& one : observers) {
    for (const ResidualFilter& filter : one.bank.filters) {
      const auto evaluate = [&](const VectorXd& r) {
        return filter.evaluation == Evaluation::kNorm
                   ? r.norm()
                   : r.cwiseAbs().cwiseQuotient(component_at(filter, 1'000'000)).maxCoeff();
      };
      for (std::size_t j = 0; j < one.plant.faults.size(); ++j) {
        if (filter.sees[j] != Sensitivity::kSteady) continue;
        SCOPED_TRACE(one.name + " " + filter.name + " " + one.plant.faults[j].name);
        ++count;
        ObserverSimulation simulation(one.plant, one.bank, filter);
        std::mt19937_64 engine;
        Sample sample = simulation.random_sample(engine);
        sample.unknown.setZero();
        sample.fault[static_cast<Index>(j)] = 1.0;
        const Nonlinearity& term = one.plant.nonlinearities[0];
        sample.slope.setConstant(0.5 * (term.slope_min + term.slope_max));
        std::vector<double> values;
        for (int k = 0; k < 3000; ++k) values.push_back(evaluate(simulation.step(sample)));
        const double smallest = filter.threshold / values.back();
        EXPECT_NEAR(filter.certificate.smallest_fault[j], smallest, 1e-8 * smallest);
        std::uint32_t exceeded = 0;
        std::size_t k = 0;
        while (exceeded < one.bank.decision.dwell) {
          exceeded = 2.0 * smallest * values[k++] > filter.threshold ? exceeded + 1 : 0;
        }
        EXPECT_NEAR(filter.certificate.delay_s[j], 0.01 * static_cast<double>(k - 1), 1e-12);
      }
    }
  }
  EXPECT_EQ(count, 12);
}

TEST(ObserverProof, NothingHidesAFaultOfTheGuaranteedSize) {
  int count = 0;
  for_each_filter(
      [&](const Certified& one, const ResidualFilter& filter, ObserverSimulation& simulation) {
        const std::size_t samples = 2 * static_cast<std::size_t>(filter.course->component.rows());
        const VectorXd limit = component_at(filter, 1'000'000);
        for (std::size_t j = 0; j < one.plant.faults.size(); ++j) {
          const double size = filter.observer->guaranteed_fault[j];
          EXPECT_EQ(size, 2.0 * filter.observer->nominal_fault[j]);
          if (size == 0.0) continue;
          ++count;
          for (const bool is_largest : {false, true}) {
            // Noise that works against the fault's own sign in every row.
            for (Index row = 0; row < filter.H.rows(); ++row) {
              WorstCourse worst = worst_course(one.plant, one.bank, filter, row, samples);
              for (const double sign : {-1.0, 1.0}) {
                simulation.start(sign * worst.x);
                VectorXd r;
                for (Sample sample : worst.samples) {
                  const Nonlinearity& term = one.plant.nonlinearities[0];
                  sample.unknown *= sign;
                  sample.fault[static_cast<Index>(j)] = (1.0 + kRounding) * size;
                  sample.slope[0] = is_largest ? term.slope_max : term.slope_min;
                  r = simulation.step(sample);
                }
                EXPECT_GE(r.cwiseAbs().cwiseQuotient(limit).maxCoeff(), 1.0)
                    << one.plant.faults[j].name << " against row " << row;
              }
            }
          }
        }
      });
  EXPECT_EQ(count, 10);
}

TEST(ObserverProof, HasTheFiguresOfTheOracle) {
  const ObserverCase oracle = ObserverCase::detection();
  Bank bank = oracle.bank();
  const ObserverProof proof = prove_observer(joint_plant(), bank, bank.filters[0]);
  // Corner 1 is +δ E_o with gain·slope up; the oracle counts from +Λ.
  const MatrixXd radius = oracle.matrix("checks/spectral_radius_vertices");
  std::vector<double> found = proof.vertex_radius;
  std::sort(found.begin(), found.end(), std::greater<>());
  EXPECT_NEAR(found[0], radius.maxCoeff(), 1e-8);
  EXPECT_NEAR(found[1], radius.minCoeff(), 1e-8);
  const double beta = oracle.matrix("checks/beta_grid_vertices").minCoeff();
  EXPECT_NEAR(*proof.beta, beta, 1e-6 * beta);
  EXPECT_NEAR(proof.nominal_fault[0], 0.029, 5e-4);
  bank = ObserverCase::combined().bank();
  EXPECT_NEAR(prove_observer(joint_plant(), bank, bank.filters[0]).nominal_fault[0], 0.034, 5e-4);
}

}  // namespace
}  // namespace faultline
