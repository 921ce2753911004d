#include "tools/replay/result_comparison.h"

#include <algorithm>
#include <cstring>

#include "tools/lcm/channels.h"
#include "tools/lcm/message_type.h"

namespace faultline {
namespace {

constexpr std::array<const char*, kResultChannels> kNames = {kSampleChannel, kResidualChannel,
                                                             kDiagnosisChannel, kEstimateChannel};
constexpr std::size_t kSequenceAt = 16, kCycleAt = 24;

/// All but utime and sequence, which stand behind the fingerprint.
bool is_same_result(std::span<const std::uint8_t> a, std::span<const std::uint8_t> b) noexcept {
  constexpr std::size_t kFingerprintBytes = 8;
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), kFingerprintBytes) == 0 &&
         std::memcmp(a.data() + kCycleAt, b.data() + kCycleAt, a.size() - kCycleAt) == 0;
}

}  // namespace

const char* result_channel_name(ResultChannel channel) noexcept {
  return kNames[static_cast<std::size_t>(channel)];
}

std::optional<ResultChannel> find_result_channel(std::string_view name) noexcept {
  for (std::size_t i = 0; i < kResultChannels; ++i) {
    if (name == kNames[i]) return static_cast<ResultChannel>(i);
  }
  return std::nullopt;
}

void ResultComparison::Waiting::push(std::int64_t number, std::int64_t cycle,
                                     std::span<const std::uint8_t> bytes) {
  if (count_ == slots_.size()) {
    // In order again, so that the new slots stand behind the last.
    std::rotate(slots_.begin(), slots_.begin() + static_cast<std::ptrdiff_t>(first_), slots_.end());
    first_ = 0;
    constexpr std::size_t kFewest = 64;
    slots_.resize(std::max(2 * slots_.size(), kFewest));
  }
  Message& slot = slots_[(first_ + count_++) % slots_.size()];
  slot.number = number;
  slot.cycle = cycle;
  slot.bytes.assign(bytes.begin(), bytes.end());
}

void ResultComparison::Waiting::pop() noexcept {
  first_ = (first_ + 1) % slots_.size();
  --count_;
}

void ResultComparison::on_recorded(ResultChannel id, std::span<const std::uint8_t> message) {
  Channel& channel = at(id);
  ++channel.counts.recorded;
  if (channel.recorded.size() == kMostWaiting) pass_unverifiable(id, channel);
  channel.recorded.push(big_endian_at(message, kSequenceAt), big_endian_at(message, kCycleAt),
                        message);
  match(id, channel);
}

void ResultComparison::on_replayed(ResultChannel id, std::span<const std::uint8_t> message) {
  Channel& channel = at(id);
  if (channel.replayed.size() == kMostWaiting) {
    channel.replayed.pop();
    ++channel.counts.unrecorded;
  }
  channel.replayed.push(channel.replayed_count++, big_endian_at(message, kCycleAt), message);
  match(id, channel);
}

void ResultComparison::match(ResultChannel id, Channel& channel) {
  while (!channel.recorded.is_empty() && !channel.replayed.is_empty()) {
    if (channel.offset) {
      match_by_number(id, channel);
    } else {
      match_by_cycle(id, channel);
    }
  }
}

void ResultComparison::match_by_number(ResultChannel id, Channel& channel) {
  const Message& recorded = channel.recorded.front();
  const Message& replayed = channel.replayed.front();
  const std::int64_t ahead = recorded.number - (replayed.number + *channel.offset);
  if (ahead > 0) {  // messages before it are missing in the log
    channel.replayed.pop();
    ++channel.counts.unrecorded;
    return;
  }
  if (ahead < 0) {
    channel.recorded.pop();
    ++channel.counts.repeated;
    return;
  }
  if (is_same_result(recorded.bytes, replayed.bytes)) {
    ++channel.counts.identical;
  } else {
    ++channel.counts.different;
    note_difference(id, recorded, &replayed);
  }
  channel.recorded.pop();
  channel.replayed.pop();
}

