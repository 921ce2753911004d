#include "diagnosis/design/uio/observer_synthesis.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <thread>

#include <Eigen/Eigenvalues>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/diagnosis/design/uio/observer_oracle.h"
#include "tests/diagnosis/design/uio/random_observer_model.h"
#include "tests/support/eigenvalues.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr const char* kDetection = "paper_detection_UIO";
constexpr const char* kCombined = "paper_combined_noDecoupling";
constexpr const char* kInfeasible = "paper_augmented_UIO_ry_low_band_INFEASIBLE";
constexpr const char* kEstimator = "paper_sensor_fault_estimator_UIO";

ObserverSynthesis synthesise(const ObserverOracle& oracle,
                             ResidualWeight weight = ResidualWeight::kScalar) {
  return synthesise_observer(oracle.model, oracle.decoupling, oracle.output, oracle.alpha,
                             oracle.band, oracle.reference, weight);
}

double spectral_radius_of(const MatrixXd& A) {
  double radius = 0.0;
  for (const auto& lambda : sorted_eigenvalues(A)) radius = std::max(radius, std::abs(lambda));
  return radius;
}

/// Largest eigenvalue of the symmetric M, of its rows and columns that are not zero, scaled to
/// ones on the diagonal: negative iff M is negative semidefinite, definite but for those.
double largest_scaled_eigenvalue(const MatrixXd& M) {
  std::vector<Index> kept;
  for (Index i = 0; i < M.rows(); ++i) {
    if (!M.row(i).isZero(1e-13 * M.norm())) kept.push_back(i);
  }
  const MatrixXd some = M(kept, kept);
  const VectorXd D = some.diagonal().cwiseAbs().cwiseSqrt().cwiseInverse();
  const MatrixXd scaled = D.asDiagonal() * some * D.asDiagonal();
  return Eigen::SelfAdjointEigenSolver<MatrixXd>(scaled, Eigen::EigenvaluesOnly)
      .eigenvalues()
      .maxCoeff();
}

MatrixXd stacked_diagonal(const MatrixXd& P, const VectorXd& mu) {
  MatrixXd stacked = MatrixXd::Zero(P.rows() + mu.size(), P.rows() + mu.size());
  stacked.topLeftCorner(P.rows(), P.rows()) = P;
  stacked.bottomRightCorner(mu.size(), mu.size()) = mu.asDiagonal();
  return stacked;
}

/// The quadratic bound of bank.h, from the equations of the error.
void expect_bound_holds(const ObserverModel& model, const DecouplingMatrices& decoupling,
                        const ObserverOutput& output, const ObserverSynthesis& observer) {
  ASSERT_EQ(observer.status, SynthesisStatus::kSolved) << observer.reason;
  const Index n = model.n();
  const Index s = model.M.cols();
  const MatrixXd& gain = observer.gain;
  VectorXd mu(2 * s);
  mu << observer.mu_now, observer.mu_next;
  for (Index vertex = 0; vertex < model.vertex_count(); ++vertex) {
    MatrixXd AB(n, n + 2 * s);
    AB << decoupling.S * (model.A + model.vertex(vertex)) - gain * model.C,
        decoupling.S * model.M - gain * model.W, -decoupling.T * model.W;
    const MatrixXd right =
        stacked_diagonal(observer.alpha * observer.P, (1.0 - observer.alpha) * mu);
    EXPECT_LT(largest_scaled_eigenvalue(AB.transpose() * observer.P * AB - right), 0.0);
    EXPECT_LT(spectral_radius_of(AB.leftCols(n)), std::sqrt(observer.alpha));
  }
  MatrixXd RQ(output.R.rows(), n + s);
  RQ << output.R, output.Q;
  RQ = observer.weight * RQ;
  EXPECT_LT(largest_scaled_eigenvalue(RQ.transpose() * RQ -
                                      stacked_diagonal(observer.P, observer.mu_direct)),
            0.0);
  const VectorXd squares = model.w_bound.cwiseAbs2();
  EXPECT_NEAR(observer.tau, squares.dot(observer.mu_now + observer.mu_next + observer.mu_direct),
              1e-12 * observer.tau);
  EXPECT_GE(std::min({observer.mu_now.minCoeff(), observer.mu_next.minCoeff(),
                      observer.mu_direct.minCoeff()}),
            0.0);
}

/// β is no more than what the fault really does at constant Λ.
void expect_sensitive(const ObserverOracle& oracle, const ObserverSynthesis& observer) {
  ASSERT_EQ(observer.status, SynthesisStatus::kSolved) << observer.reason;
  const auto on_grid = h_minus_on_grid(oracle.model, oracle.decoupling, oracle.output,
                                       observer.gain, observer.weight, oracle.band, 1000);
  ASSERT_EQ(on_grid.size(), 2U);
  for (const double beta : on_grid) EXPECT_GE(beta, observer.beta);
  EXPECT_GT(observer.beta, 0.0);
}

