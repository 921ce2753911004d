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

Json message_json(const DbcMessage& message) {
  Json json{{"name", message.name},
            {"id", message.id},
            {"extended", message.is_extended},
            {"length", message.length},
            {"transmitter", message.transmitter},
            {"signals", Json::array()}};
  for (const DbcSignal& signal : message.signals) {
    json["signals"].push_back(signal_json(message, signal));
  }
  if (!message.other_transmitters.empty()) json["other_transmitters"] = message.other_transmitters;
  if (!message.comment.empty()) json["comment"] = message.comment;
  if (!message.attributes.empty()) json["attributes"] = attributes_json(message.attributes);
  return json;
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

Json dbc_json(const DbcDatabase& dbc) {
  Json json{{"kind", "dbc"},
            {"file", dbc.source},
            {"version", dbc.version},
            {"nodes", dbc.nodes},
            {"message_count", dbc.messages.size()},
            {"signal_count", signal_count(dbc)},
            {"messages", Json::array()},
            {"overlaps", Json::array()},
            {"warnings", Json::array()},
            {"further_warnings", dbc.further_warning_count}};
  for (const DbcMessage& message : dbc.messages) json["messages"].push_back(message_json(message));
  for (const DbcOverlap& overlap : dbc.overlaps) {
    const DbcMessage& message = dbc.messages[overlap.message];
    json["overlaps"].push_back(
        {{"message", message.name},
         {"signals",
          {message.signals[overlap.earlier].name, message.signals[overlap.later].name}}});
  }
  for (const DbcWarning& warning : dbc.warnings) {
    json["warnings"].push_back({{"line", warning.position.line},
                                {"column", warning.position.column},
                                {"severity", severity_name(warning.severity)},
                                {"text", warning.text}});
  }
  return json;
}

}  // namespace faultline
