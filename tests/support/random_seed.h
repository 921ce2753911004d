#pragma once

#include <cstdint>
#include <cstdlib>
#include <string>

namespace faultline {

/// Seed of a randomised test: FAULTLINE_TEST_SEED if that is set, else `usual`, so that runs
/// repeat. Show it on failure: SCOPED_TRACE(seed_message(seed)).
[[nodiscard]] inline std::uint64_t test_seed(std::uint64_t usual) {
  const char* const wanted = std::getenv("FAULTLINE_TEST_SEED");
  return wanted == nullptr ? usual : std::strtoull(wanted, nullptr, 10);
}

[[nodiscard]] inline std::string seed_message(std::uint64_t seed) {
  return "FAULTLINE_TEST_SEED=" + std::to_string(seed);
}

}  // namespace faultline