void ResultComparison::match_by_cycle(ResultChannel id, Channel& channel) {
  const Message& recorded = channel.recorded.front();
  const Message& replayed = channel.replayed.front();
  if (replayed.cycle < recorded.cycle) {
    channel.replayed.pop();
    ++channel.counts.unrecorded;
    return;
  }
  if (recorded.cycle < replayed.cycle) {
    pass_unverifiable(id, channel);
    return;
  }
  const bool is_same = is_same_result(recorded.bytes, replayed.bytes);
  if (!is_same) {
    channel.same_since = 0;
    pass_unverifiable(id, channel);
    channel.replayed.pop();
    return;
  }
  ++channel.counts.identical;
  if (replayed.number >= channel.gap_at) {
    ++channel.same_since;
    if (is_settled(id, channel)) channel.offset = recorded.number - replayed.number;
  }
  channel.recorded.pop();
  channel.replayed.pop();
}

bool ResultComparison::is_settled(ResultChannel id, const Channel& channel) const noexcept {
  if (id == ResultChannel::kSample) return channel.same_since >= kSettled;
  const Channel& samples = channels_[static_cast<std::size_t>(ResultChannel::kSample)];
  const Channel& residuals = channels_[static_cast<std::size_t>(ResultChannel::kResidual)];
  if (id == ResultChannel::kResidual) {
    return channel.same_since >= kSettled && samples.offset.has_value();
  }
  return residuals.offset.has_value();
}

void ResultComparison::note_difference(ResultChannel id, const Message& recorded,
                                       const Message* replayed) {
  if (first_difference_ &&
      (first_difference_->cycle < recorded.cycle ||
       (first_difference_->cycle == recorded.cycle && first_difference_->channel <= id))) {
    return;
  }
  first_difference_ = {id, recorded.cycle, recorded.bytes,
                       replayed != nullptr ? replayed->bytes : std::vector<std::uint8_t>()};
}

void ResultComparison::pass_unverifiable(ResultChannel id, Channel& channel) {
  note_unverifiable(id, channel.recorded.front().cycle);
  ++channel.counts.unverifiable;
  channel.recorded.pop();
}

void ResultComparison::note_unverifiable(ResultChannel id, std::int64_t cycle) {
  if (id != ResultChannel::kSample && id != ResultChannel::kResidual) return;
  if (!unverifiable_.empty()) {
    CycleRange& last = unverifiable_.back();
    if (cycle >= last.from && cycle <= last.to + 1) {
      last.to = std::max(last.to, cycle);
      return;
    }
  }
  unverifiable_.push_back({cycle, cycle});
}

void ResultComparison::on_gap() {
  for (Channel& channel : channels_) {
    channel.offset.reset();
    channel.gap_at = channel.replayed_count;
    channel.same_since = 0;
  }
}

void ResultComparison::finish(bool is_complete) {
  for (std::size_t i = 0; i < kResultChannels; ++i) {
    const auto id = static_cast<ResultChannel>(i);
    Channel& channel = channels_[i];
    for (; !channel.recorded.is_empty(); channel.recorded.pop()) {
      const Message& recorded = channel.recorded.front();
      if (!channel.offset) {
        ++channel.counts.unverifiable;
        note_unverifiable(id, recorded.cycle);
      } else if (is_complete) {
        ++channel.counts.different;
        note_difference(id, recorded, nullptr);
      } else {
        ++channel.counts.behind_end;
      }
    }
    for (; !channel.replayed.is_empty(); channel.replayed.pop()) ++channel.counts.unrecorded;
  }
}

ResultComparison::Counts ResultComparison::total() const noexcept {
  Counts sum;
  for (const Channel& channel : channels_) {
    sum.recorded += channel.counts.recorded;
    sum.identical += channel.counts.identical;
    sum.different += channel.counts.different;
    sum.unverifiable += channel.counts.unverifiable;
    sum.repeated += channel.counts.repeated;
    sum.behind_end += channel.counts.behind_end;
    sum.unrecorded += channel.counts.unrecorded;
  }
  return sum;
}

}  // namespace faultline
