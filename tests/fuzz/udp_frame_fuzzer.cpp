// Fuzz target: datagrams of the udp bus. Whatever comes is refused or a well-formed frame; writing
// that and reading it back gives it again, in bytes that no longer change.
#include <algorithm>
#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <span>

#include "drivers/can/udp_frame.h"

namespace {

using namespace faultline;

void require(bool holds) {
  if (!holds) std::abort();
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  CanFrame frame;
  frame.id = 0x1234'5678;
  if (!decode_udp_frame({data, size}, frame)) {
    require(frame.id == 0x1234'5678);
    return 0;
  }
  require(is_well_formed(frame));
  require(std::all_of(frame.data.begin() + (frame.is_remote ? 0 : frame.length), frame.data.end(),
                      [](std::uint8_t byte) { return byte == 0; }));
  std::array<std::uint8_t, kLongestUdpFrame> written;
  const std::size_t written_size = encode_udp_frame(frame, written);
  require(written_size > 0);
  CanFrame again;
  require(decode_udp_frame(std::span(written).first(written_size), again));
  require(same_on_wire(again, frame));
  // A double holds times of this century to the microsecond, later ones less exactly.
  require(std::chrono::abs(again.stamp - frame.stamp) <= std::chrono::microseconds(1));
  std::array<std::uint8_t, kLongestUdpFrame> too_small;
  require(encode_udp_frame(frame, std::span(too_small).first(written_size - 1)) == 0);
  return 0;
}
