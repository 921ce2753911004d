#pragma once

#include <cstdint>
#include <string>

#include "drivers/dbc/dbc_database.h"

namespace faultline {

/// Tells on stderr what of an input was passed over: the first ones in full, at the end how many
/// more there were.
class ProblemReport {
 public:
  void add(const std::string& text);
  /// Tells what is no problem.
  static void remark(const std::string& text);
  /// kExitYes if there was none, else kExitBadInput; tells how many were not shown.
  [[nodiscard]] int exit_code();

 private:
  static constexpr std::uint64_t kShown = 20;
  std::uint64_t count_ = 0;
};

/// Tells on stderr which statements of `dbc` could not be understood.
void report_dbc_errors(const DbcDatabase& dbc);

/// "bench.dbc:12:3: error: found ..., expected ...": one warning for people.
[[nodiscard]] std::string warning_text(const DbcDatabase& dbc, const DbcWarning& warning);

/// "note", "warning", "error".
[[nodiscard]] const char* severity_name(DbcSeverity severity) noexcept;

}  // namespace faultline
