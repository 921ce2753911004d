#include <algorithm>
#include <cmath>
#include <numbers>

#include <gtest/gtest.h>

#include "diagnosis/design/uio/observer_synthesis.h"
#include "tests/diagnosis/design/uio/observer_oracle.h"
#include "tests/diagnosis/design/uio/random_observer_model.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;

constexpr double kPi = std::numbers::pi;

TEST(HMinus, OfTheFlexibleJointIsTheKnownOne) {
  for (const char* name : {"paper_detection_UIO", "paper_combined_noDecoupling"}) {
    const ObserverOracle oracle = observer_oracle(name);
    const auto exact = h_minus_indices(oracle.model, oracle.decoupling, oracle.output, oracle.gain,
                                       MatrixXd::Identity(3, 3), oracle.band);
    // The file lists the vertices in the other order where they differ from ours.
    std::vector<double> known(oracle.beta.begin(), oracle.beta.end());
    std::vector<double> found;
    for (const auto& index : exact) found.push_back(index.value());
    std::sort(known.begin(), known.end());
    std::sort(found.begin(), found.end());
    ASSERT_EQ(found.size(), known.size());
    for (std::size_t i = 0; i < known.size(); ++i) EXPECT_NEAR(found[i] / known[i], 1.0, 1e-6);
  }
}

/// With the observer's gain zero and no decoupling the transfer is that of the plant.
struct Transfer {
  ObserverModel model;
  DecouplingMatrices none = no_decoupling(model);
  ObserverOutput output = output_error(model);
  MatrixXd gain = MatrixXd::Zero(model.n(), model.C.rows());
  MatrixXd weight = MatrixXd::Identity(model.C.rows(), model.C.rows());

  [[nodiscard]] std::optional<double> exact(const FrequencyBand& band) const {
    return h_minus_indices(model, none, output, gain, weight, band).at(0);
  }
  [[nodiscard]] double on_grid(const FrequencyBand& band, int points) const {
    return h_minus_on_grid(model, none, output, gain, weight, band, points).at(0);
  }
};

TEST(HMinus, IsWhatAFineGridFindsInBandsOfEveryKind) {
  const FrequencyBand bands[] = {{0.0, 0.3}, {0.0, 2.0}, {0.4, 0.9}, {1.2, 1.9},
                                 {2.0, 3.0}, {2.2, kPi}, {0.7, kPi}, {0.0, kPi}};
  for (std::uint64_t seed = 1; seed <= 12; ++seed) {
    RandomNumbers random(seed);
    const Transfer transfer{
        random_observer_model(random, 2 + static_cast<Index>(seed % 3), 3, 1 + (seed % 2))};
    for (const FrequencyBand& band : bands) {
      SCOPED_TRACE(testing::Message()
                   << "seed " << seed << ", band " << band.low_rad << " .. " << band.high_rad);
      const double fine = transfer.on_grid(band, 4001);
      const std::optional<double> exact = transfer.exact(band);
      ASSERT_TRUE(exact.has_value());
      EXPECT_NEAR(*exact / fine, 1.0, 2e-6);
    }
  }
}

TEST(HMinus, OfASinglePoleIsItsGainAtTheFarEndOfTheBand) {
  // |1/(e^jθ - 0.5)| falls with θ: 1/√(1.25 - cos θ) at the upper end.
  ObserverModel model;
  model.A = MatrixXd::Constant(1, 1, 0.5);
  model.C = model.F_x = MatrixXd::Ones(1, 1);
  model.F_y = MatrixXd::Zero(1, 1);
  model.M = model.W = MatrixXd::Ones(1, 1);
  model.w_bound = model.x_bound = Eigen::VectorXd::Ones(1);
  model.E_o.resize(1, 0);
  model.E_i.resize(0, 1);
  const Transfer transfer{model};
  for (const FrequencyBand band :
       {FrequencyBand{0.0, 1.0}, FrequencyBand{0.5, 1.0}, FrequencyBand{2.0, kPi}}) {
    const double expected = 1.0 / std::sqrt(1.25 - std::cos(band.high_rad));
    EXPECT_NEAR(transfer.on_grid(band, 3), expected, 1e-12);
    EXPECT_NEAR(transfer.exact(band).value(), expected, 1e-6);
  }
}

TEST(HMinus, CountsWhatReachesTheResidualAtOnce) {
  RandomNumbers random(5);
  Transfer transfer{random_observer_model(random, 3, 3, 1)};
  transfer.model.F_y = random.normal(3, 1);
  transfer.output = output_error(transfer.model);
  const FrequencyBand band{0.2, 1.4};
  EXPECT_NEAR(transfer.exact(band).value() / transfer.on_grid(band, 4001), 1.0, 2e-6);
}

TEST(HMinus, IsZeroForMoreFaultsThanResiduals) {
  RandomNumbers random(6);
  const Transfer transfer{random_observer_model(random, 4, 2, 3)};
  EXPECT_EQ(transfer.on_grid({0.0, 1.0}, 50), 0.0);
  EXPECT_EQ(transfer.exact({0.0, 1.0}), std::optional(0.0));
}

TEST(HMinus, ScalesWithTheWeight) {
  RandomNumbers random(7);
  Transfer transfer{random_observer_model(random, 3, 2, 1)};
  const FrequencyBand band{0.0, 0.5};
  const double one = transfer.exact(band).value();
  transfer.weight *= 1e-3;
  EXPECT_NEAR(transfer.exact(band).value() / one, 1e-3, 1e-9);
}

}  // namespace
}  // namespace faultline
