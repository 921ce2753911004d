#include "drivers/signal/crc.h"

#include <cstddef>
#include <cstdint>
#include <random>
#include <string_view>
#include <vector>

#include <boost/crc.hpp>
#include <gtest/gtest.h>

#include "tests/support/random_seed.h"

namespace faultline {
namespace {

std::vector<std::uint8_t> bytes_of(std::string_view text) { return {text.begin(), text.end()}; }

template <class Crc>
auto by_boost(Crc crc, const std::vector<std::uint8_t>& bytes) {
  crc.process_bytes(bytes.data(), bytes.size());
  return crc.checksum();
}

TEST(Crc, HasThePublishedCheckValues) {
  const std::vector<std::uint8_t> digits = bytes_of("123456789");
  EXPECT_EQ(crc8_j1850(digits), 0x4B);
  EXPECT_EQ(crc8_h2f(digits), 0xDF);
  EXPECT_EQ(crc16_ccitt_false(digits), 0x29B1);
}

TEST(Crc, AgreesWithBoostOnRandomBytes) {
  const std::uint64_t seed = test_seed(1);
  SCOPED_TRACE(seed_message(seed));
  std::mt19937 draw(static_cast<std::uint32_t>(seed));
  for (int round = 0; round < 500; ++round) {
    std::vector<std::uint8_t> bytes(draw() % 70);
    for (std::uint8_t& byte : bytes) byte = static_cast<std::uint8_t>(draw());
    EXPECT_EQ(crc8_j1850(bytes),
              by_boost(boost::crc_optimal<8, 0x1D, 0xFF, 0xFF, false, false>(), bytes));
    EXPECT_EQ(crc8_h2f(bytes),
              by_boost(boost::crc_optimal<8, 0x2F, 0xFF, 0xFF, false, false>(), bytes));
    EXPECT_EQ(crc16_ccitt_false(bytes),
              by_boost(boost::crc_optimal<16, 0x1021, 0xFFFF, 0, false, false>(), bytes));
    const auto start = static_cast<std::uint8_t>(draw());
    EXPECT_EQ(extend_crc8_1d(start, bytes), by_boost(boost::crc_basic<8>(0x1D, start), bytes));
  }
}

TEST(Crc, GoesOnWhereItStopped) {
  const std::vector<std::uint8_t> digits = bytes_of("123456789");
  for (std::size_t cut = 0; cut <= digits.size(); ++cut) {
    const std::span<const std::uint8_t> all = digits;
    EXPECT_EQ(extend_crc16_1021(extend_crc16_1021(0xFFFF, all.first(cut)), all.subspan(cut)),
              0x29B1);
    EXPECT_EQ(extend_crc8_2f(extend_crc8_2f(0xFF, all.first(cut)), all.subspan(cut)) ^ 0xFF, 0xDF);
  }
}

}  // namespace
}  // namespace faultline
