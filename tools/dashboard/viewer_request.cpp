#include "tools/dashboard/viewer_request.h"

#include <algorithm>
#include <cmath>
#include <initializer_list>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <nlohmann/json.hpp>

namespace faultline {
namespace {

using Json = nlohmann::json;

/// Longest name of a target or a kind.
constexpr std::size_t kLongestName = 256;

std::string text_of(const Json& request, const char* key, bool is_required) {
  const auto entry = request.find(key);
  if (entry == request.end()) {
    if (!is_required) return {};
    throw ViewerRequestError(fmt::format("found no {}, expected a text", key));
  }
  if (!entry->is_string()) {
    throw ViewerRequestError(fmt::format("{}: found {}, expected a text", key, entry->type_name()));
  }
  auto text = entry->get<std::string>();
  const bool has_control = std::any_of(text.begin(), text.end(), [](char letter) {
    return static_cast<unsigned char>(letter) < 0x20 || letter == 0x7f;
  });
  if (text.size() > kLongestName || has_control || (is_required && text.empty())) {
    throw ViewerRequestError(
        fmt::format("{}: found {} bytes{}, expected 1 to {} without control characters", key,
                    text.size(), has_control ? " with control characters" : "", kLongestName));
  }
  return text;
}

void refuse_other_keys(const Json& request, std::initializer_list<const char*> known) {
  for (const auto& entry : request.items()) {
    if (std::find(known.begin(), known.end(), entry.key()) == known.end()) {
      throw ViewerRequestError(fmt::format("found a key that is none of: {}",
                                           fmt::join(known.begin(), known.end(), ", ")));
    }
  }
}

}  // namespace

inject_t parse_viewer_request(std::string_view text) {
  if (text.size() > kLongestRequest) {
    throw ViewerRequestError(
        fmt::format("found {} bytes, expected {} at most", text.size(), kLongestRequest));
  }
  // The parser takes a NUL for the end of the text.
  if (text.find('\0') != std::string_view::npos) {
    throw ViewerRequestError("found no JSON, expected a JSON object without NUL");
  }
  const Json request = Json::parse(text.begin(), text.end(), nullptr, false);
  if (!request.is_object()) {
    throw ViewerRequestError(request.is_discarded() ? "found no JSON, expected a JSON object"
                                                    : "found JSON, but expected an object");
  }
  const std::string type = text_of(request, "type", true);
  inject_t result{};
  result.probability = 1.0;
  if (type == "clear") {
    refuse_other_keys(request, {"type", "target"});
    result.clear = 1;
    result.target = text_of(request, "target", false);
    return result;
  }
  if (type != "inject") {
    throw ViewerRequestError("type: found another one, expected inject or clear");
  }
  refuse_other_keys(request, {"type", "target", "kind", "value"});
  result.target = text_of(request, "target", true);
  result.kind = text_of(request, "kind", true);
  if (const auto value = request.find("value"); value != request.end()) {
    if (!value->is_number() || !std::isfinite(value->get<double>())) {
      throw ViewerRequestError("value: found something else, expected a finite number");
    }
    result.has_value = 1;
    result.value = value->get<double>();
  }
  return result;
}

}  // namespace faultline
