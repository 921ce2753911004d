#include "drivers/signal/signal_map.h"

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <limits>
#include <numeric>
#include <tuple>
#include <utility>

#include <fmt/format.h>

namespace faultline {
namespace {

constexpr std::string_view kFrameFormatAttribute = "VFrameFormat";  // Vector's name for it
constexpr std::uint16_t kSyncBits = 32;                             // k and c_k are u32
constexpr std::uint16_t kCycleBits = 4;  // counters tell 16 cycles apart (docs/design.md)
constexpr std::size_t kShownNames = 3;   // as many suggestions as a reader takes in

/// Levenshtein's distance: insertions, deletions and substitutions from one text to the other.
std::size_t edit_distance(std::string_view from, std::string_view to) {
  std::vector<std::size_t> row(to.size() + 1);
  std::iota(row.begin(), row.end(), std::size_t{0});
  for (std::size_t a = 0; a < from.size(); ++a) {
    std::size_t diagonal = std::exchange(row[0], a + 1);
    for (std::size_t b = 0; b < to.size(); ++b) {
      const std::size_t substituted = diagonal + (from[a] == to[b] ? 0 : 1);
      diagonal = row[b + 1];
      row[b + 1] = std::min({substituted, row[b] + 1, diagonal + 1});
    }
  }
  return row.back();
}

std::string join_quoted(const std::vector<std::string>& names) {
  return fmt::format("\"{}\"", fmt::join(names, "\", \""));
}

/// The names most like `wanted`, quoted: the nearest, and those that share about half with it.
std::string nearest_names(std::string_view wanted, std::vector<std::string> names) {
  std::stable_sort(names.begin(), names.end(), [&](const std::string& a, const std::string& b) {
    return edit_distance(wanted, a) < edit_distance(wanted, b);
  });
  if (names.empty()) return {};
  names.erase(std::unique(names.begin(), names.end()), names.end());
  names.resize(std::min(names.size(), kShownNames));
  while (names.size() > 1 && edit_distance(wanted, names.back()) > wanted.size() / 2) {
    names.pop_back();
  }
  return join_quoted(names);
}

/// A signal with the message it is in.
struct PlacedSignal {
  const DbcMessage* message = nullptr;
  const DbcSignal* signal = nullptr;

  [[nodiscard]] std::string full_name() const { return message->name + "." + signal->name; }
};

enum class Side { kOutputs, kInputs };

/// Builds one map; use once.
class SignalMapBuilder {
 public:
  using Mappings = std::map<std::string, ChannelMapping, std::less<>>;

  SignalMapBuilder(const DbcDatabase& dbc, const Mappings& mappings)
      : dbc_(dbc), mappings_(mappings) {}

  SignalMap build(const std::vector<std::string>& output_names,
                  const std::vector<std::string>& input_names) {
    map_.output_names = output_names;
    map_.input_names = input_names;
    require_mappings_known();
    map_side(Side::kOutputs);
    map_side(Side::kInputs);
    for (const DbcMessage& message : dbc_.messages) add_roles(message);
    require_command_cycle_in_sync();
    for (const auto& [message, mapped] : mapped_) require_untouched(*message);
    if (sync_message_ != nullptr) require_untouched(*sync_message_);
    require_distinct_identifiers();
    return std::move(map_);
  }

 private:
  struct SideView {
    const std::vector<std::string>& names;
    std::vector<double>& resolution;
    std::vector<MappedMessage>& messages;
  };
  SideView view(Side side) {
    if (side == Side::kOutputs) {
      return {map_.output_names, map_.output_resolution, map_.sensor_messages};
    }
    return {map_.input_names, map_.input_resolution, map_.command_messages};
  }

  [[noreturn]] void fail(const std::string& text) const {
    throw SignalMapError(fmt::format("{}: {}", dbc_.source, text));
  }
  [[noreturn]] void fail(DbcPosition position, const std::string& text) const {
    throw SignalMapError(
        fmt::format("{}:{}:{}: {}", dbc_.source, position.line, position.column, text));
  }

  void require_mappings_known() const;
  void map_side(Side side);
  [[nodiscard]] PlacedSignal find_signal(const std::string& channel,
                                         const std::string& signal_name) const;
  [[noreturn]] void fail_missing(const std::string& channel, const std::string& signal_name) const;
  [[nodiscard]] std::vector<PlacedSignal> find_candidates(std::string_view name) const;
  [[nodiscard]] std::vector<std::string> signal_names(bool with_message) const;
  void require_usable(const std::string& channel, const PlacedSignal& placed) const;

