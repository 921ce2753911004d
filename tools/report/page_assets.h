#pragma once

#include <string_view>

namespace faultline {

/// What a page carries with it: built into the program, so that it needs no file at run time.
struct PageAssets {
  std::string_view dygraph_script, dygraph_style;  ///< Debian's libjs-dygraphs (MIT licence)
  std::string_view report_script, report_style;
};
[[nodiscard]] const PageAssets& page_assets() noexcept;

}  // namespace faultline
