#include "drivers/dbc/dbc_parse.h"

#include <algorithm>
#include <utility>

namespace faultline {
namespace {

/// Copies may take this many times the bytes of the text; no file of a vehicle comes near.
constexpr std::size_t kCopiesPerByte = 4;
constexpr std::size_t kCopiesAlways = 1 << 16;

}  // namespace

void DbcHashIndex::place(Slot slot) noexcept {
  const std::size_t mask = slots_.size() - 1;
  std::size_t n = slot.hash & mask;
  while (slots_[n].number != kNoDbcItem) n = (n + 1) & mask;
  slots_[n] = slot;
}

void DbcHashIndex::insert(std::size_t hash, std::uint32_t number) {
  if (4 * (count_ + 1) > 3 * slots_.size()) {
    std::vector<Slot> larger(std::max<std::size_t>(64, 2 * slots_.size()));
    std::swap(slots_, larger);
    for (const Slot& slot : larger) {
      if (slot.number != kNoDbcItem) place(slot);
    }
  }
  place({fold(hash), number});
  ++count_;
}

std::size_t count_leading_lines_of(std::string_view text, std::string_view keyword,
                                   const char*& end) {
  std::size_t count = 0;
  for (;; ++count) {
    const std::size_t first = std::min(text.find_first_not_of(" \t"), text.size());
    text.remove_prefix(first);
    end = text.data();
    if (!text.starts_with(keyword)) return count;
    text.remove_prefix(std::min(text.find('\n'), text.size() - 1) + 1);
  }
}

DbcParse::DbcParse(std::string_view text)
    : reader(text, warnings), copies_left(kCopiesPerByte * text.size() + kCopiesAlways) {
  std::size_t message_count = 0;
  std::size_t variable_count = 0;
  for (std::size_t at = 0; at < text.size();) {
    message_count += text.substr(at).starts_with("BO_ ") ? 1u : 0u;
    variable_count += text.substr(at).starts_with("EV_ ") ? 1u : 0u;
    at = std::min(text.find('\n', at), text.size() - 1) + 1;
  }
  messages.reserve(message_count);
  environment_variables.reserve(variable_count);
}

DbcId to_dbc_id(std::uint32_t file_id) noexcept {
  const std::uint32_t id = file_id & kMaxExtendedDbcId;
  return {id, (file_id & ~kMaxExtendedDbcId) != 0 || id > kMaxStandardDbcId};
}

bool expect_message(DbcParse& parse, std::uint32_t& message) {
  message = kNoDbcItem;
  const DbcPosition position = parse.reader.peek().position;
  std::uint32_t file_id = 0;
  if (!parse.reader.expect_integer(file_id, "a message identifier")) return false;
  if (file_id == kIndependentSignalsId) return true;
  const DbcId wanted = to_dbc_id(file_id);
  const auto is_same = [&](std::uint32_t n) {
    return parse.messages[n].id == wanted.id && parse.messages[n].is_extended == wanted.is_extended;
  };
  // Statements about one message mostly follow each other.
  if (parse.last_message != kNoDbcItem && is_same(parse.last_message)) {
    message = parse.last_message;
    return true;
  }
  message = parse.message_ids.find(wanted.id, is_same);
  if (message != kNoDbcItem) {
    parse.last_message = message;
  } else {
    parse.warnings.warn(position, "there is no message with identifier {}", file_id);
  }
  return true;
}

std::uint32_t find_dbc_signal(const DbcParse& parse, std::uint32_t message, std::string_view name) {
  const std::vector<DbcSignal>& signals = parse.messages[message].signals;
  const std::uint32_t first = parse.first_signals[message];
  const std::size_t hash = std::hash<std::string_view>{}(name) ^ message;
  const std::uint32_t found = parse.signal_names.find(hash, [&](std::uint32_t n) {
    return n >= first && n - first < signals.size() && signals[n - first].name == name;
  });
  return found == kNoDbcItem ? kNoDbcItem : found - first;
}

bool expect_signal(DbcParse& parse, std::uint32_t& message, std::uint32_t& signal) {
  signal = kNoDbcItem;
  if (!expect_message(parse, message)) return false;
  const DbcPosition position = parse.reader.peek().position;
  std::string_view name;
  if (!parse.reader.expect_name(name, "a signal")) return false;
  if (message == kNoDbcItem) return true;
  signal = find_dbc_signal(parse, message, name);
  if (signal == kNoDbcItem) {
    const DbcMessage& found = parse.messages[message];
    if (parse.warnings.is_kept(DbcSeverity::kWarning)) {
      parse.warnings.warn(position, "message {} has no signal {}", shown(found.name), shown(name));
    } else {
      parse.warnings.warn(position, "");
    }
  }
  return true;
}

bool expect_node(DbcParse& parse, std::string_view& name, bool& is_known) {
  const DbcPosition position = parse.reader.peek().position;
  if (!parse.reader.expect_name(name, "a node")) return false;
  const std::uint32_t node =
      parse.node_names.find(std::hash<std::string_view>{}(name),
                            [&](std::uint32_t n) { return parse.database.nodes[n] == name; });
  is_known = node != kNoDbcItem;
  if (!is_known) parse.warnings.warn(position, "there is no node {}", shown(name));
  return true;
}

bool expect_environment_variable(DbcParse& parse, std::uint32_t& variable) {
  const DbcPosition position = parse.reader.peek().position;
  std::string_view name;
  if (!parse.reader.expect_name(name, "an environment variable")) return false;
  variable = parse.environment_names.find(
      std::hash<std::string_view>{}(name),
      [&](std::uint32_t n) { return parse.environment_variables[n].name == name; });
  if (variable == kNoDbcItem) {
    parse.warnings.warn(position, "there is no environment variable {}", shown(name));
  }
  return true;
}

}  // namespace faultline