class OracleSynthesis : public testing::TestWithParam<const char*> {};

TEST_P(OracleSynthesis, FindsTheKnownOptimum) {
  const ObserverOracle oracle = observer_oracle(GetParam());
  const ObserverSynthesis observer = synthesise(oracle);
  ASSERT_EQ(observer.status, SynthesisStatus::kSolved) << observer.reason;
  EXPECT_NEAR(observer.objective / oracle.objective, 1.0, 1e-4);
  EXPECT_NEAR(std::sqrt(observer.tau) / observer.beta, observer.objective,
              1e-12 * observer.objective);
}

TEST_P(OracleSynthesis, ProvesWhatItSays) {
  const ObserverOracle oracle = observer_oracle(GetParam());
  if (oracle.decoupling.D_1.cols() > 0) {
    ASSERT_LT((oracle.decoupling.S * oracle.decoupling.D_1).norm(), 1e-15);
  }
  const ObserverSynthesis observer = synthesise(oracle);
  expect_bound_holds(oracle.model, oracle.decoupling, oracle.output, observer);
  expect_sensitive(oracle, observer);
  EXPECT_EQ(observer.weight, MatrixXd::Identity(3, 3));
}

TEST_P(OracleSynthesis, IsNoWorseWithAFullWeight) {
  const ObserverOracle oracle = observer_oracle(GetParam());
  const ObserverSynthesis observer = synthesise(oracle, ResidualWeight::kFull);
  expect_bound_holds(oracle.model, oracle.decoupling, oracle.output, observer);
  expect_sensitive(oracle, observer);
  EXPECT_LT(observer.objective, oracle.objective);
  EXPECT_NEAR((observer.weight.transpose() * observer.weight).trace(), 3.0, 1e-12);
}

TEST_P(OracleSynthesis, AnalysesTheKnownGain) {
  const ObserverOracle oracle = observer_oracle(GetParam());
  const ObserverSynthesis bound =
      analyse_observer(oracle.model, oracle.decoupling, oracle.output, oracle.gain, oracle.alpha,
                       MatrixXd::Identity(3, 3));
  expect_bound_holds(oracle.model, oracle.decoupling, oracle.output, bound);
  EXPECT_NEAR(bound.objective / oracle.J_th, 1.0, 1e-4);
}

TEST_P(OracleSynthesis, AnalysisIsNoWorseThanSynthesis) {
  const ObserverOracle oracle = observer_oracle(GetParam());
  const ObserverSynthesis observer = synthesise(oracle);
  const ObserverSynthesis bound = analyse_observer(oracle.model, oracle.decoupling, oracle.output,
                                                   observer.gain, oracle.alpha, observer.weight);
  expect_bound_holds(oracle.model, oracle.decoupling, oracle.output, bound);
  EXPECT_LT(bound.tau, observer.tau);
  EXPECT_EQ(bound.beta, 0.0);
}

INSTANTIATE_TEST_SUITE_P(FlexibleJoint, OracleSynthesis, testing::Values(kDetection, kCombined),
                         [](const auto& tested) { return std::string(tested.param); });

TEST(ObserverSynthesis, SaysThatNoResidualSeesAFaultThatAnEstimateImitates) {
  ObserverOracle oracle = observer_oracle(kInfeasible);
  for (const double v : {1.0, 50.0}) {
    oracle.reference = {-0.05, -v * oracle.model.F_x};
    const ObserverSynthesis observer = synthesise(oracle);
    EXPECT_EQ(observer.status, SynthesisStatus::kInfeasible) << observer.reason;
    EXPECT_EQ(observer.gain.size(), 0);
  }
}

TEST(ObserverSynthesis, EstimatesASensorFaultAsWellAsTheKnownGain) {
  const ObserverOracle oracle = observer_oracle(kEstimator);
  const ObserverSynthesis observer =
      synthesise_observer(oracle.model, oracle.decoupling, oracle.output, oracle.alpha,
                          std::nullopt, {}, ResidualWeight::kScalar);
  expect_bound_holds(oracle.model, oracle.decoupling, oracle.output, observer);
  EXPECT_EQ(observer.beta, 0.0);
  EXPECT_EQ(observer.weight, MatrixXd::Identity(1, 1));
  const ObserverSynthesis known =
      analyse_observer(oracle.model, oracle.decoupling, oracle.output, oracle.gain, oracle.alpha,
                       MatrixXd::Identity(1, 1));
  expect_bound_holds(oracle.model, oracle.decoupling, oracle.output, known);
  EXPECT_NEAR(observer.objective / known.objective, 1.0, 1e-3);
}

