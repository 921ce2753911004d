#include "tools/campaign/campaign_row.h"

#include <stdexcept>
#include <type_traits>

#include <nlohmann/json.hpp>

namespace faultline {

using Json = nlohmann::json;

std::string row_text(const CampaignRow& row) {
  Json json = Json::array();
  for (const Cell& cell : row) {
    std::visit(
        [&json](const auto& value) {
          if constexpr (std::is_same_v<std::decay_t<decltype(value)>, std::monostate>) {
            json.push_back(nullptr);
          } else {
            json.push_back(value);
          }
        },
        cell);
  }
  return json.dump(-1, ' ', false, Json::error_handler_t::replace);
}

CampaignRow row_of_text(std::string_view text) {
  const Json json = Json::parse(text, nullptr, false);
  if (!json.is_array() || json.size() != kRunColumns.size()) {
    throw std::invalid_argument("found something else than a row of a campaign");
  }
  CampaignRow row;
  for (const Json& value : json) {
    if (value.is_null()) {
      row.emplace_back();
    } else if (value.is_number_integer()) {
      row.emplace_back(value.get<std::int64_t>());
    } else if (value.is_number()) {
      row.emplace_back(value.get<double>());
    } else {
      row.emplace_back(value.get<std::string>());
    }
  }
  return row;
}

}  // namespace faultline
