// Any bytes as a DBC text: parse_dbc gives a sound database or a DbcError, and never more than a
// small multiple of the text.
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "drivers/dbc/dbc_parser.h"
#include "drivers/dbc/message_codec.h"

namespace {

using faultline::DbcDatabase;
using faultline::DbcMessage;
using faultline::DbcSignal;

void require(bool holds) {
  if (!holds) std::abort();
}

void require_position_in(std::string_view text, faultline::DbcPosition position) {
  const auto lines =
      1 + std::count_if(text.begin(), text.end(), [](char c) { return c == '\n' || c == '\r'; });
  require(position.line >= 1 && position.line <= lines);
  require(position.column >= 1 && static_cast<std::size_t>(position.column) <= text.size() + 1);
}

void require_sound(const DbcMessage& message) {
  require(message.id <= 0x1FFF'FFFF && (message.is_extended || message.id <= 0x7FF));
  for (std::size_t n = 0; n < message.signals.size(); ++n) {
    const DbcSignal& signal = message.signals[n];
    require(!signal.name.empty());
    require(signal.multiplexer_ranges.empty() == (signal.multiplexer < 0));
    // The way up ends, at a signal that is always present.
    const DbcSignal* at = &signal;
    for (int depth = 0; at->multiplexer >= 0; ++depth) {
      require(depth < 16);
      require(static_cast<std::size_t>(at->multiplexer) < message.signals.size());
      at = &message.signals[static_cast<std::size_t>(at->multiplexer)];
    }
    require(at->multiplexer == DbcSignal::kAlwaysPresent);
    for (std::size_t k = 0; k < signal.multiplexer_ranges.size(); ++k) {
      const auto& range = signal.multiplexer_ranges[k];
      require(range.first <= range.last);
      require(k == 0 || signal.multiplexer_ranges[k - 1].last < range.first);
    }
    for (std::size_t k = 1; k < signal.value_names.size(); ++k) {
      require(signal.value_names[k - 1].value < signal.value_names[k].value);
    }
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  try {
    const DbcDatabase dbc = faultline::parse_dbc(text, "fuzz.dbc");
    require(dbc.warnings.size() <= 3 * DbcDatabase::kMaxWarnings);
    for (const auto& warning : dbc.warnings) {
      require_position_in(text, warning.position);
      require(!warning.text.empty());
    }
    for (const DbcMessage& message : dbc.messages) {
      require_sound(message);
      const faultline::MessageCodec codec(message);
      require(codec.signal_count() == message.signals.size());
    }
    for (const auto& group : dbc.signal_groups) require(group.message < dbc.messages.size());
    require(std::is_sorted(dbc.attributes.begin(), dbc.attributes.end(),
                           [](const auto& a, const auto& b) { return a.first < b.first; }));
  } catch (const faultline::DbcError& error) {
    require_position_in(text, error.position());
  }
  return 0;
}
