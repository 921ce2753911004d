#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace faultline {

/// `--channel NAME..`: full names, or ours without their prefix ("SAMPLE"). None: all.
[[nodiscard]] bool is_chosen(const std::vector<std::string>& channels, std::string_view channel);

/// @throws std::invalid_argument one of `channels` names none of `found`.
void require_found(const std::vector<std::string>& channels, const std::vector<std::string>& found,
                   const std::string& log);

}  // namespace faultline
