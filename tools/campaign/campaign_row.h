#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

namespace faultline {

/// A value of a row: nothing, or of the type of its column.
using Cell = std::variant<std::monostate, std::int64_t, double, std::string>;

/// A column of the table of runs.
struct RunColumn {
  std::string_view name, type;  ///< as SQL has them
};

/// The columns, in order. Counts of cycles, the isolation score and delays are those of
/// diagnosis_metrics(); docs/campaigns.md says what each means.
inline constexpr std::array<RunColumn, 22> kRunColumns{{
    {"run", "INTEGER PRIMARY KEY"},
    {"seed", "INTEGER NOT NULL"},
    {"point", "TEXT NOT NULL"},
    {"error", "TEXT"},
    {"truth", "TEXT"},
    {"kind", "TEXT"},
    {"size", "REAL"},
    {"onset_s", "REAL"},
    {"verdict", "TEXT"},
    {"faulty_cycles", "INTEGER"},
    {"detected_cycles", "INTEGER"},
    {"faultless_cycles", "INTEGER"},
    {"false_alarm_cycles", "INTEGER"},
    {"clearing_cycles", "INTEGER"},
    {"inhibited_cycles", "INTEGER"},
    {"false_alarms", "INTEGER"},
    {"isolation_score", "REAL"},
    {"detection_delay_s", "REAL"},
    {"isolation_delay_s", "REAL"},
    {"expectations_met", "INTEGER"},
    {"peak_faultless", "TEXT"},
    {"peak_faulty", "TEXT"},
}};

/// What one run came to: a cell per column.
using CampaignRow = std::vector<Cell>;

/// Index of a column. @pre it is one
[[nodiscard]] constexpr std::size_t column_index(std::string_view name) {
  for (std::size_t i = 0; i < kRunColumns.size(); ++i) {
    if (kRunColumns[i].name == name) return i;
  }
  return kRunColumns.size();
}

/// A row as one line of text, and back: how rows travel between processes.
[[nodiscard]] std::string row_text(const CampaignRow& row);
/// @throws std::invalid_argument it is none.
[[nodiscard]] CampaignRow row_of_text(std::string_view text);

}  // namespace faultline
