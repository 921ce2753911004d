#include "tools/log/channel_choice.h"

#include <algorithm>
#include <stdexcept>

#include <fmt/format.h>
#include <fmt/ranges.h>

namespace faultline {
namespace {

constexpr std::string_view kPrefix = "FAULTLINE_";

bool names(std::string_view wanted, std::string_view channel) {
  return wanted == channel ||
         (channel.starts_with(kPrefix) && wanted == channel.substr(kPrefix.size()));
}

}  // namespace

bool is_chosen(const std::vector<std::string>& channels, std::string_view channel) {
  return channels.empty() ||
         std::any_of(channels.begin(), channels.end(),
                     [&](const std::string& wanted) { return names(wanted, channel); });
}

void require_found(const std::vector<std::string>& channels, const std::vector<std::string>& found,
                   const std::string& log) {
  for (const std::string& wanted : channels) {
    const bool is_found = std::any_of(found.begin(), found.end(), [&](const std::string& channel) {
      return names(wanted, channel);
    });
    if (is_found) continue;
    throw std::invalid_argument(
        fmt::format("{}: --channel: found no channel {}, expected one of {}", log, wanted,
                    fmt::join(found, ", ")));
  }
}

}  // namespace faultline