  template <class Mapped>
  void describe(const DbcMessage& message, Mapped& mapped) const;
  void require_untouched(const DbcMessage& message) const;
  void add_roles(const DbcMessage& message);
  [[nodiscard]] SignalCodec counter_codec(const DbcMessage& message, const DbcSignal& signal,
                                          std::string_view role, std::uint16_t least_bits) const;
  void set_cycle(const DbcMessage& message, const DbcSignal& signal);
  void set_sync(const DbcMessage& message, const DbcSignal& signal);
  void set_command_cycle(const DbcMessage& message, const DbcSignal& signal);
  void require_command_cycle_in_sync();
  void require_distinct_identifiers() const;
  [[nodiscard]] bool is_fd(const DbcMessage& message) const;

  const DbcDatabase& dbc_;
  const Mappings& mappings_;
  SignalMap map_;
  std::map<const DbcSignal*, std::string> channel_of_;  ///< signals taken
  std::map<const DbcMessage*, Side> side_of_;           ///< messages that carry channels
  std::map<const DbcMessage*, MappedMessage*> mapped_;  ///< valid once both sides are mapped
  const DbcMessage* sync_message_ = nullptr;
  PlacedSignal command_cycle_;
};

void SignalMapBuilder::require_mappings_known() const {
  std::vector<std::string> channels = map_.output_names;
  channels.insert(channels.end(), map_.input_names.begin(), map_.input_names.end());
  for (const auto& [channel, mapping] : mappings_) {
    if (std::find(channels.begin(), channels.end(), channel) == channels.end()) {
      fail(fmt::format("found a mapping for \"{}\", which is no channel, expected one like {}",
                       channel, nearest_names(channel, channels)));
    }
    if (mapping.scale == 0.0 || !std::isfinite(mapping.scale) || !std::isfinite(mapping.offset)) {
      fail(
          fmt::format("mapping of channel \"{}\": found scale {} and offset {}, expected finite "
                      "numbers and a scale other than zero",
                      channel, mapping.scale, mapping.offset));
    }
  }
}

void SignalMapBuilder::map_side(Side side) {
  const SideView sides = view(side);
  std::map<const DbcMessage*, std::vector<MappedSignal>> channels_of;
  for (std::size_t channel = 0; channel < sides.names.size(); ++channel) {
    const std::string& name = sides.names[channel];
    const auto found = mappings_.find(name);
    const ChannelMapping mapping =
        found == mappings_.end() ? ChannelMapping{name, 1.0, 0.0} : found->second;
    const PlacedSignal placed = find_signal(name, mapping.signal);
    require_usable(name, placed);
    const auto [owner, is_first] = channel_of_.emplace(placed.signal, name);
    if (!is_first) {
      fail(placed.signal->position, fmt::format("signal {} is channel \"{}\" and channel \"{}\"",
                                                placed.full_name(), owner->second, name));
    }
    if (side_of_.emplace(placed.message, side).first->second != side) {
      fail(placed.message->position,
           fmt::format("message {} carries outputs and inputs (\"{}\"), expected one kind",
                       placed.message->name, name));
    }
    const SignalCodec codec(*placed.signal);
    const bool is_float =
        placed.signal->type == SignalType::kFloat32 || placed.signal->type == SignalType::kFloat64;
    sides.resolution.push_back(is_float ? 0.0 : std::abs(codec.factor() * mapping.scale));
    channels_of[placed.message].push_back({channel, codec, mapping.scale, mapping.offset});
  }
  sides.messages.reserve(channels_of.size());
  for (const DbcMessage& message : dbc_.messages) {
    const auto found = channels_of.find(&message);
    if (found == channels_of.end()) continue;
    MappedMessage& mapped = sides.messages.emplace_back();
    describe(message, mapped);
    mapped.channels = std::move(found->second);
    mapped_[&message] = &sides.messages.back();
  }
}

std::vector<PlacedSignal> SignalMapBuilder::find_candidates(std::string_view name) const {
  std::vector<PlacedSignal> candidates;
  const std::size_t dot = name.find('.');
  const bool has_message = dot != std::string_view::npos;
  const std::string_view signal_name = has_message ? name.substr(dot + 1) : name;
  for (const DbcMessage& message : dbc_.messages) {
    if (has_message && message.name != name.substr(0, dot)) continue;
    for (const DbcSignal& signal : message.signals) {
      if (signal.name == signal_name) candidates.push_back({&message, &signal});
    }
  }
  return candidates;
}

std::vector<std::string> SignalMapBuilder::signal_names(bool with_message) const {
  std::vector<std::string> names;
  for (const DbcMessage& message : dbc_.messages) {
    for (const DbcSignal& signal : message.signals) {
      names.push_back(with_message ? PlacedSignal{&message, &signal}.full_name() : signal.name);
    }
  }
  return names;
}

/// Points at the signal with the nearest name, or at the start of a DBC without signals.
void SignalMapBuilder::fail_missing(const std::string& channel,
                                    const std::string& signal_name) const {
  const bool with_message = signal_name.find('.') != std::string::npos;
  DbcPosition position;
  std::size_t least = std::numeric_limits<std::size_t>::max();
  for (const DbcMessage& message : dbc_.messages) {
    for (const DbcSignal& signal : message.signals) {
      const PlacedSignal placed{&message, &signal};
      const std::size_t distance =
          edit_distance(signal_name, with_message ? placed.full_name() : signal.name);
      if (distance >= least) continue;
      least = distance;
      position = signal.position;
    }
  }
  const std::string nearest = nearest_names(signal_name, signal_names(with_message));
  const std::string text =
      fmt::format("{}:{}:{}: channel \"{}\": found no signal \"{}\"{}, expected one of that name",
                  dbc_.source, position.line, position.column, channel, signal_name,
                  nearest.empty() ? "" : fmt::format(" (the nearest: {})", nearest));
  throw SignalMapError(text, mappings_.contains(channel) ? channel : "");
}

PlacedSignal SignalMapBuilder::find_signal(const std::string& channel,
                                           const std::string& signal_name) const {
  const std::vector<PlacedSignal> candidates = find_candidates(signal_name);
  if (candidates.size() == 1) return candidates.front();
  if (candidates.empty()) {
    fail_missing(channel, signal_name);
  }
  std::vector<std::string> full_names;
  full_names.reserve(candidates.size());
  for (const PlacedSignal& candidate : candidates) full_names.push_back(candidate.full_name());
  fail(candidates[1].signal->position,
       fmt::format("channel \"{}\": found {} signals \"{}\", expected one; name its message: {}",
                   channel, candidates.size(), signal_name, join_quoted(full_names)));
}

void SignalMapBuilder::require_usable(const std::string& channel,
                                      const PlacedSignal& placed) const {
  const DbcSignal& signal = *placed.signal;
  if (signal.multiplexer != DbcSignal::kAlwaysPresent) {
    fail(signal.position,
         fmt::format(
             "channel \"{}\": signal {} is multiplexed, expected one that every frame of its "
             "message carries",
             channel, placed.full_name()));
  }
  try {
    static_cast<void>(SignalCodec(signal));
  } catch (const std::invalid_argument& error) {
    fail(signal.position, fmt::format("channel \"{}\": {}", channel, error.what()));
  }
  if (placed.message->length > kMaxPayload) {
    fail(placed.message->position,
         fmt::format("channel \"{}\": message {} has {} bytes, expected up to {}", channel,
                     placed.message->name, placed.message->length, kMaxPayload));
  }
  if (payload_bytes_needed(signal) > placed.message->length) {
    fail(signal.position,
         fmt::format("channel \"{}\": signal {} needs {} bytes, its message has {}", channel,
                     placed.full_name(), payload_bytes_needed(signal), placed.message->length));
  }
}

/// What MappedMessage and SyncMessage have in common.
template <class Mapped>
void SignalMapBuilder::describe(const DbcMessage& message, Mapped& mapped) const {
  mapped.name = message.name;
  mapped.id = message.id;
  mapped.is_extended = message.is_extended;
  mapped.length = static_cast<std::uint8_t>(message.length);
  mapped.is_fd = is_fd(message);
  mapped.bus = bus_of(dbc_, message).value_or(0);
  mapped.protection = compile_protection(dbc_, message);
}

/// What protects a message is written last: nothing that we write or read may lie in its bits.
void SignalMapBuilder::require_untouched(const DbcMessage& message) const {
  const auto protects = [&](const DbcSignal& signal) {
    const SignalRole role = role_of(dbc_, signal);
    return role == SignalRole::kAlive || role == SignalRole::kCrc ||
           role == SignalRole::kDataIdNibble;
  };
  for (const DbcSignal& signal : message.signals) {
    if (channel_of_.contains(&signal) && protects(signal)) {
      fail(signal.position, fmt::format("signal {} is channel \"{}\" and protects its message",
                                        PlacedSignal{&message, &signal}.full_name(),
                                        channel_of_.find(&signal)->second));
    }
    const bool is_used = channel_of_.contains(&signal) ||
                         (role_of(dbc_, signal) != SignalRole::kNone && !protects(signal));
    for (const DbcSignal& other : message.signals) {
      if (!is_used || !protects(other) || !overlap(signal, other)) continue;
      fail(signal.position, fmt::format("signal {} overlaps {}, which protects the message",
                                        PlacedSignal{&message, &signal}.full_name(), other.name));
    }
  }
}

void SignalMapBuilder::add_roles(const DbcMessage& message) {
  for (const DbcSignal& signal : message.signals) {
    switch (role_of(dbc_, signal)) {
      case SignalRole::kSync:
        set_sync(message, signal);
        break;
      case SignalRole::kCycle:
        set_cycle(message, signal);
        break;
      case SignalRole::kCommandCycle:
        set_command_cycle(message, signal);
        break;
      case SignalRole::kAlive:
      case SignalRole::kCrc:
      case SignalRole::kDataIdNibble:
      case SignalRole::kNone:
        break;
    }
  }
}

SignalCodec SignalMapBuilder::counter_codec(const DbcMessage& message, const DbcSignal& signal,
                                            std::string_view role, std::uint16_t least_bits) const {
  const PlacedSignal placed{&message, &signal};
  require_usable(std::string(role), placed);
  if (signal.type == SignalType::kFloat32 || signal.type == SignalType::kFloat64) {
    fail(signal.position, fmt::format("role {}: signal {} is a float, expected an integer", role,
                                      placed.full_name()));
  }
  if (signal.bit_count < least_bits) {
    fail(signal.position, fmt::format("role {}: signal {} has {} bits, expected at least {}", role,
                                      placed.full_name(), signal.bit_count, least_bits));
  }
  return SignalCodec(signal);
}

void SignalMapBuilder::set_cycle(const DbcMessage& message, const DbcSignal& signal) {
  const auto found = mapped_.find(&message);
  if (found == mapped_.end()) return;  // a message that carries no channel of ours
  if (found->second->cycle) {
    fail(signal.position,
         fmt::format("message {} has two signals of role cycle, expected one", message.name));
  }
  found->second->cycle = counter_codec(message, signal, "cycle", kCycleBits);
}

void SignalMapBuilder::set_sync(const DbcMessage& message, const DbcSignal& signal) {
  if (sync_message_ != nullptr) {
    fail(signal.position, fmt::format("found a second signal of role sync, in message {}, expected "
                                      "the one in {}",
                                      message.name, sync_message_->name));
  }
  if (mapped_.contains(&message)) {
    fail(message.position,
         fmt::format("message {} has the role sync and carries channels, expected a message of its "
                     "own",
                     message.name));
  }
  sync_message_ = &message;
  const SignalCodec codec = counter_codec(message, signal, "sync", kSyncBits);
  SyncMessage& sync = map_.sync.emplace();
  describe(message, sync);
  sync.cycle = codec;
}

void SignalMapBuilder::set_command_cycle(const DbcMessage& message, const DbcSignal& signal) {
  if (command_cycle_.signal != nullptr) {
    fail(signal.position, "found a second signal of role command_cycle, expected one");
  }
  command_cycle_ = {&message, &signal};
}

void SignalMapBuilder::require_command_cycle_in_sync() {
  if (command_cycle_.signal == nullptr) return;
  const DbcSignal& signal = *command_cycle_.signal;
  if (command_cycle_.message != sync_message_) {
    fail(signal.position,
         fmt::format("role command_cycle: signal {} is in a message without role sync, expected it "
                     "beside that",
                     command_cycle_.full_name()));
  }
  map_.sync->command_cycle =
      counter_codec(*command_cycle_.message, signal, "command_cycle", kSyncBits);
}

void SignalMapBuilder::require_distinct_identifiers() const {
  std::map<std::tuple<std::uint8_t, bool, std::uint32_t>, std::string> names;
  const auto require_new = [&](const auto& message) {
    const auto [owner, is_new] =
        names.emplace(std::tuple{message.bus, message.is_extended, message.id}, message.name);
    if (!is_new) {
      fail(dbc_.find_message(message.name)->position,
           fmt::format("messages {} and {} have the same identifier {}", owner->second,
                       message.name, message.id));
    }
  };
  for (const MappedMessage& message : map_.sensor_messages) require_new(message);
  for (const MappedMessage& message : map_.command_messages) require_new(message);
  if (map_.sync) require_new(*map_.sync);
}

bool SignalMapBuilder::is_fd(const DbcMessage& message) const {
  if (message.length > kMaxClassicPayload) return true;
  const DbcAttributeValue* const format = dbc_.attribute_of(message, kFrameFormatAttribute);
  const auto* const text = format == nullptr ? nullptr : std::get_if<std::string>(format);
  return text != nullptr && text->ends_with("_FD");
}

/// An empty frame with the identifier and shape of `message`.
template <class Message>
CanFrame blank_frame(const Message& message) noexcept {
  CanFrame frame;
  frame.id = message.id;
  frame.is_extended = message.is_extended;
  frame.length = message.length;
  frame.is_fd = message.is_fd;
  frame.bus = message.bus;
  return frame;
}

std::span<std::uint8_t> payload_of(CanFrame& frame) noexcept {
  return {frame.data.data(), frame.length};
}

}  // namespace

std::size_t MappedMessage::encode(std::span<const double> values, std::uint32_t cycle_number,
                                  CanFrame& frame) const noexcept {
  frame = blank_frame(*this);
  std::size_t clamped = 0;
  for (const MappedSignal& mapped : channels) {
    const double physical = (values[mapped.channel] - mapped.offset) / mapped.scale;
    const CodecStatus status = mapped.codec.encode_physical(payload_of(frame), physical);
    clamped += status == CodecStatus::kOk ? 0 : 1;
  }
  // make_signal_map checked that the counter lies within the message.
  if (cycle) static_cast<void>(cycle->encode_raw(payload_of(frame), cycle_number));
  return clamped;
}

CodecStatus MappedMessage::decode(const CanFrame& frame, std::span<double> values) const noexcept {
  double physical = 0.0;
  for (const MappedSignal& mapped : channels) {
    const CodecStatus status = mapped.codec.decode_physical(frame.payload(), physical);
    if (status != CodecStatus::kOk) return status;
  }
  for (const MappedSignal& mapped : channels) {
    static_cast<void>(mapped.codec.decode_physical(frame.payload(), physical));
    values[mapped.channel] = mapped.scale * physical + mapped.offset;
  }
  return CodecStatus::kOk;
}

std::vector<MessageProtector> protectors(const std::vector<MappedMessage>& messages) {
  std::vector<MessageProtector> made;
  made.reserve(messages.size());
  for (const MappedMessage& message : messages) made.emplace_back(message.protection);
  return made;
}

void SyncMessage::encode(std::uint32_t k, std::uint32_t c_k, CanFrame& frame) const noexcept {
  frame = blank_frame(*this);
  static_cast<void>(cycle.encode_raw(payload_of(frame), k));
  if (command_cycle) static_cast<void>(command_cycle->encode_raw(payload_of(frame), c_k));
}

const std::string& SignalMap::message_name(std::size_t message) const noexcept {
  assert(message < message_count());
  if (message < sensor_messages.size()) return sensor_messages[message].name;
  message -= sensor_messages.size();
  return message < command_messages.size() ? command_messages[message].name : sync->name;
}

const MessageProtection& SignalMap::message_protection(std::size_t message) const noexcept {
  assert(message < message_count());
  if (message < sensor_messages.size()) return sensor_messages[message].protection;
  message -= sensor_messages.size();
  return message < command_messages.size() ? command_messages[message].protection
                                           : sync->protection;
}

std::vector<IdFilter> SignalMap::filters() const {
  std::vector<IdFilter> filters;
  for (const MappedMessage& message : sensor_messages) {
    filters.push_back({message.id, message.is_extended});
  }
  for (const MappedMessage& message : command_messages) {
    filters.push_back({message.id, message.is_extended});
  }
  if (sync) filters.push_back({sync->id, sync->is_extended});
  return filters;
}

SignalMap make_signal_map(const DbcDatabase& dbc, const std::vector<std::string>& output_names,
                          const std::vector<std::string>& input_names,
                          const std::map<std::string, ChannelMapping, std::less<>>& mappings) {
  try {
    return SignalMapBuilder(dbc, mappings).build(output_names, input_names);
  } catch (const ProtectionError& error) {
    throw SignalMapError(error.what());
  }
}

}  // namespace faultline