TEST(ObserverSynthesis, GivesNoMultiplierToWhatDoesNotEnter) {
  const ObserverOracle oracle = observer_oracle(kCombined);
  const ObserverSynthesis observer = synthesise(oracle);
  ASSERT_EQ(observer.status, SynthesisStatus::kSolved);
  // T = 0: nothing enters a sample late. Only the noise reaches the residual at once.
  EXPECT_EQ(observer.mu_next, VectorXd::Zero(5));
  EXPECT_EQ(observer.mu_direct.head(4), VectorXd::Zero(4));
  EXPECT_GT(observer.mu_direct[4], 0.0);
  EXPECT_GT(observer.mu_now.minCoeff(), 0.0);
}

TEST(ObserverSynthesis, DoesNotSeeADisturbanceThatIsDecoupled) {
  ObserverOracle oracle = observer_oracle(kDetection);
  const double without = synthesise(oracle).objective;
  const MatrixXd D = oracle.decoupling.D_1;
  ObserverModel& model = oracle.model;
  model.M = (MatrixXd(4, 3) << model.M, D).finished();
  model.W = (MatrixXd(3, 3) << model.W, MatrixXd::Zero(3, 2)).finished();
  model.w_bound = VectorXd{{model.w_bound[0], 1e3, 1e3}};
  oracle.output = output_error(model);
  const ObserverSynthesis observer = synthesise(oracle);
  EXPECT_EQ(observer.mu_now.tail(2), VectorXd::Zero(2));
  EXPECT_NEAR(observer.objective / without, 1.0, 1e-5);
}

TEST(ObserverSynthesis, DoesNotDependOnTheUnitsOfTheStates) {
  ObserverOracle oracle = observer_oracle(kCombined);
  const double expected = synthesise(oracle).objective;
  const VectorXd unit{{1e-2, 1e2, 10.0, 1e-2, 1.0}};  // x = unit·x'
  const VectorXd inverse = unit.cwiseInverse();
  ObserverModel& model = oracle.model;
  model.A = inverse.asDiagonal() * model.A * unit.asDiagonal();
  model.M = inverse.asDiagonal() * model.M;
  model.F_x = inverse.asDiagonal() * model.F_x;
  model.E_o = inverse.asDiagonal() * model.E_o;
  model.C = model.C * unit.asDiagonal();
  model.E_i = model.E_i * unit.asDiagonal();
  model.x_bound = inverse.cwiseProduct(model.x_bound);
  oracle.output = output_error(model);
  oracle.reference.V = inverse.asDiagonal() * oracle.reference.V;
  const ObserverSynthesis observer = synthesise(oracle);
  expect_bound_holds(oracle.model, oracle.decoupling, oracle.output, observer);
  EXPECT_NEAR(observer.objective / expected, 1.0, 1e-3);
}

TEST(ObserverSynthesis, IsProportionalToBoundsAndFaultSizes) {
  for (const char* name : {kDetection, kEstimator}) {
    ObserverOracle oracle = observer_oracle(name);
    std::optional<FrequencyBand> band;
    if (name == kDetection) band = oracle.band;
    const auto objective = [&] {
      const ObserverSynthesis observer =
          synthesise_observer(oracle.model, oracle.decoupling, oracle.output, oracle.alpha, band,
                              oracle.reference, ResidualWeight::kScalar);
      expect_bound_holds(oracle.model, oracle.decoupling, oracle.output, observer);
      return observer.objective;
    };
    const double usual = objective();
    oracle.model.w_bound *= 1e-4;
    EXPECT_NEAR(objective() / usual, 1e-4, 1e-7) << name;
    oracle.model.F_x *= 1e3;
    oracle.reference.V *= 1e3;
    if (band) {
      EXPECT_NEAR(objective() / usual, 1e-7, 1e-10) << name;
    }
  }
}

TEST(ObserverSynthesis, TakesASensorFaultThroughItsDirectPart) {
  ObserverOracle oracle = observer_oracle(kDetection);
  oracle.decoupling = {MatrixXd::Zero(4, 3), MatrixXd::Identity(4, 4), MatrixXd(4, 0)};
  oracle.model.F_x = MatrixXd::Zero(4, 1);
  oracle.model.F_y = MatrixXd::Identity(3, 1);
  oracle.model.M = 0.01 * MatrixXd::Ones(4, 3);
  oracle.model.W = 0.1 * MatrixXd::Identity(3, 3);
  oracle.model.w_bound = VectorXd::Constant(3, 0.1);
  oracle.output = output_error(oracle.model);
  // The reference sees it at once: J alone.
  oracle.reference = {0.5, MatrixXd::Zero(4, 1)};
  const ObserverSynthesis observer = synthesise(oracle);
  expect_bound_holds(oracle.model, oracle.decoupling, oracle.output, observer);
  expect_sensitive(oracle, observer);
}

