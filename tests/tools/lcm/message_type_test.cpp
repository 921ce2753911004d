#include "tools/lcm/message_type.h"

#include <set>
#include <string>
#include <vector>

#include <faultline/can_t.hpp>
#include <faultline/event_t.hpp>
#include <gtest/gtest.h>

#include "tools/lcm/channels.h"

namespace faultline {
namespace {

template <class Message>
std::vector<std::uint8_t> encoded(const Message& message) {
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(message.getEncodedSize()));
  message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  return bytes;
}

event_t some_event() {
  event_t event{};
  event.utime = 1'700'000'000'000'001;
  event.sequence = 258;
  event.cycle = 7;
  event.text = "text";
  return event;
}

MessageStatus status_of(const std::vector<std::uint8_t>& data) {
  MessageHead head;
  return read_head(*find_message_type(kEventChannel), data, head);
}

TEST(MessageType, IsKnownForEveryChannelOfARun) {
  std::set<std::int64_t> fingerprints;
  for (const MessageType& type : message_types()) {
    EXPECT_EQ(find_message_type(type.channel), &type);
    fingerprints.insert(type.fingerprint);
  }
  EXPECT_EQ(fingerprints.size(), message_types().size());
  EXPECT_EQ(find_message_type("SOMETHING_ELSE"), nullptr);
}

TEST(MessageType, ReadsTheHeadOfAWholeMessage) {
  MessageHead head;
  ASSERT_EQ(read_head(*find_message_type(kEventChannel), encoded(some_event()), head),
            MessageStatus::kWhole);
  EXPECT_EQ(head.utime, 1'700'000'000'000'001);
  EXPECT_EQ(head.sequence, 258);
  EXPECT_EQ(head.cycle, 7);
}

TEST(MessageType, GivesNoCycleToMessagesWithoutOne) {
  can_t can{};
  can.sequence = 3;
  can.first_frame = 12;
  MessageHead head;
  ASSERT_EQ(read_head(*find_message_type(kCanChannel), encoded(can), head), MessageStatus::kWhole);
  EXPECT_EQ(head.sequence, 3);
  EXPECT_EQ(head.cycle, -1);
}

TEST(MessageType, TellsAnotherSchemaFromDamage) {
  const std::vector<std::uint8_t> whole = encoded(some_event());
  for (std::size_t at = 0; at < 8; ++at) {
    std::vector<std::uint8_t> other = whole;
    other[at] ^= 1;
    EXPECT_EQ(status_of(other), MessageStatus::kOtherSchema) << at;
  }
  for (std::size_t size = 0; size < whole.size(); ++size) {
    EXPECT_EQ(status_of({whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(size)}),
              MessageStatus::kDamaged)
        << size;
  }
  std::vector<std::uint8_t> longer = whole;
  longer.push_back(0);
  EXPECT_EQ(status_of(longer), MessageStatus::kDamaged);
}

TEST(MessageType, RefusesNumbersThatNoRunReaches) {
  for (const std::int64_t number : {std::int64_t{-1}, std::int64_t{1} << 62}) {
    event_t event = some_event();
    event.sequence = number;
    EXPECT_EQ(status_of(encoded(event)), MessageStatus::kDamaged);
  }
  event_t event = some_event();
  event.cycle = -1;
  EXPECT_EQ(status_of(encoded(event)), MessageStatus::kWhole);
  event.cycle = -2;
  EXPECT_EQ(status_of(encoded(event)), MessageStatus::kDamaged);
}

}  // namespace
}  // namespace faultline
