#include "drivers/can/udp_frame.h"

#include <array>
#include <fstream>
#include <random>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "drivers/can/candump_log.h"
#include "tests/support/allocation_guard.h"
#include "tests/support/random_can_frame.h"

namespace faultline {
namespace {

using Bytes = std::vector<std::uint8_t>;

Bytes encode(const CanFrame& frame) {
  Bytes datagram(kLongestUdpFrame);
  datagram.resize(encode_udp_frame(frame, datagram));
  return datagram;
}

bool decodes(const Bytes& datagram) {
  CanFrame frame;
  return decode_udp_frame(datagram, frame);
}

CanFrame decode(const Bytes& datagram) {
  CanFrame frame;
  EXPECT_TRUE(decode_udp_frame(datagram, frame));
  return frame;
}

Bytes from_hex(std::string_view digits) {
  Bytes bytes;
  for (std::size_t n = 0; n + 1 < digits.size(); n += 2) {
    bytes.push_back(
        static_cast<std::uint8_t>(std::stoul(std::string(digits.substr(n, 2)), nullptr, 16)));
  }
  return bytes;
}

// A little msgpack, by hand.
Bytes text(std::string_view characters) {
  Bytes bytes;
  bytes.push_back(static_cast<std::uint8_t>(0xA0 | characters.size()));
  for (const char character : characters) bytes.push_back(static_cast<std::uint8_t>(character));
  return bytes;
}

using Entry = std::pair<std::string_view, Bytes>;

Bytes map(const std::vector<Entry>& entries) {
  Bytes bytes;
  bytes.push_back(static_cast<std::uint8_t>(0x80 | entries.size()));
  for (const auto& [key, value] : entries) {
    const Bytes name = text(key);
    bytes.insert(bytes.end(), name.begin(), name.end());
    bytes.insert(bytes.end(), value.begin(), value.end());
  }
  return bytes;
}

const Bytes kNo{0xC2};
const Bytes kYes{0xC3};
const Bytes kNothing{0xC0};

struct Golden {
  CanFrame frame;
  Bytes datagram;
};

std::vector<Golden> golden_frames() {
  std::ifstream file(FAULTLINE_TEST_DATA_DIR "/python_can_frames.txt");
  std::vector<Golden> frames;
  std::string line;
  while (std::getline(file, line)) {
    const std::size_t bar = line.find(" | ");
    if (bar == std::string::npos) continue;
    CandumpRecord record;
    CandumpProblem problem;
    EXPECT_EQ(parse_candump_line(line.substr(0, bar), record, problem), CandumpStatus::kRecord);
    frames.push_back({record.frame, from_hex(std::string_view(line).substr(bar + 3))});
  }
  return frames;
}

TEST(UdpFrame, ReadsWhatPythonCanWrites) {
  const auto golden = golden_frames();
  ASSERT_EQ(golden.size(), 8u);
  for (const auto& [frame, datagram] : golden) {
    const CanFrame decoded = decode(datagram);
    EXPECT_TRUE(same_on_wire(decoded, frame)) << frame.id;
    EXPECT_EQ(decoded.stamp, frame.stamp) << frame.id;
  }
}

TEST(UdpFrame, WritesWhatPythonCanWritesToTheByte) {
  for (const auto& [frame, datagram] : golden_frames()) {
    EXPECT_EQ(encode(frame), datagram) << frame.id;
  }
}

TEST(UdpFrame, ReadsBackWhateverItWrites) {
  std::mt19937_64 generator(1);
  for (int n = 0; n < 100'000; ++n) {
    CanFrame frame = random_can_frame(generator);
    frame.stamp = Timestamp(std::chrono::microseconds(generator() % 4'000'000'000'000'000u));
    const Bytes datagram = encode(frame);
    ASSERT_FALSE(datagram.empty());
    const CanFrame decoded = decode(datagram);
    ASSERT_TRUE(same_on_wire(decoded, frame)) << n;
    ASSERT_EQ(decoded.stamp, frame.stamp) << n;
  }
}

TEST(UdpFrame, TakesMissingEntriesForCanMessagesDefaults) {
  const CanFrame frame = decode(map({}));
  EXPECT_TRUE(frame.is_extended);
  EXPECT_EQ(frame.id, 0u);
  EXPECT_EQ(frame.length, 0);
  EXPECT_EQ(decode(map({{"data", {0xC4, 2, 7, 8}}})).length, 2);
  EXPECT_EQ(decode(map({{"dlc", kNothing}, {"data", {0xC4, 2, 7, 8}}})).data[1], 8);
}

TEST(UdpFrame, ReadsEveryFormatOfANumberAndTruthFromNumbers) {
  for (const Bytes& number :
       {Bytes{0x07}, Bytes{0xCC, 7}, Bytes{0xCD, 0, 7}, Bytes{0xCE, 0, 0, 0, 7},
        Bytes{0xCF, 0, 0, 0, 0, 0, 0, 0, 7}, Bytes{0xD0, 7}, Bytes{0xD1, 0, 7},
        Bytes{0xD2, 0, 0, 0, 7}, Bytes{0xD3, 0, 0, 0, 0, 0, 0, 0, 7}}) {
    const CanFrame frame =
        decode(map({{"arbitration_id", number}, {"is_extended_id", {0x00}}, {"is_fd", {0x01}}}));
    EXPECT_EQ(frame.id, 7u);
    EXPECT_FALSE(frame.is_extended);
    EXPECT_TRUE(frame.is_fd);
  }
}

TEST(UdpFrame, ReadsOverChannelsOfAnyKindAndUnknownKeys) {
  const Bytes nested{0x92, 0x81, 0xA1, 'k', 0x93, 1, 2, 0xC0, 0xD6, 1, 2, 3, 4, 5};
  for (const Bytes& channel :
       {kNothing, text("vcan0"), Bytes{5}, Bytes{0xFF}, nested, Bytes{0xCA, 0, 0, 0, 0},
        Bytes{0xC7, 1, 9, 0}, Bytes{0xDC, 0, 1, 5}, Bytes{0xDE, 0, 1, 5, 5}}) {
    EXPECT_EQ(decode(map({{"channel", channel}, {"is_rx", kYes}, {"arbitration_id", {3}}})).id, 3u);
  }
}

TEST(UdpFrame, TakesNoTimeFromATimestampThatIsNone) {
  for (const Bytes& value :
       {kNothing, Bytes{0xFF}, text("now"), Bytes{0xCB, 0x7F, 0xF8, 0, 0, 0, 0, 0, 0},
        Bytes{0xCB, 0x7F, 0xF0, 0, 0, 0, 0, 0, 0}, Bytes{0xCB, 0xBF, 0xF0, 0, 0, 0, 0, 0, 0},
        Bytes{0xCB, 0x7F, 0xE0, 0, 0, 0, 0, 0, 0}}) {
    EXPECT_EQ(decode(map({{"timestamp", value}})).stamp, Timestamp{});
  }
  EXPECT_EQ(decode(map({{"timestamp", {0x05}}})).stamp, Timestamp(std::chrono::seconds(5)));
}

TEST(UdpFrame, RefusesWhatPythonCanRefuses) {
  const Entry standard{"is_extended_id", kNo};
  EXPECT_FALSE(decodes(map({standard, {"arbitration_id", {0xCD, 0x08, 0x00}}})));
  EXPECT_FALSE(decodes(map({{"arbitration_id", {0xCE, 0x20, 0, 0, 0}}})));
  EXPECT_FALSE(decodes(map({{"arbitration_id", {0xFF}}})));
  EXPECT_FALSE(decodes(map({{"arbitration_id", {0xCF, 1, 0, 0, 0, 0, 0, 0, 1}}})));
  EXPECT_FALSE(decodes(map({{"is_remote_frame", kYes}, {"is_error_frame", kYes}})));
  EXPECT_FALSE(decodes(map({{"is_remote_frame", kYes}, {"is_fd", kYes}})));
  EXPECT_FALSE(decodes(map({{"dlc", {9}}, {"data", {0xC4, 9, 1, 2, 3, 4, 5, 6, 7, 8, 9}}})));
  EXPECT_FALSE(decodes(map({{"dlc", {2}}, {"data", {0xC4, 1, 1}}})));
  EXPECT_FALSE(decodes(map({{"is_remote_frame", kYes}, {"dlc", {9}}})));
  EXPECT_FALSE(decodes(map({{"bitrate_switch", kYes}})));
  EXPECT_FALSE(decodes(map({{"error_state_indicator", kYes}})));
  EXPECT_FALSE(decodes(map({{"is_fd", text("yes")}})));
  EXPECT_FALSE(decodes(map({{"data", text("yes")}})));
  EXPECT_FALSE(decodes(map({{"dlc", kYes}})));
}

TEST(UdpFrame, RefusesWhatIsNoMap) {
  EXPECT_FALSE(decodes({}));
  EXPECT_FALSE(decodes({0xC0}));
  EXPECT_FALSE(decodes({0xC1}));
  EXPECT_FALSE(decodes({0x90}));
  EXPECT_FALSE(decodes({0x81, 0x01, 0x01}));  // a key that is no text
  EXPECT_FALSE(decodes({0x80, 0x00}));        // something behind the map
  EXPECT_FALSE(decodes({0xDF, 0xFF, 0xFF, 0xFF, 0xFF}));
  EXPECT_FALSE(decodes({0x81, 0xDB, 0xFF, 0xFF, 0xFF, 0xFF}));
  EXPECT_FALSE(decodes({0x81, 0xA1, 'k', 0xDD, 0xFF, 0xFF, 0xFF, 0xFF}));
}

TEST(UdpFrame, LeavesTheFrameAloneWhenItRefuses) {
  CanFrame frame;
  frame.id = 5;
  EXPECT_FALSE(decode_udp_frame({}, frame));
  EXPECT_EQ(frame.id, 5u);
}

TEST(UdpFrame, RefusesEveryCutOffDatagram) {
  for (const auto& [frame, datagram] : golden_frames()) {
    for (std::size_t size = 0; size < datagram.size(); ++size) {
      EXPECT_FALSE(decodes(Bytes(datagram.begin(), datagram.begin() + static_cast<long>(size))));
    }
  }
}

TEST(UdpFrame, SurvivesEveryMutation) {
  std::mt19937_64 generator(3);
  for (int n = 0; n < 300'000; ++n) {
    Bytes datagram = encode(random_can_frame(generator));
    for (std::uint64_t changes = 1 + generator() % 4; changes > 0; --changes) {
      datagram[generator() % datagram.size()] = static_cast<std::uint8_t>(generator());
    }
    CanFrame frame;
    if (!decode_udp_frame(datagram, frame)) continue;
    ASSERT_TRUE(is_well_formed(frame));
    const CanFrame again = decode(encode(frame));
    ASSERT_TRUE(same_on_wire(again, frame));
  }
}

TEST(UdpFrame, WritesNothingThatIsNoFrameOrDoesNotFit) {
  CanFrame frame;
  frame.id = 0x800;
  EXPECT_TRUE(encode(frame).empty());
  frame.id = 1;
  Bytes small(encode(frame).size() - 1);
  EXPECT_EQ(encode_udp_frame(frame, small), 0u);
}

TEST(UdpFrame, DoesNotAllocate) {
  CanFrame frame;
  frame.is_fd = true;
  frame.length = 64;
  std::array<std::uint8_t, kLongestUdpFrame> datagram;
  std::size_t decoded = 0;
  const AllocationGuard guard;
  for (int step = 0; step < 1000; ++step) {
    const std::size_t size = encode_udp_frame(frame, datagram);
    decoded += decode_udp_frame(std::span(datagram).first(size), frame) ? 1u : 0u;
  }
  const auto calls = guard.heap_calls();
  EXPECT_EQ(calls, 0u);
  EXPECT_EQ(decoded, 1000u);
}

}  // namespace
}  // namespace faultline
