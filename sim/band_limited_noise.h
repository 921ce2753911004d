#pragma once

#include <boost/random/mersenne_twister.hpp>

namespace faultline {

/// White Gaussian noise through a band-pass of second order, of standard deviation one from the
/// first sample on:
///
///   H(s) = B s / (s² + B s + Ω₁ Ω₂),   B = Ω₂ - Ω₁,   Ω = tan(π f T),   s = (1 - z⁻¹) / (1 + z⁻¹)
///
/// At `from_Hz` and `to_Hz` it passes half the power, exactly at this sample rate, and falls off
/// with 20 dB per decade outside. From 0 Hz: the low-pass Ω₂ / (s + Ω₂). Its first state is drawn
/// from the distribution that it keeps.
class BandLimitedNoise {
 public:
  /// @pre 0 <= from_Hz < to_Hz < 1 / (2 T)
  BandLimitedNoise(double from_Hz, double to_Hz, double sample_time_s);

  /// The next number: one normal draw from `stream`, three the first time. Real-time.
  [[nodiscard]] double next(boost::random::mt19937_64& stream) noexcept;
  /// The filter alone, from its state on: its answer to `input`. Real-time.
  [[nodiscard]] double filter(double input) noexcept;

 private:
  // w_k = x_k - a1 w_k-1 - a2 w_k-2,  y_k = b0 w_k + b1 w_k-1 + b2 w_k-2
  double a1_ = 0.0, a2_ = 0.0, b0_ = 0.0, b1_ = 0.0, b2_ = 0.0;
  double w1_ = 0.0, w2_ = 0.0;
  double deviation_ = 1.0, correlation_ = 0.0;  // of w, and of w_k with w_k-1
  bool is_started_ = false;
};

}  // namespace faultline
