#include "drivers/signal/traffic_monitor.h"

#include <algorithm>
#include <bit>
#include <stdexcept>

namespace faultline {
namespace {

/// Identifier and bus in one number, never the same for two of them.
constexpr std::uint64_t key_of(std::uint8_t bus, std::uint32_t id, bool is_extended) noexcept {
  return std::uint64_t{bus} << 33 | std::uint64_t{is_extended} << 32 | id;
}

/// Odd, about 2^64 divided by the golden ratio: spreads neighbouring identifiers (Knuth, The Art of
/// Computer Programming, vol. 3, 6.4).
constexpr std::uint64_t kSpread = 0x9E3779B97F4A7C15;

/// to - from, as much of it as nanoseconds hold: stamps of a broken log may be centuries apart.
std::chrono::nanoseconds time_between(Timestamp from, Timestamp to) noexcept {
  std::int64_t difference_ns = 0;
  if (__builtin_sub_overflow(to.time_since_epoch().count(), from.time_since_epoch().count(),
                             &difference_ns)) {
    return to < from ? std::chrono::nanoseconds::min() : std::chrono::nanoseconds::max();
  }
  return std::chrono::nanoseconds(difference_ns);
}

}  // namespace

std::optional<std::chrono::nanoseconds> age(const IdentifierTraffic& traffic,
                                            Timestamp now) noexcept {
  if (!traffic.has_good_frame) return std::nullopt;
  return time_between(traffic.last_good_stamp, now);
}

SignalState state(const IdentifierTraffic& traffic, Timestamp now) noexcept {
  if (traffic.data_frames() == 0) return SignalState::kNeverSeen;
  const PeriodStatistics& period = traffic.period;
  if (period.has_period() &&
      time_between(traffic.last_frame.stamp, now) > kStalePeriods * period.period()) {
    return SignalState::kStale;
  }
  switch (traffic.last_check.status) {
    case IntegrityStatus::kOk:
      return SignalState::kFresh;
    case IntegrityStatus::kCounterGap:
    case IntegrityStatus::kCounterRepeated:
    case IntegrityStatus::kCounterOutOfRange:
      return SignalState::kCounterError;
    case IntegrityStatus::kWrongCrc:
    case IntegrityStatus::kTooShort:
      break;
  }
  return SignalState::kCrcError;
}

TrafficMonitor::TrafficMonitor(const DbcDatabase& dbc, std::size_t max_identifiers) {
  max_entries_ = dbc.messages.size() + max_identifiers;
  if (max_entries_ >= kNoPlace) {
    throw std::invalid_argument("TrafficMonitor: more identifiers than 32 bits count");
  }
  entries_.reserve(max_entries_);
  // At most half full: a search looks at about two slots.
  const std::size_t slot_count = std::bit_ceil(2 * max_entries_);
  keys_.resize(slot_count);
  places_.resize(slot_count, kNoPlace);
  lives_on_one_bus_.resize(dbc.messages.size());
  for (std::size_t message = 0; message < dbc.messages.size(); ++message) {
    const DbcMessage& described = dbc.messages[message];
    const std::optional<std::uint8_t> bus = bus_of(dbc, described);
    lives_on_one_bus_[message] = bus.has_value() ? 1 : 0;
    const MessageIntegrity integrity(dbc, described);
    const std::uint64_t key = key_of(bus.value_or(0), described.id, described.is_extended);
    const std::size_t slot = slot_of(key);
    if (places_[slot] != kNoPlace) continue;
    IdentifierTraffic& entry = add(key, slot);
    entry.bus = bus.value_or(0);
    entry.id = described.id;
    entry.is_extended = described.is_extended;
    entry.message = message;
    entry.period = PeriodStatistics(period_of(dbc, described));
    entry.integrity = integrity;
  }
  max_entries_ = entries_.size() + max_identifiers;
}

std::size_t TrafficMonitor::slot_of(std::uint64_t key) const noexcept {
  const std::size_t mask = keys_.size() - 1;
  const int shift = 64 - std::countr_zero(keys_.size());
  std::size_t slot = static_cast<std::size_t>(shift == 64 ? 0 : (key * kSpread) >> shift);
  while (places_[slot] != kNoPlace && keys_[slot] != key) slot = (slot + 1) & mask;
  return slot;
}

IdentifierTraffic& TrafficMonitor::add(std::uint64_t key, std::size_t slot) noexcept {
  keys_[slot] = key;
  places_[slot] = static_cast<std::uint32_t>(entries_.size());
  return entries_.emplace_back();  // within what was reserved
}

IdentifierTraffic* TrafficMonitor::find_or_add(const CanFrame& frame) noexcept {
  const std::uint64_t key = key_of(frame.bus, frame.id, frame.is_extended);
  const std::size_t slot = slot_of(key);
  if (places_[slot] != kNoPlace) return &entries_[places_[slot]];
  if (entries_.size() == max_entries_) return nullptr;
  const IdentifierTraffic* const described = find(0, frame.id, frame.is_extended);
  IdentifierTraffic& entry = add(key, slot);
  entry.bus = frame.bus;
  entry.id = frame.id;
  entry.is_extended = frame.is_extended;
  if (described != nullptr && described->message != IdentifierTraffic::kNoMessage &&
      lives_on_one_bus_[described->message] == 0) {
    entry.message = described->message;
    entry.period = PeriodStatistics(described->period.period());
    entry.integrity = MessageIntegrity(described->integrity.protection());
  }
  return &entry;
}

const IdentifierTraffic* TrafficMonitor::on_frame(const CanFrame& frame) noexcept {
  ++frames_;
  if (frame.is_error) {
    ++error_frames_;
    return nullptr;
  }
  IdentifierTraffic* const entry = find_or_add(frame);
  if (entry == nullptr) {
    ++untracked_frames_;
    return nullptr;
  }
  ++entry->frames;
  if (frame.is_remote) {
    ++entry->remote_frames;
    return entry;
  }
  entry->payload_bytes += frame.length;
  entry->last_frame = frame;
  entry->period.add(frame.stamp);
  entry->last_check = entry->integrity.check(frame);
  if (is_usable(entry->last_check.status)) {
    entry->last_good_stamp = frame.stamp;
    entry->has_good_frame = true;
  }
  return entry;
}

const IdentifierTraffic* TrafficMonitor::find(std::uint8_t bus, std::uint32_t id,
                                              bool is_extended) const noexcept {
  const std::uint32_t place = places_[slot_of(key_of(bus, id, is_extended))];
  return place == kNoPlace ? nullptr : &entries_[place];
}

}  // namespace faultline
