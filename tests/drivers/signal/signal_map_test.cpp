#include "drivers/signal/signal_map.h"

#include <array>
#include <limits>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "drivers/dbc/dbc_parser.h"

namespace faultline {
namespace {

constexpr std::string_view kRoles =
    "BA_DEF_ SG_ \"FaultlineRole\" STRING ;\n"
    "BA_DEF_DEF_ \"FaultlineRole\" \"\";\n"
    "BA_DEF_ BO_ \"VFrameFormat\" ENUM \"StandardCAN\",\"StandardCAN_FD\";\n"
    "BA_DEF_DEF_ \"VFrameFormat\" \"StandardCAN\";\n"
    "BA_ \"FaultlineRole\" SG_ 16 k \"sync\";\n"
    "BA_ \"FaultlineRole\" SG_ 16 c \"command_cycle\";\n"
    "BA_ \"FaultlineRole\" SG_ 17 k_a \"cycle\";\n"
    "BA_ \"FaultlineRole\" SG_ 17 alive \"alive\";\n"
    "BA_ \"FaultlineRole\" SG_ 18 k_b \"cycle\";\n"
    "BA_ \"FaultlineRole\" SG_ 19 k_u \"cycle\";\n"
    "BA_ \"FaultlineRole\" SG_ 19 crc \"crc\";\n"
    "BA_DEF_ BO_ \"FaultlineProtection\" STRING ;\n"
    "BA_DEF_DEF_ \"FaultlineProtection\" \"none\";\n"
    "BA_DEF_ BO_ \"FaultlineBus\" INT 0 255;\n"
    "BA_ \"FaultlineProtection\" BO_ 19 \"J1850\";\n";

constexpr std::string_view kMessages =
    "BO_ 16 Sync: 8 P\n"
    " SG_ k : 0|32@1+ (1,0) [0|0] \"\" C\n"
    " SG_ c : 32|32@1+ (1,0) [0|0] \"\" C\n"
    "BO_ 17 Sensors_A: 6 P\n"
    " SG_ y1 : 0|16@1- (0.5,0) [0|0] \"V\" C\n"
    " SG_ y2 : 23|16@0+ (0.25,-10) [0|0] \"V\" C\n"
    " SG_ k_a : 32|4@1+ (1,0) [0|0] \"\" C\n"
    " SG_ alive : 36|4@1+ (1,0) [0|0] \"\" C\n"
    "BO_ 18 Sensors_B: 12 P\n"
    " SG_ y3 : 0|32@1- (1,0) [0|0] \"V\" C\n"
    " SG_ k_b : 32|8@1+ (1,0) [0|0] \"\" C\n"
    "BO_ 19 Commands: 8 C\n"
    " SG_ u1 : 0|16@1- (0.1,0) [0|0] \"A\" P\n"
    " SG_ k_u M : 16|16@1+ (1,0) [0|0] \"\" P\n"
    " SG_ crc : 32|8@1+ (1,0) [0|0] \"\" P\n"
    " SG_ u2 m1 : 40|8@1+ (1,0) [0|0] \"\" P\n"
    "BO_ 20 Other: 2 C\n"
    " SG_ torque_left : 0|8@1+ (1,0) [0|0] \"Nm\" P\n"
    " SG_ y1 : 8|8@1+ (1,0) [0|0] \"Nm\" P\n"
    " SG_ beyond : 16|8@1+ (1,0) [0|0] \"Nm\" P\n"
    "SIG_VALTYPE_ 18 y3 : 1;\n";

using Names = std::vector<std::string>;
using Mappings = std::map<std::string, ChannelMapping, std::less<>>;

DbcDatabase bench(const std::string& more = "") {
  return parse_dbc(std::string(kMessages) + std::string(kRoles) + more, "bench.dbc");
}

const Mappings kY1InSensors{{"y1", {"Sensors_A.y1", 1.0, 0.0}}};

std::string error_of(const DbcDatabase& dbc, const Names& outputs, const Names& inputs,
                     const Mappings& mappings = kY1InSensors) {
  try {
    static_cast<void>(make_signal_map(dbc, outputs, inputs, mappings));
  } catch (const SignalMapError& error) {
    return error.what();
  }
  return "no error";
}

TEST(SignalMap, FindsChannelsByName) {
  const SignalMap map = make_signal_map(bench(), {"y3", "y2"}, {"u1"});
  ASSERT_EQ(map.sensor_messages.size(), 2u);
  EXPECT_EQ(map.sensor_messages[0].name, "Sensors_A");
  EXPECT_EQ(map.sensor_messages[0].channels[0].channel, 1u);  // y2
  EXPECT_EQ(map.sensor_messages[1].name, "Sensors_B");
  EXPECT_EQ(map.sensor_messages[1].channels[0].channel, 0u);  // y3
  ASSERT_EQ(map.command_messages.size(), 1u);
  EXPECT_EQ(map.command_messages[0].id, 19u);
  EXPECT_EQ(map.output_names, (Names{"y3", "y2"}));
  EXPECT_EQ(map.input_names, (Names{"u1"}));
}

TEST(SignalMap, FindsTheRoles) {
  const SignalMap map = make_signal_map(bench(), {"y1", "y3"}, {"u1"}, kY1InSensors);
  ASSERT_TRUE(map.sync.has_value());
  EXPECT_EQ(map.sync->id, 16u);
  EXPECT_TRUE(map.sync->command_cycle.has_value());
  ASSERT_TRUE(map.sensor_messages[0].cycle.has_value());
  EXPECT_EQ(map.sensor_messages[0].cycle->bit_count(), 4);
  ASSERT_TRUE(map.sensor_messages[1].cycle.has_value());
  EXPECT_EQ(map.sensor_messages[1].cycle->bit_count(), 8);
  ASSERT_TRUE(map.command_messages[0].cycle.has_value());
  EXPECT_EQ(map.command_messages[0].cycle->bit_count(), 16);
}

TEST(SignalMap, TellsTheResolutionOfEachChannel) {
  const Mappings mappings{{"y1", {"Sensors_A.y1", -4.0, 0.0}}};
  const SignalMap map = make_signal_map(bench(), {"y1", "y2", "y3"}, {"u1"}, mappings);
  EXPECT_EQ(map.output_resolution, (std::vector<double>{2.0, 0.25, 0.0}));  // y3 is a float
  EXPECT_EQ(map.input_resolution, (std::vector<double>{0.1}));
}

TEST(SignalMap, TakesLongMessagesAndThoseSaidToBeFdForFd) {
  const SignalMap map = make_signal_map(bench("BA_ \"VFrameFormat\" BO_ 19 1;\n"), {"y1", "y3"},
                                        {"u1"}, kY1InSensors);
  EXPECT_FALSE(map.sensor_messages[0].is_fd);
  EXPECT_TRUE(map.sensor_messages[1].is_fd);   // 12 bytes
  EXPECT_TRUE(map.command_messages[0].is_fd);  // attribute
}

TEST(SignalMap, ListsTheIdentifiersOfAllMappedMessages) {
  const SignalMap map = make_signal_map(bench(), {"y1"}, {"u1"}, kY1InSensors);
  std::vector<std::uint32_t> ids;
  for (const IdFilter& filter : map.filters()) ids.push_back(filter.id);
  EXPECT_EQ(ids, (std::vector<std::uint32_t>{17, 19, 16}));
}

TEST(SignalMap, DoesWithoutSyncAndCounters) {
  const DbcDatabase dbc = parse_dbc(kMessages, "bench.dbc");
  const SignalMap map = make_signal_map(dbc, {"y2"}, {"u1"});
  EXPECT_FALSE(map.sync.has_value());
  EXPECT_FALSE(map.sensor_messages[0].cycle.has_value());
}

TEST(MappedMessage, GivesBackWhatItEncoded) {
  const Mappings mappings{{"y1", {"Sensors_A.y1", -2.0, 3.0}}};
  const SignalMap map = make_signal_map(bench(), {"y1", "y2", "y3"}, {"u1"}, mappings);
  const std::array<double, 3> values{-5.0, 1.5, 0.125};
  std::array<double, 3> decoded{};
  for (const MappedMessage& message : map.sensor_messages) {
    CanFrame frame;
    frame.data.fill(0xFF);
    EXPECT_EQ(message.encode(values, 0x12345, frame), 0u);
    EXPECT_TRUE(message.matches(frame));
    EXPECT_TRUE(is_well_formed(frame));
    EXPECT_EQ(frame.length, message.length);
    EXPECT_EQ(message.decode(frame, decoded), CodecStatus::kOk);
    std::int64_t cycle = 0;
    EXPECT_EQ(message.cycle->decode_raw(frame.payload(), cycle), CodecStatus::kOk);
    EXPECT_EQ(cycle, 0x12345 % (1 << message.cycle->bit_count()));
  }
  EXPECT_EQ(decoded, values);
}

TEST(MappedMessage, CountsValuesThatDoNotFit) {
  const SignalMap map = make_signal_map(bench(), {"y1", "y2"}, {}, kY1InSensors);
  CanFrame frame;
  const std::array<double, 2> values{1e9, std::numeric_limits<double>::quiet_NaN()};
  EXPECT_EQ(map.sensor_messages[0].encode(values, 0, frame), 2u);
  std::array<double, 2> decoded{};
  EXPECT_EQ(map.sensor_messages[0].decode(frame, decoded), CodecStatus::kOk);
  EXPECT_EQ(decoded[0], 32767 * 0.5);
  EXPECT_EQ(decoded[1], -10.0);  // raw 0
}

TEST(MappedMessage, WritesNoValueOfAShortFrame) {
  const SignalMap map = make_signal_map(bench(), {"y1", "y2"}, {}, kY1InSensors);
  CanFrame frame;
  const std::array<double, 2> values{1.0, 2.0};
  map.sensor_messages[0].encode(values, 0, frame);
  frame.length = 3;  // y1 is there, y2 is not
  std::array<double, 2> decoded{7.0, 7.0};
  EXPECT_EQ(map.sensor_messages[0].decode(frame, decoded), CodecStatus::kPayloadTooShort);
  EXPECT_EQ(decoded, (std::array<double, 2>{7.0, 7.0}));
}

TEST(MappedMessage, MatchesNoRemoteNoErrorAndNoOtherFormat) {
  const SignalMap map = make_signal_map(bench(), {"y2"}, {});
  CanFrame frame;
  frame.id = 17;
  EXPECT_TRUE(map.sensor_messages[0].matches(frame));
  frame.is_extended = true;
  EXPECT_FALSE(map.sensor_messages[0].matches(frame));
  frame.is_extended = false;
  frame.is_remote = true;
  EXPECT_FALSE(map.sensor_messages[0].matches(frame));
  frame.is_remote = false;
  frame.is_error = true;
  EXPECT_FALSE(map.sensor_messages[0].matches(frame));
}

TEST(SyncMessage, CarriesThirtyTwoBitsOfCycleAndCommandCycle) {
  const SignalMap map = make_signal_map(bench(), {"y2"}, {});
  CanFrame frame;
  map.sync->encode(0xFEDC'BA98, kNoCommand, frame);
  EXPECT_TRUE(map.sync->matches(frame));
  std::int64_t k = 0;
  std::int64_t c_k = 0;
  EXPECT_EQ(map.sync->cycle.decode_raw(frame.payload(), k), CodecStatus::kOk);
  EXPECT_EQ(map.sync->command_cycle->decode_raw(frame.payload(), c_k), CodecStatus::kOk);
  EXPECT_EQ(k, 0xFEDC'BA98);
  EXPECT_EQ(c_k, kNoCommand);
}

TEST(SignalMapErrors, SuggestTheNearestNames) {
  EXPECT_EQ(error_of(bench(), {"torque_lft"}, {}, {}),
            "bench.dbc:18:6: channel \"torque_lft\": found no signal \"torque_lft\" (the nearest: "
            "\"torque_left\"), expected one of that name");
  EXPECT_EQ(error_of(bench(), {"y2"}, {}, {{"y2", {"Sensor_A.y2", 1.0, 0.0}}}),
            "bench.dbc:6:6: channel \"y2\": found no signal \"Sensor_A.y2\" (the nearest: "
            "\"Sensors_A.y2\", \"Sensors_A.y1\", \"Sensors_B.y3\"), expected one of that name");
}

TEST(SignalMapErrors, NameTheChannelWhoseMappingIsToBlame) {
  const auto mapped_channel =
      [](const std::map<std::string, ChannelMapping, std::less<>>& mappings) {
        try {
          static_cast<void>(make_signal_map(bench(), {"y9"}, {}, mappings));
        } catch (const SignalMapError& error) {
          return error.mapped_channel();
        }
        return std::string("accepted");
      };
  EXPECT_EQ(mapped_channel({{"y9", {"Sensors_A.y9", 1.0, 0.0}}}), "y9");
  EXPECT_EQ(mapped_channel({}), "");
}

TEST(SignalMapErrors, PointAtTheStartOfADbcWithoutSignals) {
  EXPECT_EQ(error_of(parse_dbc("VERSION \"\"\nBS_:\nBU_:\n", "bench.dbc"), {"y1"}, {}, {}),
            "bench.dbc:1:1: channel \"y1\": found no signal \"y1\", expected one of that name");
}

TEST(SignalMapErrors, NameAllSignalsThatAChannelCouldBe) {
  EXPECT_EQ(error_of(bench(), {"y1"}, {}, {}),
            "bench.dbc:19:6: channel \"y1\": found 2 signals \"y1\", expected one; name its "
            "message: \"Sensors_A.y1\", \"Other.y1\"");
}

TEST(SignalMapErrors, TellOfAMappingOfNoChannel) {
  EXPECT_EQ(error_of(bench(), {"y2"}, {}, {{"y22", {"Sensors_A.y2", 1.0, 0.0}}}),
            "bench.dbc: found a mapping for \"y22\", which is no channel, expected one like "
            "\"y2\"");
}

TEST(SignalMapErrors, TellOfAScaleOfZero) {
  EXPECT_EQ(error_of(bench(), {"y2"}, {}, {{"y2", {"y2", 0.0, 0.0}}}),
            "bench.dbc: mapping of channel \"y2\": found scale 0 and offset 0, expected finite "
            "numbers and a scale other than zero");
}

TEST(SignalMapErrors, TellOfAMessageWithSensorsAndCommands) {
  EXPECT_EQ(error_of(bench(), {"y2"}, {"y1"}),
            "bench.dbc:4:5: message Sensors_A carries outputs and inputs (\"y1\"), expected one "
            "kind");
}

TEST(SignalMapErrors, TellOfASignalThatIsTwoChannels) {
  EXPECT_EQ(error_of(bench(), {"y2", "y3"}, {}, {{"y3", {"y2", 1.0, 0.0}}}),
            "bench.dbc:6:6: signal Sensors_A.y2 is channel \"y2\" and channel \"y3\"");
}

TEST(SignalMapErrors, TellOfAMultiplexedChannel) {
  EXPECT_EQ(error_of(bench(), {}, {"u2"}, {}),
            "bench.dbc:16:6: channel \"u2\": signal Commands.u2 is multiplexed, expected one "
            "that every frame of its message carries");
}

TEST(SignalMapErrors, TellOfAChannelBeyondItsMessage) {
  EXPECT_EQ(error_of(bench(), {"beyond"}, {}, {}),
            "bench.dbc:20:6: channel \"beyond\": signal Other.beyond needs 3 bytes, its message "
            "has 2");
}

TEST(SignalMapErrors, ListTheRolesThatThereAre) {
  EXPECT_EQ(error_of(bench("BA_ \"FaultlineRole\" SG_ 20 torque_left \"cycel\";"), {"y2"}, {}, {}),
            "bench.dbc:18:6: signal torque_left: found FaultlineRole \"cycel\", expected \"sync\", "
            "\"cycle\", \"command_cycle\", \"alive\", \"crc\", \"data_id_nibble\" or "
            "\"none\"");
}

TEST(SignalMapErrors, TellOfARoleTooNarrow) {
  EXPECT_EQ(error_of(bench("BA_ \"FaultlineRole\" SG_ 16 k \"\";\n"
                           "BA_ \"FaultlineRole\" SG_ 20 torque_left \"sync\";"),
                     {"y2"}, {}, {}),
            "bench.dbc:18:6: role sync: signal Other.torque_left has 8 bits, expected at least 32");
}

TEST(SignalMapErrors, TellOfARoleOnAFloat) {
  EXPECT_EQ(error_of(bench("BA_ \"FaultlineRole\" SG_ 16 k \"\";\n"
                           "BA_ \"FaultlineRole\" SG_ 18 y3 \"sync\";"),
                     {"y2"}, {}, {}),
            "bench.dbc:10:6: role sync: signal Sensors_B.y3 is a float, expected an integer");
}

TEST(SignalMapErrors, TellOfASecondSync) {
  EXPECT_EQ(error_of(bench("BA_ \"FaultlineRole\" SG_ 16 c \"sync\";"), {"y2"}, {}, {}),
            "bench.dbc:3:6: found a second signal of role sync, in message Sync, expected the one "
            "in Sync");
}

TEST(SignalMapErrors, TellOfASyncThatCarriesChannels) {
  EXPECT_EQ(error_of(bench(), {"c"}, {}, {}),
            "bench.dbc:1:5: message Sync has the role sync and carries channels, expected a "
            "message of its own");
}

TEST(SignalMapErrors, TellOfACommandCycleElsewhere) {
  EXPECT_EQ(error_of(bench("BA_ \"FaultlineRole\" SG_ 16 c \"\";\n"
                           "BA_ \"FaultlineRole\" SG_ 18 y3 \"command_cycle\";"),
                     {"y2"}, {}, {}),
            "bench.dbc:10:6: role command_cycle: signal Sensors_B.y3 is in a message without role "
            "sync, expected it beside that");
}

TEST(SignalMapErrors, TellOfTwoCountersInAMessage) {
  EXPECT_EQ(error_of(bench("BA_ \"FaultlineRole\" SG_ 17 alive \"cycle\";"), {"y2"}, {}, {}),
            "bench.dbc:8:6: message Sensors_A has two signals of role cycle, expected one");
}

TEST(SignalMapErrors, TellOfTwoMessagesWithOneIdentifier) {
  const DbcDatabase dbc = bench("BO_ 17 Twin: 8 P\n SG_ y9 : 0|8@1+ (1,0) [0|0] \"\" C\n");
  EXPECT_EQ(error_of(dbc, {"y2", "y9"}, {}, {}),
            "bench.dbc:37:5: messages Sensors_A and Twin have the same identifier 17");
}

TEST(SignalMapErrors, TellOfAChecksumThatNothingExplains) {
  EXPECT_EQ(error_of(bench("BA_ \"FaultlineProtection\" BO_ 19 \"none\";"), {}, {"u1"}, {}),
            "bench.dbc:15:6: signal Commands.crc has the role crc, and its message "
            "FaultlineProtection none, expected one that says how it is made");
}

TEST(SignalMapErrors, TellOfAChannelInTheBitsOfTheCounter) {
  const DbcDatabase dbc = bench(
      "BO_ 21 Narrow: 8 P\n SG_ y9 : 0|9@1+ (1,0) [0|0] \"\" C\n"
      " SG_ n : 8|4@1+ (1,0) [0|0] \"\" C\nBA_ \"FaultlineRole\" SG_ 21 n \"alive\";\n");
  EXPECT_EQ(error_of(dbc, {"y9"}, {}, {}),
            "bench.dbc:38:6: signal Narrow.y9 overlaps n, which protects the message");
  EXPECT_EQ(error_of(dbc, {"n"}, {}, {}),
            "bench.dbc:39:6: signal Narrow.n is channel \"n\" and protects its message");
}

TEST(SignalMapErrors, TellOfABusThatCannotBe) {
  EXPECT_EQ(error_of(bench("BA_ \"FaultlineBus\" BO_ 17 256;"), {"y2"}, {}, {}),
            "bench.dbc:4:5: message Sensors_A: found FaultlineBus 256, expected an integer of 0 "
            ".. 255");
}

TEST(SignalMap, TakesFramesOfTheBusOnWhichAMessageLives) {
  const SignalMap map =
      make_signal_map(bench("BA_ \"FaultlineBus\" BO_ 17 3;"), {"y2"}, {"u1"}, {});
  CanFrame frame;
  map.sensor_messages[0].encode(std::array{1.0}, 0, frame);
  EXPECT_EQ(frame.bus, 3);
  EXPECT_TRUE(map.sensor_messages[0].matches(frame));
  frame.bus = 0;
  EXPECT_FALSE(map.sensor_messages[0].matches(frame));
  EXPECT_TRUE(map.sync.has_value());
  map.sync->encode(1, 2, frame);
  EXPECT_TRUE(map.sync->matches(frame));
  frame.bus = 3;
  EXPECT_FALSE(map.sync->matches(frame));
}

TEST(SignalMap, CountsItsMessagesTogether) {
  const SignalMap map = make_signal_map(bench(), {"y2"}, {"u1"}, {});
  EXPECT_EQ(map.message_count(), 3u);
  EXPECT_EQ(map.message_name(0), "Sensors_A");
  EXPECT_EQ(map.message_name(1), "Commands");
  EXPECT_EQ(map.message_name(2), "Sync");
  EXPECT_TRUE(map.message_protection(0).has_counter());
  EXPECT_FALSE(map.message_protection(0).has_crc());
  EXPECT_TRUE(map.message_protection(1).has_crc());
  EXPECT_TRUE(map.message_protection(2).is_none());
}

}  // namespace
}  // namespace faultline
