#include "drivers/signal/sample_values.h"

#include <algorithm>

namespace faultline {
namespace {

/// Older ones do not age any more; kNeverCame is none of them.
constexpr std::uint32_t kOldest = kNeverCame - 1;

}  // namespace

SampleValues::SampleValues(const std::vector<MappedMessage>& messages, std::size_t first_message,
                           std::size_t channel_count)
    : message_of_(channel_count),
      values_(channel_count),
      is_fresh_(channel_count),
      age_(channel_count, kNeverCame),
      state_(channel_count, SignalState::kNeverSeen) {
  for (std::size_t message = 0; message < messages.size(); ++message) {
    for (const MappedSignal& mapped : messages[message].channels) {
      message_of_[mapped.channel] = first_message + message;
    }
  }
}

void SampleValues::begin() noexcept {
  std::fill(is_fresh_.begin(), is_fresh_.end(), std::uint8_t{0});
}

void SampleValues::take(std::span<const double> values,
                        std::span<const std::uint8_t> known) noexcept {
  for (std::size_t channel = 0; channel < values_.size(); ++channel) {
    if (known[channel] == 0) continue;
    values_[channel] = values[channel];
    is_fresh_[channel] = 1;
  }
}

void SampleValues::assign(std::span<const double> values,
                          std::span<const std::uint8_t> fresh) noexcept {
  std::copy(values.begin(), values.end(), values_.begin());
  std::copy(fresh.begin(), fresh.end(), is_fresh_.begin());
}

void SampleValues::take_zeros() noexcept {
  std::fill(values_.begin(), values_.end(), 0.0);
  keep_all();
}

void SampleValues::keep_all() noexcept {
  std::fill(is_fresh_.begin(), is_fresh_.end(), std::uint8_t{1});
}

void SampleValues::end(const MessageWatch& watch) noexcept {
  for (std::size_t channel = 0; channel < values_.size(); ++channel) {
    std::uint32_t& age = age_[channel];
    if (is_fresh_[channel] != 0) {
      age = 0;
      state_[channel] = SignalState::kFresh;
      continue;
    }
    const bool ever_came = age != kNeverCame;
    if (ever_came && age < kOldest) ++age;
    state_[channel] = held_state(watch.why_missing(message_of_[channel]), ever_came);
  }
}

void SampleValues::reset() noexcept {
  std::fill(values_.begin(), values_.end(), 0.0);
  std::fill(age_.begin(), age_.end(), kNeverCame);
  std::fill(state_.begin(), state_.end(), SignalState::kNeverSeen);
}

}  // namespace faultline
