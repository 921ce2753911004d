#pragma once

#include <cstdint>
#include <span>

namespace faultline {

/// A control law with memory carries it over so many missing cycles at most, as the sampler of the
/// diagnosis does (Sampler::kMaxGap); beyond, it begins anew.
inline constexpr std::int32_t kMaxMissingCycles = 100;

/// A control law: what is commanded for a measurement. Absolute values. Owns its memory of the
/// past.
class Controller {
 public:
  virtual ~Controller() = default;

  /// u_k (m) for y_k (q). Cycles come in order, but some may be missing: a law with memory advances
  /// it by as many, and begins anew where k goes back or far ahead. Real-time: neither allocates
  /// nor throws.
  virtual void command(std::uint32_t k, std::span<const double> y,
                       std::span<double> u) noexcept = 0;

 protected:
  Controller() = default;
  Controller(const Controller&) = default;
  Controller& operator=(const Controller&) = default;
};

}  // namespace faultline
