#pragma once

#include <string>
#include <vector>

namespace faultline {

/// Writes the report of one log, or of two that are compared, to `output` ("-": stdout). What
/// stood there is replaced when the page is complete.
/// @param logs per run, the files of its log in order
/// @throws OutputError it cannot be written; as read_run_record.
void write_report(const std::vector<std::vector<std::string>>& logs, const std::string& output);

}  // namespace faultline
