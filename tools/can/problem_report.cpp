#include "tools/can/problem_report.h"

#include <cstdio>

#include <fmt/format.h>

#include "tools/cli.h"

namespace faultline {

void ProblemReport::add(const std::string& text) {
  if (++count_ <= kShown) fmt::print(stderr, "faultline: {}\n", text);
}

void ProblemReport::remark(const std::string& text) { fmt::print(stderr, "faultline: {}\n", text); }

int ProblemReport::exit_code() {
  if (count_ > kShown) fmt::print(stderr, "faultline: and {} more like these\n", count_ - kShown);
  return count_ == 0 ? kExitYes : kExitBadInput;
}

const char* severity_name(DbcSeverity severity) noexcept {
  switch (severity) {
    case DbcSeverity::kNote:
      return "note";
    case DbcSeverity::kWarning:
      return "warning";
    case DbcSeverity::kError:
      break;
  }
  return "error";
}

std::string warning_text(const DbcDatabase& dbc, const DbcWarning& warning) {
  return fmt::format("{}:{}:{}: {}: {}", dbc.source, warning.position.line, warning.position.column,
                     severity_name(warning.severity), warning.text);
}

void report_dbc_errors(const DbcDatabase& dbc) {
  ProblemReport problems;
  for (const DbcWarning& warning : dbc.warnings) {
    if (warning.severity == DbcSeverity::kError) problems.add(warning_text(dbc, warning));
  }
  static_cast<void>(problems.exit_code());
}

}  // namespace faultline