TEST(ObserverSynthesis, AsksForSensitivityInTheBandAlone) {
  RandomNumbers random(11);
  const ObserverModel model = random_observer_model(random, 3, 2, 1);
  const DecouplingMatrices none = no_decoupling(model);
  const ObserverOutput output = output_error(model);
  const ReferenceSystem reference{0.0, -3.0 * model.F_x};
  double full = 0.0;
  for (const FrequencyBand band : {FrequencyBand{0.0, std::numbers::pi}, FrequencyBand{0.0, 0.5},
                                   FrequencyBand{1.0, 1.5}, FrequencyBand{2.5, std::numbers::pi}}) {
    const ObserverSynthesis observer =
        synthesise_observer(model, none, output, 0.9, band, reference, ResidualWeight::kScalar);
    expect_bound_holds(model, none, output, observer);
    ASSERT_EQ(observer.status, SynthesisStatus::kSolved);
    for (const double beta :
         h_minus_on_grid(model, none, output, observer.gain, observer.weight, band, 1000)) {
      EXPECT_GE(beta, observer.beta) << band.low_rad << " .. " << band.high_rad;
    }
    if (full == 0.0) full = observer.objective;
    // Less is asked for: at least as good.
    EXPECT_LE(observer.objective, full * (1.0 + 1e-5)) << band.low_rad << " .. " << band.high_rad;
  }
}

TEST(ObserverSynthesis, IsTheSameForAPairOfVerticesThatAreOne) {
  ObserverOracle oracle = observer_oracle(kDetection);
  ObserverModel& model = oracle.model;
  const double expected = synthesise(oracle).objective;
  model.E_o = (MatrixXd(4, 2) << model.E_o, MatrixXd::Ones(4, 1)).finished();
  model.E_i = (MatrixXd(2, 4) << model.E_i, MatrixXd::Ones(1, 4)).finished();
  model.slope_radius = VectorXd{{model.slope_radius[0], 0.0}};
  const ObserverSynthesis observer = synthesise(oracle);
  EXPECT_EQ(observer.objective, expected);
}

TEST(ObserverSynthesis, GivesFourThreadsAtATimeTheGainsOfOneAlone) {
  const ObserverOracle oracles[] = {observer_oracle(kDetection), observer_oracle(kCombined)};
  const MatrixXd alone[] = {synthesise(oracles[0]).gain, synthesise(oracles[1]).gain};
  std::vector<MatrixXd> together(8);
  std::vector<std::thread> threads;
  for (std::size_t i = 0; i < 4; ++i) {
    threads.emplace_back([&, i] {
      together[2 * i] = synthesise(oracles[i % 2]).gain;
      together[2 * i + 1] = synthesise(oracles[1 - i % 2]).gain;
    });
  }
  for (std::thread& thread : threads) thread.join();
  for (std::size_t i = 0; i < 4; ++i) {
    EXPECT_EQ(together[2 * i], alone[i % 2]);
    EXPECT_EQ(together[2 * i + 1], alone[1 - i % 2]);
  }
}

TEST(ObserverSynthesis, SaysThatAGainThatIsTooSlowForAlphaHasNoBound) {
  const ObserverOracle oracle = observer_oracle(kDetection);
  const ObserverSynthesis bound = analyse_observer(oracle.model, oracle.decoupling, oracle.output,
                                                   oracle.gain, 0.5, MatrixXd::Identity(3, 3));
  EXPECT_EQ(bound.status, SynthesisStatus::kInfeasible);
  EXPECT_FALSE(bound.reason.empty());
}

TEST(ObserverSynthesis, RefusesWrongShapesAndRanges) {
  ObserverOracle oracle = observer_oracle(kDetection);
  const auto message = [](const ObserverOracle& request) -> std::string {
    try {
      static_cast<void>(synthesise(request));
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "nothing thrown";
  };
  ObserverOracle request = oracle;
  request.alpha = 1.0;
  EXPECT_EQ(message(request), "alpha = 1; expected 0 < alpha < 1");
  request = oracle;
  request.reference.V = MatrixXd::Zero(3, 1);
  EXPECT_EQ(message(request), "V is 3x1; expected 4x1");
  request = oracle;
  request.decoupling.T = MatrixXd::Zero(4, 2);
  EXPECT_EQ(message(request), "T is 4x2; expected 4x3");
  request = oracle;
  request.band = {0.2, 0.1};
  EXPECT_THAT(message(request), testing::HasSubstr("expected 0 <= low <= high <= pi"));
}

}  // namespace
}  // namespace faultline
