#include "drivers/dbc/dbc_overlap_check.h"

#include <algorithm>
#include <limits>
#include <utility>

namespace faultline {
namespace {

constexpr std::uint64_t kAllValues = std::numeric_limits<std::uint64_t>::max();
constexpr std::uint16_t kMaxSignalBits = 64;
/// Pairs of a signal and a range may be so many more than there are signals and ranges in a
/// message. Only a text made to cost time and memory has more: many signals below a multiplexer
/// that has many ranges.
constexpr std::size_t kWorkAlways = 1 << 16;

/// Calls `use` with each bit of `signal`, counted as the DBC counts. Stops when it returns false.
template <class Use>
void for_each_bit(const DbcSignal& signal, Use&& use) {
  std::size_t bit = signal.start_bit;
  for (int n = 0; n < signal.bit_count; ++n) {
    if (!use(bit)) return;
    if (signal.byte_order == ByteOrder::kLittleEndian) {
      ++bit;
    } else {
      bit = bit % 8 == 0 ? bit + 15 : bit - 1;
    }
  }
}

bool is_checkable(const DbcSignal& signal) noexcept {
  return signal.bit_count >= 1 && signal.bit_count <= kMaxSignalBits;
}

const DbcSignal* parent_of(const DbcMessage& message, const DbcSignal& signal) noexcept {
  return signal.multiplexer < 0 ? nullptr
                                : &message.signals[static_cast<std::size_t>(signal.multiplexer)];
}

}  // namespace

void DbcOverlapCheck::report(const DbcMessage& message, std::uint32_t a, std::uint32_t b,
                             DbcWarnings& warnings) {
  const auto [earlier, later] = std::minmax(a, b);
  if (is_reported_[later]) return;
  is_reported_[later] = true;
  overlaps_->push_back({index_, earlier, later});
  warnings.warn(message.signals[later].position, "signal {} overlaps signal {} of message {}",
                shown(message.signals[later].name), shown(message.signals[earlier].name),
                shown(message.name));
}

/// Puts an item on its bits. Items come ascending by `first`, so that of those before it just the
/// ones whose `last` is not below its `first` can be present with it; the two with the greatest
/// `last` of different branches tell.
void DbcOverlapCheck::place(const DbcMessage& message, const Item& item, DbcWarnings& warnings) {
  std::uint32_t partner = kNoSignal;
  for_each_bit(message.signals[item.signal], [&](std::size_t n) {
    if (n >= bits_.size()) bits_.resize(n + 64);
    Bit& bit = bits_[n];
    if (bit.epoch != epoch_) bit = {epoch_, {}, {}};
    const Owner& rival = bit.longest.branch != item.branch ? bit.longest : bit.other;
    if (rival.signal != kNoSignal && rival.last >= item.first) partner = rival.signal;
    const Owner own{item.last, item.signal, item.branch};
    if (bit.longest.signal == kNoSignal || own.branch == bit.longest.branch) {
      if (bit.longest.signal == kNoSignal || own.last > bit.longest.last) bit.longest = own;
    } else if (own.last > bit.longest.last) {
      bit.other = std::exchange(bit.longest, own);
    } else if (bit.other.signal == kNoSignal || own.last > bit.other.last) {
      bit.other = own;
    }
    return partner == kNoSignal;
  });
  if (partner != kNoSignal) report(message, partner, item.signal, warnings);
}

void DbcOverlapCheck::sweep(const DbcMessage& message, DbcWarnings& warnings) {
  std::sort(items_.begin(), items_.end(), [](const Item& a, const Item& b) {
    return a.first != b.first ? a.first < b.first : a.signal < b.signal;
  });
  ++epoch_;
  for (const Item& item : items_) place(message, item, warnings);
}

void DbcOverlapCheck::check(const DbcMessage& message, std::size_t index, DbcWarnings& warnings,
                            std::vector<DbcOverlap>& overlaps) {
  index_ = index;
  overlaps_ = &overlaps;
  const std::vector<DbcSignal>& signals = message.signals;
  is_reported_.assign(signals.size(), false);
  // Signals form a tree: each hangs on its multiplexer, the others on the message. Two of them
  // exclude each other only where their ways to the top meet. So at every multiplexer, and at the
  // message itself, all that hangs below is compared across its branches.
  levels_.clear();
  ++epoch_;
  std::size_t work_left = kWorkAlways;
  for (std::uint32_t n = 0; n < signals.size(); ++n) {
    work_left += 1 + signals[n].multiplexer_ranges.size();
    if (!is_checkable(signals[n])) continue;
    std::uint32_t branch = n;
    for (const DbcSignal* at = &signals[n]; at->multiplexer >= 0; at = parent_of(message, *at)) {
      const auto multiplexer = static_cast<std::uint32_t>(at->multiplexer);
      levels_.push_back({multiplexer, n, branch});
      branch = multiplexer;
    }
    place(message, {0, kAllValues, n, branch}, warnings);
  }
  std::sort(levels_.begin(), levels_.end(), [](const Level& a, const Level& b) {
    return a.multiplexer != b.multiplexer ? a.multiplexer < b.multiplexer : a.signal < b.signal;
  });
  for (std::size_t n = 0; n < levels_.size();) {
    const std::uint32_t multiplexer = levels_[n].multiplexer;
    items_.clear();
    for (; n < levels_.size() && levels_[n].multiplexer == multiplexer; ++n) {
      const auto& ranges = signals[levels_[n].branch].multiplexer_ranges;
      if (ranges.size() > work_left) {
        warnings.add(DbcSeverity::kNote, message.position,
                     "message {} is multiplexed in so many ways that not all were searched for "
                     "overlaps",
                     shown(message.name));
        return;
      }
      work_left -= ranges.size();
      for (const DbcMultiplexRange& range : ranges) {
        items_.push_back({range.first, range.last, levels_[n].signal, levels_[n].branch});
      }
    }
    sweep(message, warnings);
    // What hangs on a multiplexer is always present together with it.
    if (!is_checkable(signals[multiplexer])) continue;
    ++epoch_;
    place(message, {0, kAllValues, multiplexer, kNoSignal - 1}, warnings);
    const std::size_t count = items_.size();
    for (std::size_t k = 0; k < count; ++k) {
      std::uint32_t partner = kNoSignal;
      for_each_bit(signals[items_[k].signal], [&](std::size_t bit) {
        if (bit < bits_.size() && bits_[bit].epoch == epoch_) partner = multiplexer;
        return partner == kNoSignal;
      });
      if (partner != kNoSignal) report(message, partner, items_[k].signal, warnings);
    }
  }
}

}  // namespace faultline
