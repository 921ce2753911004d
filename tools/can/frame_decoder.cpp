#include "tools/can/frame_decoder.h"

#include <algorithm>
#include <string>
#include <variant>

namespace faultline {
namespace {

constexpr std::uint32_t kExtendedKey = 0x8000'0000;
/// J1939-21: PDU format below 240 addresses one node, whose address stands in the next byte.
constexpr std::uint32_t kFirstBroadcastFormat = 240;

std::uint32_t identifier_key(std::uint32_t id, bool is_extended) noexcept {
  return id | (is_extended ? kExtendedKey : 0);
}

/// Parameter group number of a 29-bit identifier: without priority, source and destination.
std::uint32_t parameter_group(std::uint32_t id) noexcept {
  const std::uint32_t group = (id >> 8) & 0x3FFFF;
  return ((group >> 8) & 0xFF) < kFirstBroadcastFormat ? group & 0x3FF00 : group;
}

bool is_parameter_group(const DbcDatabase& dbc, const DbcMessage& message) noexcept {
  const DbcAttributeValue* const format = dbc.attribute_of(message, "VFrameFormat");
  const auto* const text = format == nullptr ? nullptr : std::get_if<std::string>(format);
  return message.is_extended && text != nullptr && *text == "J1939PG";
}

template <class Map>
const std::size_t* find(const Map& map, std::uint32_t key) noexcept {
  const auto found = map.find(key);
  return found == map.end() ? nullptr : &found->second;
}

}  // namespace

FrameDecoder::FrameDecoder(const DbcDatabase& dbc) : dbc_(&dbc) {
  codecs_.reserve(dbc.messages.size());
  std::size_t most_signals = 0;
  for (std::size_t i = 0; i < dbc.messages.size(); ++i) {
    const DbcMessage& message = dbc.messages[i];
    codecs_.emplace_back(message);
    most_signals = std::max(most_signals, message.signals.size());
    by_identifier_.try_emplace(identifier_key(message.id, message.is_extended), i);
    if (is_parameter_group(dbc, message)) {
      by_parameter_group_.try_emplace(parameter_group(message.id), i);
    }
  }
  values_.resize(most_signals);
  presence_.resize(most_signals);
}

const DbcMessage* FrameDecoder::find_message(const CanFrame& frame) const noexcept {
  if (frame.is_error) return nullptr;
  const std::size_t* found = find(by_identifier_, identifier_key(frame.id, frame.is_extended));
  if (found == nullptr && frame.is_extended) {
    found = find(by_parameter_group_, parameter_group(frame.id));
  }
  return found == nullptr ? nullptr : &dbc_->messages[*found];
}

const MessageCodec& FrameDecoder::codec_of(const DbcMessage& message) const noexcept {
  return codecs_[static_cast<std::size_t>(&message - dbc_->messages.data())];
}

DecodedFrame FrameDecoder::decode(const CanFrame& frame) noexcept {
  const DbcMessage* const message = find_message(frame);
  if (message == nullptr) return {};
  const std::size_t count = message->signals.size();
  const std::span<const std::uint8_t> payload =
      frame.is_remote ? std::span<const std::uint8_t>() : frame.payload();
  codec_of(*message).decode(payload, values_, presence_);
  return {message, std::span(values_).first(count), std::span(presence_).first(count)};
}

}  // namespace faultline
