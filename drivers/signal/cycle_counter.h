#pragma once

#include <cstdint>

namespace faultline {

/// How far cycle counter `a` is ahead of `b`; counters wrap at 2^32.
[[nodiscard]] constexpr std::int32_t cycles_ahead(std::uint32_t a, std::uint32_t b) noexcept {
  return static_cast<std::int32_t>(a - b);
}

/// The counter nearest to `near` whose low `bits` are those of `low`, from near - 2^(bits-1) on.
/// Frames carry counters mod 2^bits, bits >= 1; 32 or more: the counter itself.
[[nodiscard]] constexpr std::uint32_t unwrap_cycle(std::uint32_t low, std::uint32_t bits,
                                                   std::uint32_t near) noexcept {
  if (bits >= 32) return low;
  const std::uint32_t least = near - (1u << (bits - 1));
  return least + ((low - least) & ((1u << bits) - 1));
}

}  // namespace faultline
