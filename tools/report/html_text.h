#pragma once

#include <string>
#include <string_view>

namespace faultline {

/// `text` as HTML shows it, between tags and in quoted attributes: & < > " ' are escaped, control
/// characters and what is no UTF-8 become U+FFFD. Names come from files, and files from anywhere.
[[nodiscard]] std::string html(std::string_view text);

/// `json` (ASCII) as it may stand in a <script> element: no tag can end it.
[[nodiscard]] std::string json_in_script(std::string json);

}  // namespace faultline
