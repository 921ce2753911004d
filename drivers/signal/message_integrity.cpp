#include "drivers/signal/message_integrity.h"

#include <limits>
#include <span>

namespace faultline {
namespace {

/// A count of what an adversary may choose must not begin again at 0.
void add_up(std::uint64_t& sum, std::uint64_t count) noexcept {
  const std::uint64_t room = std::numeric_limits<std::uint64_t>::max() - sum;
  sum += count < room ? count : room;
}

}  // namespace

std::string_view integrity_status_name(IntegrityStatus status) noexcept {
  switch (status) {
    case IntegrityStatus::kOk:
      return "ok";
    case IntegrityStatus::kCounterGap:
      return "counter gap";
    case IntegrityStatus::kCounterRepeated:
      return "counter repeated";
    case IntegrityStatus::kCounterOutOfRange:
      return "counter out of range";
    case IntegrityStatus::kWrongCrc:
      return "wrong CRC";
    case IntegrityStatus::kTooShort:
      break;
  }
  return "too short";
}

IntegrityResult MessageIntegrity::check(const CanFrame& frame) noexcept {
  ++counters_.frames;
  if (protection_.is_none()) return {};
  const std::span<const std::uint8_t> payload = frame.payload();
  if (payload.size() < protection_.length) {
    ++counters_.too_short;
    ++bad_since_;
    return {IntegrityStatus::kTooShort};
  }
  if (!protection_.is_crc_right(payload)) {
    ++counters_.wrong_crc;
    ++bad_since_;
    return {IntegrityStatus::kWrongCrc};
  }
  if (!protection_.has_counter()) return {};
  const std::uint64_t count = protection_.count(payload);
  if (count > protection_.last_count) {
    ++counters_.out_of_range;
    ++bad_since_;
    return {IntegrityStatus::kCounterOutOfRange};
  }
  return follow(count);
}

IntegrityResult MessageIntegrity::follow(std::uint64_t count) noexcept {
  const std::uint64_t last_count = protection_.last_count;  // M - 1; M itself may be 2^64
  const std::uint64_t step = count >= last_ ? count - last_ : last_count - (last_ - count) + 1;
  const std::uint64_t bad = bad_since_;
  const bool is_known = has_last_ && bad < last_count;
  if (is_known && step == 0) {
    ++counters_.repeated;
    return {IntegrityStatus::kCounterRepeated};
  }
  has_last_ = true;
  last_ = count;
  bad_since_ = 0;
  if (!is_known || step - 1 <= bad) return {};
  ++counters_.gaps;
  if (last_count >= kWideCounter - 1 && step > last_count / 2 + 1) {
    ++counters_.restarts;
    return {IntegrityStatus::kCounterGap, 0};
  }
  const std::uint64_t lost = step - 1 - bad;
  add_up(counters_.lost, lost);
  return {IntegrityStatus::kCounterGap, lost};
}

void MessageIntegrity::reset() noexcept { *this = MessageIntegrity(protection_); }

void MessageProtector::protect(CanFrame& frame) noexcept {
  if (protection_.is_none() || frame.length < protection_.length) return;
  protection_.write(std::span(frame.data).first(frame.length), next_);
  next_ = next_ < protection_.last_count ? next_ + 1 : 0;
}

}  // namespace faultline
