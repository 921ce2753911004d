#pragma once

#include <string_view>

namespace faultline {

/// A file of the page, part of the program (page/, embedded by CMake).
struct PageFile {
  std::string_view path;  ///< "/dash.js"
  std::string_view type;  ///< its Content-Type
  std::string_view text;
  bool is_page = false;  ///< the page itself, for which the token is asked
};

/// nullptr: there is none at this path.
[[nodiscard]] const PageFile* find_page_file(std::string_view path) noexcept;

}  // namespace faultline
