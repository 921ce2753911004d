#include "drivers/dbc/dbc_database.h"

#include <algorithm>

namespace faultline {
namespace {

template <class Named>
const Named* find_by_name(const std::vector<Named>& items, std::string_view name) noexcept {
  const auto found = std::find_if(items.begin(), items.end(),
                                  [&](const Named& item) { return item.name == name; });
  return found == items.end() ? nullptr : &*found;
}

const DbcAttributeValue* find_value(const DbcAttributes& own, const DbcAttributes& defaults,
                                    std::string_view name) noexcept {
  const auto found = own.find(name);
  if (found != own.end()) return &found->second;
  const auto fallback = defaults.find(name);
  return fallback == defaults.end() ? nullptr : &fallback->second;
}

}  // namespace

std::size_t payload_bytes_needed(const DbcSignal& signal) noexcept {
  std::size_t first_bit = signal.start_bit;
  if (signal.byte_order == ByteOrder::kBigEndian) {
    // Count along the wire: the most significant bit of each byte comes first.
    first_bit = first_bit / 8 * 8 + (7 - first_bit % 8);
  }
  return (first_bit + signal.bit_count - 1) / 8 + 1;
}

const DbcSignal* DbcMessage::find_signal(std::string_view signal_name) const noexcept {
  return find_by_name(signals, signal_name);
}

const DbcMessage* DbcDatabase::find_message(std::string_view message_name) const noexcept {
  return find_by_name(messages, message_name);
}

const DbcMessage* DbcDatabase::find_message(std::uint32_t id, bool is_extended) const noexcept {
  const auto found = std::find_if(messages.begin(), messages.end(), [&](const DbcMessage& message) {
    return message.id == id && message.is_extended == is_extended;
  });
  return found == messages.end() ? nullptr : &*found;
}

const DbcAttributeValue* DbcDatabase::attribute_of(const DbcMessage& message,
                                                   std::string_view name) const noexcept {
  return find_value(message.attributes, default_attributes, name);
}

const DbcAttributeValue* DbcDatabase::attribute_of(const DbcSignal& signal,
                                                   std::string_view name) const noexcept {
  return find_value(signal.attributes, default_attributes, name);
}

}  // namespace faultline
