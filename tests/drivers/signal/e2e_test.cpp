#include "drivers/signal/e2e.h"

#include <array>
#include <cstdint>
#include <numeric>

#include <gtest/gtest.h>

namespace faultline {
namespace {

// Vectors from the tests of the Python package autosar-e2e (tests/golden/e2e/README.md).

using Payload = std::array<std::uint8_t, 8>;
constexpr std::uint16_t kId1 = 0x123;
constexpr std::uint16_t kId5 = 0x1234;

TEST(E2eProfile1, HasThePublishedChecksums) {
  EXPECT_EQ(e2e_p01_crc(E2eP01Variant::kBoth, kId1, 0, Payload{}, 0), 0xCC);
  EXPECT_EQ(e2e_p01_crc(E2eP01Variant::kBoth, kId1, 1, Payload{0, 1}, 0), 0x91);
  EXPECT_EQ(e2e_p01_crc(E2eP01Variant::kAlternating, kId1, 0, Payload{}, 0), 0xCE);
  EXPECT_EQ(e2e_p01_crc(E2eP01Variant::kAlternating, kId1, 1, Payload{0, 1}, 0), 0x02);
  EXPECT_EQ(e2e_p01_crc(E2eP01Variant::kNibble, kId1, 0, Payload{0, 0x10}, 0), 0x2A);
  EXPECT_EQ(e2e_p01_crc(E2eP01Variant::kNibble, kId1, 1, Payload{0, 0x11}, 0), 0x77);
}

TEST(E2eProfile1, CoversWhatStandsBeforeTheChecksum) {
  const std::array<std::uint8_t, 16> payload{0, 0, 0, 0, 0, 0, 0, 0, 0xFF, 0x10};
  EXPECT_EQ(e2e_p01_crc(E2eP01Variant::kNibble, kId1, 0, payload, 8), 0x7D);
  std::array<std::uint8_t, 16> other = payload;
  other[0] = 1;
  EXPECT_NE(e2e_p01_crc(E2eP01Variant::kNibble, kId1, 0, other, 8), 0x7D);
}

TEST(E2eProfile2, HasThePublishedChecksums) {
  EXPECT_EQ(e2e_p02_crc(0, Payload{0, 1}, 0), 0x45);
  Payload payload{};
  std::iota(payload.begin(), payload.end(), std::uint8_t{0});
  EXPECT_EQ(e2e_p02_crc(1, payload, 0), 0x61);
  payload[1] = 2;
  EXPECT_EQ(e2e_p02_crc(2, payload, 0), 0xBC);
}

TEST(E2eProfile5, HasThePublishedChecksums) {
  // In the frame the low byte comes first: 1C CA, CF 8D, 28 91.
  EXPECT_EQ(e2e_p05_crc(kId5, Payload{}, 0), 0xCA1C);
  EXPECT_EQ(e2e_p05_crc(kId5, Payload{0, 0, 1}, 0), 0x8DCF);
  EXPECT_EQ(e2e_p05_crc(kId5, std::array<std::uint8_t, 16>{}, 8), 0x9128);
}

TEST(E2e, LeavesTheChecksumsOwnBytesOut) {
  EXPECT_EQ(e2e_p01_crc(E2eP01Variant::kBoth, kId1, 0, Payload{0xAB}, 0), 0xCC);
  EXPECT_EQ(e2e_p02_crc(0, Payload{0xAB, 1}, 0), 0x45);
  EXPECT_EQ(e2e_p05_crc(kId5, Payload{0xAB, 0xCD}, 0), 0xCA1C);
}

}  // namespace
}  // namespace faultline
