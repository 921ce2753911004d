#include "sim/band_limited_noise.h"

#include <cmath>
#include <numbers>

#include <boost/random/normal_distribution.hpp>

namespace faultline {

BandLimitedNoise::BandLimitedNoise(double from_Hz, double to_Hz, double sample_time_s) {
  const double low = std::tan(std::numbers::pi * from_Hz * sample_time_s);
  const double high = std::tan(std::numbers::pi * to_Hz * sample_time_s);
  const double width = high - low, product = low * high;
  if (from_Hz > 0.0) {
    const double denominator = 1.0 + width + product;
    a1_ = 2.0 * (product - 1.0) / denominator;
    a2_ = (1.0 - width + product) / denominator;
    b0_ = width / denominator;
    b2_ = -b0_;
  } else {
    a1_ = (high - 1.0) / (high + 1.0);
    b0_ = b1_ = high / (1.0 + high);
  }
  // Autocovariances of w driven by white noise of variance one (Yule-Walker).
  const double r0 = (1.0 + a2_) / ((1.0 - a2_) * ((1.0 + a2_) * (1.0 + a2_) - a1_ * a1_));
  const double r1 = -a1_ * r0 / (1.0 + a2_);
  const double r2 = -a1_ * r1 - a2_ * r0;
  const double variance = (b0_ * b0_ + b1_ * b1_ + b2_ * b2_) * r0 +
                          2.0 * (b0_ * b1_ + b1_ * b2_) * r1 + 2.0 * b0_ * b2_ * r2;
  const double scale = 1.0 / std::sqrt(variance);
  b0_ *= scale;
  b1_ *= scale;
  b2_ *= scale;
  deviation_ = std::sqrt(r0);
  correlation_ = r1 / r0;
}

double BandLimitedNoise::filter(double input) noexcept {
  const double w = input - a1_ * w1_ - a2_ * w2_;
  const double output = b0_ * w + b1_ * w1_ + b2_ * w2_;
  w2_ = w1_;
  w1_ = w;
  return output;
}

double BandLimitedNoise::next(boost::random::mt19937_64& stream) noexcept {
  boost::random::normal_distribution<double> normal;
  if (!is_started_) {
    is_started_ = true;
    w1_ = deviation_ * normal(stream);
    w2_ = correlation_ * w1_ +
          deviation_ * std::sqrt(1.0 - correlation_ * correlation_) * normal(stream);
  }
  return filter(normal(stream));
}

}  // namespace faultline
