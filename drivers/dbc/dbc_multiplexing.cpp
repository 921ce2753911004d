#include <algorithm>
#include <limits>

#include "drivers/dbc/dbc_parse.h"

namespace faultline {
namespace {

/// Multiplexers may hang on one another this deep; more is a mistake or an attack.
constexpr int kMaxDepth = 8;

/// Makes `signal` present in every frame.
void detach(DbcSignal& signal) noexcept {
  signal.multiplexer = DbcSignal::kAlwaysPresent;
  signal.multiplexer_ranges.clear();
}

/// Ascending, without overlap, and neighbours as one.
void sort_ranges(std::vector<DbcMultiplexRange>& ranges) {
  if (ranges.size() < 2) return;
  std::sort(ranges.begin(), ranges.end(),
            [](const DbcMultiplexRange& a, const DbcMultiplexRange& b) {
              return a.first != b.first ? a.first < b.first : a.last < b.last;
            });
  std::size_t kept = 0;
  for (const DbcMultiplexRange& range : ranges) {
    DbcMultiplexRange& last = ranges[kept];
    const bool touches =
        last.last == std::numeric_limits<std::uint64_t>::max() || range.first <= last.last + 1;
    if (touches) {
      last.last = std::max(last.last, range.last);
    } else {
      ranges[++kept] = range;
    }
  }
  ranges.resize(kept + 1);
}

/// Gives the signals marked `m3` that no SG_MUL_VAL_ mentions the message's multiplexer.
void link_simple(DbcMessage& message, DbcWarnings& warnings) {
  std::int32_t root = -1;
  int root_count = 0;
  bool has_nested = false;
  for (std::size_t n = 0; n < message.signals.size(); ++n) {
    const DbcSignal& signal = message.signals[n];
    has_nested =
        has_nested || (signal.is_multiplexer && signal.multiplexer == kUnlinkedMultiplexer);
    if (!signal.is_multiplexer || signal.multiplexer != DbcSignal::kAlwaysPresent) continue;
    if (root_count++ == 0) root = static_cast<std::int32_t>(n);
  }
  bool is_warned = false;
  for (DbcSignal& signal : message.signals) {
    if (signal.multiplexer != kUnlinkedMultiplexer) continue;
    if (root_count == 0) {
      warnings.warn(signal.position,
                    "signal {} is multiplexed, but message {} has no multiplexer; it is taken as "
                    "always present",
                    shown(signal.name), shown(message.name));
      detach(signal);
      continue;
    }
    if ((root_count > 1 || has_nested) && !is_warned) {
      is_warned = true;
      warnings.warn(
          signal.position,
          "message {} has several multiplexers, and no SG_MUL_VAL_ says which selects {}; "
          "taken is {}",
          shown(message.name), shown(signal.name),
          shown(message.signals[static_cast<std::size_t>(root)].name));
    }
    signal.multiplexer = root;
  }
}

/// Steps from `signal` up to the signal that is always present, or back to `signal`; at most
/// kMaxDepth + 1.
int steps_up(const DbcMessage& message, const DbcSignal& signal, bool& is_circle) noexcept {
  int steps = 0;
  const DbcSignal* at = &signal;
  is_circle = false;
  while (at->multiplexer >= 0 && steps <= kMaxDepth && !is_circle) {
    at = &message.signals[static_cast<std::size_t>(at->multiplexer)];
    ++steps;
    is_circle = at == &signal;
  }
  return steps;
}

/// Detaches signals whose chain of multiplexers returns to itself, then those whose chain is too
/// long.
void break_cycles(DbcMessage& message, DbcWarnings& warnings) {
  bool is_circle = false;
  for (DbcSignal& signal : message.signals) {
    static_cast<void>(steps_up(message, signal, is_circle));
    if (!is_circle) continue;
    warnings.warn(signal.position,
                  "multiplexer {} is selected, through others, by itself; it is taken as always "
                  "present",
                  shown(signal.name));
    detach(signal);
  }
  for (DbcSignal& signal : message.signals) {
    if (steps_up(message, signal, is_circle) <= kMaxDepth) continue;
    warnings.warn(signal.position,
                  "signal {} hangs on more than {} multiplexers; it is taken as always present",
                  shown(signal.name), kMaxDepth);
    detach(signal);
  }
}

}  // namespace

void link_multiplexers(DbcMessage& message, DbcWarnings& warnings) {
  const bool is_multiplexed = std::any_of(
      message.signals.begin(), message.signals.end(),
      [](const DbcSignal& signal) { return signal.multiplexer != DbcSignal::kAlwaysPresent; });
  if (!is_multiplexed) return;
  link_simple(message, warnings);
  break_cycles(message, warnings);
  for (DbcSignal& signal : message.signals) sort_ranges(signal.multiplexer_ranges);
}

}  // namespace faultline
