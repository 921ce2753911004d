#pragma once

#include <cmath>
#include <cstdint>
#include <numbers>

namespace faultline {

/// Uniform in [0, 1), from one of 2^64 equally likely numbers: the same on every machine.
[[nodiscard]] inline double uniform_of(std::uint64_t draw) noexcept {
  return static_cast<double>(draw >> 11U) * 0x1p-53;
}

/// Standard normal from two of them (Box, Muller 1958): √(-2 ln u₁)·cos(2π u₂), u₁ in (0, 1]. On
/// other machines the same but for the last bits of ln and cos.
[[nodiscard]] inline double normal_of(std::uint64_t draw_1, std::uint64_t draw_2) noexcept {
  return std::sqrt(-2.0 * std::log(1.0 - uniform_of(draw_1))) *
         std::cos(2.0 * std::numbers::pi * uniform_of(draw_2));
}

}  // namespace faultline
