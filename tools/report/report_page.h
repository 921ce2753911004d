#pragma once

#include <string>
#include <vector>

#include "tools/report/run_record.h"

namespace faultline {

/// The report of a run, or of two that are compared, as one HTML page that needs no other file and
/// no network: what is in it comes from the records alone. The same records give the same page.
/// @param records one or two
/// @param version of the program, for the page to tell
[[nodiscard]] std::string report_page(std::vector<RunRecord> records, const std::string& version);

/// A page around `body` (HTML) with the charts' `data` (ChartData::json) and all that shows them;
/// with none (""), there is no script in it.
[[nodiscard]] std::string html_page(const std::string& title, const std::string& body,
                                    const std::string& data);

}  // namespace faultline
