#include "drivers/signal/message_watch.h"

namespace faultline {

std::string_view message_fault_name(MessageFault fault) noexcept {
  switch (fault) {
    case MessageFault::kNone:
      break;
    case MessageFault::kMissing:
      return "missing";
    case MessageFault::kLate:
      return "late";
    case MessageFault::kRepeated:
      return "came twice";
    case MessageFault::kTooShort:
      return "too short";
    case MessageFault::kNotFinite:
      return "not a finite number";
    case MessageFault::kWrongCrc:
      return "wrong CRC";
    case MessageFault::kCounterRepeated:
      return "counter repeated";
    case MessageFault::kCounterOutOfRange:
      return "counter out of range";
    case MessageFault::kCounterGap:
      return "counter gap";
  }
  return "none";
}

MessageFault fault_of(IntegrityStatus status) noexcept {
  switch (status) {
    case IntegrityStatus::kOk:
    case IntegrityStatus::kCounterGap:
      break;
    case IntegrityStatus::kCounterRepeated:
      return MessageFault::kCounterRepeated;
    case IntegrityStatus::kCounterOutOfRange:
      return MessageFault::kCounterOutOfRange;
    case IntegrityStatus::kWrongCrc:
      return MessageFault::kWrongCrc;
    case IntegrityStatus::kTooShort:
      return MessageFault::kTooShort;
  }
  return MessageFault::kNone;
}

SignalState held_state(MessageFault why, bool ever_came) noexcept {
  if (why == MessageFault::kWrongCrc) return SignalState::kCrcError;
  if (why == MessageFault::kCounterRepeated || why == MessageFault::kCounterOutOfRange) {
    return SignalState::kCounterError;
  }
  return ever_came ? SignalState::kStale : SignalState::kNeverSeen;
}

MessageWatch::MessageWatch(const SignalMap& map) : watched_(map.message_count()) {
  for (std::size_t message = 0; message < watched_.size(); ++message) {
    watched_[message].integrity = MessageIntegrity(map.message_protection(message));
  }
}

void MessageWatch::note(std::size_t message, MessageFault fault) noexcept {
  Watched& watched = watched_[message];
  switch (fault) {
    case MessageFault::kLate:
      ++watched.counters.late;
      return;
    case MessageFault::kRepeated:
      ++watched.counters.repeated;
      return;
    case MessageFault::kTooShort:
      ++watched.counters.too_short;
      break;
    case MessageFault::kNotFinite:
      ++watched.counters.not_finite;
      break;
    case MessageFault::kNone:
    case MessageFault::kMissing:
    case MessageFault::kCounterGap:
      return;
    case MessageFault::kWrongCrc:
    case MessageFault::kCounterRepeated:
    case MessageFault::kCounterOutOfRange:
      break;
  }
  watched.refusal = fault;
  watched.refusal_left = kRefusalCycles;
}

void MessageWatch::end_sample() noexcept {
  for (Watched& watched : watched_) {
    if (watched.refusal_left > 0) --watched.refusal_left;
  }
}

void MessageWatch::reset() noexcept {
  for (Watched& watched : watched_) watched = {MessageIntegrity(watched.integrity.protection())};
}

MessageFault MessageWatch::why_missing(std::size_t message) const noexcept {
  const Watched& watched = watched_[message];
  return watched.refusal_left > 0 ? watched.refusal : MessageFault::kMissing;
}

MessageCounters MessageWatch::counters(std::size_t message) const noexcept {
  MessageCounters counters = watched_[message].counters;
  counters.integrity = watched_[message].integrity.counters();
  return counters;
}

}  // namespace faultline
