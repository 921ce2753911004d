#include "sim/band_limited_noise.h"

#include <cmath>
#include <complex>
#include <numbers>
#include <vector>

#include <gtest/gtest.h>

namespace faultline {
namespace {

constexpr double kT_s = 0.01;
constexpr int kLong = 20000;  // samples after which the filters here have forgotten everything

std::vector<double> impulse_response(BandLimitedNoise filter) {
  std::vector<double> response{filter.filter(1.0)};
  for (int k = 1; k < kLong; ++k) response.push_back(filter.filter(0.0));
  return response;
}

double power_at(const std::vector<double>& response, double frequency_Hz) {
  std::complex<double> sum = 0.0;
  for (std::size_t k = 0; k < response.size(); ++k) {
    const double phase = -2.0 * std::numbers::pi * frequency_Hz * kT_s * static_cast<double>(k);
    sum += response[k] * std::polar(1.0, phase);
  }
  return std::norm(sum);
}

class BandLimitedNoiseBands : public testing::TestWithParam<std::pair<double, double>> {};

TEST_P(BandLimitedNoiseBands, PassHalfThePowerAtTheirEdges) {
  const auto [from_Hz, to_Hz] = GetParam();
  const auto response = impulse_response({from_Hz, to_Hz, kT_s});
  const auto warped = [](double f) { return std::tan(std::numbers::pi * f * kT_s); };
  const double middle_Hz =
      std::atan(std::sqrt(warped(from_Hz) * warped(to_Hz))) / (std::numbers::pi * kT_s);
  const double most = power_at(response, middle_Hz);
  EXPECT_NEAR(power_at(response, to_Hz) / most, 0.5, 1e-6);
  if (from_Hz > 0.0) {
    EXPECT_NEAR(power_at(response, from_Hz) / most, 0.5, 1e-6);
    EXPECT_NEAR(power_at(response, 0.0) / most, 0.0, 1e-6);
  }
  EXPECT_NEAR(power_at(response, 0.5 / kT_s) / most, 0.0, 1e-6);
}

// The sum of the squared impulse response is the variance of what it makes of white noise.
TEST_P(BandLimitedNoiseBands, HaveVarianceOne) {
  const auto [from_Hz, to_Hz] = GetParam();
  double variance = 0.0;
  for (const double h : impulse_response({from_Hz, to_Hz, kT_s})) variance += h * h;
  EXPECT_NEAR(variance, 1.0, 1e-9);
}

// Over many seeds: the first sample, and its product with the second, which the impulse response
// gives too.
TEST_P(BandLimitedNoiseBands, BeginAsTheyGoOn) {
  const auto [from_Hz, to_Hz] = GetParam();
  const auto response = impulse_response({from_Hz, to_Hz, kT_s});
  double covariance = 0.0;
  for (std::size_t k = 1; k < response.size(); ++k) covariance += response[k] * response[k - 1];
  constexpr int kSeeds = 4000;
  double squares = 0.0, products = 0.0;
  for (unsigned seed = 1; seed <= kSeeds; ++seed) {
    boost::random::mt19937_64 stream(seed);
    BandLimitedNoise noise(from_Hz, to_Hz, kT_s);
    const double first = noise.next(stream);
    squares += first * first;
    products += first * noise.next(stream);
  }
  const double four_errors = 4.0 * std::sqrt(2.0 / kSeeds);
  EXPECT_NEAR(squares / kSeeds, 1.0, four_errors);
  EXPECT_NEAR(products / kSeeds, covariance, four_errors);
}

INSTANTIATE_TEST_SUITE_P(Bands, BandLimitedNoiseBands,
                         testing::Values(std::pair{0.0, 5.0}, std::pair{1.0, 4.0},
                                         std::pair{10.0, 45.0}, std::pair{0.0, 0.1}));

}  // namespace
}  // namespace faultline
