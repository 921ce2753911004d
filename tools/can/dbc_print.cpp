#include "tools/can/dbc_print.h"

#include <algorithm>
#include <string>
#include <variant>
#include <vector>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "tools/can/problem_report.h"

namespace faultline {
namespace {

using Json = nlohmann::ordered_json;

const char* type_name(SignalType type) {
  switch (type) {
    case SignalType::kUnsigned:
      return "unsigned";
    case SignalType::kSigned:
      return "signed";
    case SignalType::kFloat32:
      return "float32";
    case SignalType::kFloat64:
      break;
  }
  return "float64";
}

const char* order_name(ByteOrder order) {
  return order == ByteOrder::kLittleEndian ? "little_endian" : "big_endian";
}

Json attributes_json(const DbcAttributes& attributes) {
  Json json = Json::object();
  for (const auto& [name, value] : attributes) {
    std::visit([&json, &name = name](const auto& held) { json[name] = held; }, value);
  }
  return json;
}

Json signal_json(const DbcMessage& message, const DbcSignal& signal) {
  Json json{{"name", signal.name},
            {"start_bit", signal.start_bit},
            {"bits", signal.bit_count},
            {"byte_order", order_name(signal.byte_order)},
            {"type", type_name(signal.type)},
            {"factor", signal.factor},
            {"offset", signal.offset},
            {"minimum", signal.minimum},
            {"maximum", signal.maximum},
            {"unit", signal.unit}};
  if (signal.is_multiplexer) json["multiplexer"] = true;
  if (signal.multiplexer != DbcSignal::kAlwaysPresent) {
    Json ranges = Json::array();
    for (const DbcMultiplexRange& range : signal.multiplexer_ranges) {
      ranges.push_back({range.first, range.last});
    }
    json["present_if"] = {
        {"signal", message.signals[static_cast<std::size_t>(signal.multiplexer)].name},
        {"ranges", ranges}};
  }
  if (!signal.receivers.empty()) json["receivers"] = signal.receivers;
  if (!signal.comment.empty()) json["comment"] = signal.comment;
  if (!signal.value_names.empty()) {
    Json names = Json::object();
    for (const DbcValueName& name : signal.value_names) {
      names[std::to_string(name.value)] = name.name;
    }
    json["values"] = std::move(names);
  }
  if (!signal.attributes.empty()) json["attributes"] = attributes_json(signal.attributes);
  return json;
}

/// `json` on one line; names and comments need not be UTF-8 where the DBC was not understood.
std::string line(const Json& json) {
  return json.dump(-1, ' ', false, Json::error_handler_t::replace);
}

/// An array with one element per line, made and written one after the other: a DBC of 200 MB has
/// millions of signals, and a tree of all of them would not fit.
template <class Items, class ToLine>
void write_array(std::FILE* out, const char* indent, const Items& items, const ToLine& to_line) {
  const char* separator = "";
  std::fputs("[", out);
  for (const auto& item : items) {
    fmt::print(out, "{}\n{}  ", separator, indent);
    to_line(item);
    separator = ",";
  }
  fmt::print(out, "{}{}]", items.empty() ? "" : "\n", items.empty() ? "" : indent);
}

void write_message(std::FILE* out, const DbcMessage& message) {
  Json head{{"name", message.name},
            {"id", message.id},
            {"extended", message.is_extended},
            {"length", message.length},
            {"transmitter", message.transmitter}};
  if (!message.other_transmitters.empty()) head["other_transmitters"] = message.other_transmitters;
  if (!message.comment.empty()) head["comment"] = message.comment;
  if (!message.attributes.empty()) head["attributes"] = attributes_json(message.attributes);
  std::string text = line(head);
  text.pop_back();  // the closing brace
  fmt::print(out, "{},\"signals\":", text);
  write_array(out, "    ", message.signals, [&](const DbcSignal& signal) {
    fmt::print(out, "{}", line(signal_json(message, signal)));
  });
  std::fputs("}", out);
}

std::size_t signal_count(const DbcDatabase& dbc) {
  std::size_t count = 0;
  for (const DbcMessage& message : dbc.messages) count += message.signals.size();
  return count;
}

std::size_t count_of(const DbcDatabase& dbc, DbcSeverity severity) {
  return static_cast<std::size_t>(
      std::count_if(dbc.warnings.begin(), dbc.warnings.end(),
                    [&](const DbcWarning& warning) { return warning.severity == severity; }));
}

}  // namespace

void print_dbc(std::FILE* out, const DbcDatabase& dbc) {
  for (const DbcMessage& message : dbc.messages) {
    fmt::print(out, "  0x{:0{}X} {} [{}]\n", message.id, message.is_extended ? 8 : 3, message.name,
               message.length);
    for (const DbcSignal& signal : message.signals) {
      fmt::print(out, "    {:<24} {:>2} bits at {:>3} {} {:<8} factor {:g}, offset {:g} {}\n",
                 signal.name, signal.bit_count, signal.start_bit,
                 signal.byte_order == ByteOrder::kLittleEndian ? "LE" : "BE",
                 type_name(signal.type), signal.factor, signal.offset, signal.unit);
    }
  }
  for (const DbcWarning& warning : dbc.warnings) {
    fmt::print(out, "{}\n", warning_text(dbc, warning));
  }
  if (dbc.further_warning_count > 0) {
    fmt::print(out, "and {} more warnings\n", dbc.further_warning_count);
  }
  fmt::print(out, "{}: {} messages, {} signals; {} errors, {} warnings, {} notes\n", dbc.source,
             dbc.messages.size(), signal_count(dbc), count_of(dbc, DbcSeverity::kError),
             count_of(dbc, DbcSeverity::kWarning) + dbc.further_warning_count,
             count_of(dbc, DbcSeverity::kNote));
}

void write_dbc_json(std::FILE* out, const DbcDatabase& dbc) {
  fmt::print(out,
             "{{\n  \"kind\": \"dbc\",\n  \"file\": {},\n  \"version\": {},\n  \"nodes\": {},\n"
             "  \"message_count\": {},\n  \"signal_count\": {},\n  \"messages\": ",
             line(dbc.source), line(dbc.version), line(dbc.nodes), dbc.messages.size(),
             signal_count(dbc));
  write_array(out, "  ", dbc.messages,
              [&](const DbcMessage& message) { write_message(out, message); });
  std::fputs(",\n  \"overlaps\": ", out);
  write_array(out, "  ", dbc.overlaps, [&](const DbcOverlap& overlap) {
    const DbcMessage& message = dbc.messages[overlap.message];
    fmt::print(
        out, "{}",
        line({{"message", message.name},
              {"signals",
               {message.signals[overlap.earlier].name, message.signals[overlap.later].name}}}));
  });
  std::fputs(",\n  \"warnings\": ", out);
  write_array(out, "  ", dbc.warnings, [&](const DbcWarning& warning) {
    fmt::print(out, "{}",
               line({{"line", warning.position.line},
                     {"column", warning.position.column},
                     {"severity", severity_name(warning.severity)},
                     {"text", warning.text}}));
  });
  fmt::print(out, ",\n  \"further_warnings\": {}\n}}\n", dbc.further_warning_count);
}

}  // namespace faultline
