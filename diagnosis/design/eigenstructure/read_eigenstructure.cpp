#include "diagnosis/design/eigenstructure/read_eigenstructure.h"

#include <fmt/format.h>

namespace faultline {
namespace {

// More rows than that no plant has outputs.
constexpr std::int64_t kMostRows = 1000;

}  // namespace

void read_eigenstructure(TomlTable& table, EigenstructureRequest& request) {
  if (table.has("assignment")) {
    const std::string word = table.choice("assignment", {"best", "left", "right", "geometric"});
    request.assignment = word == "best"    ? AssignmentChoice::kBest
                         : word == "left"  ? AssignmentChoice::kLeft
                         : word == "right" ? AssignmentChoice::kRight
                                           : AssignmentChoice::kGeometric;
  }
  request.weaken = table.optional_strings("weaken").value_or(std::vector<std::string>());
  for (const char* const key : {"criterion", "rows"}) {
    if (table.has(key) && request.weaken.empty()) {
      throw table.error(key,
                        "found it without \"weaken\", expected the disturbances that are to be "
                        "kept small");
    }
  }
  if (table.has("criterion")) {
    const std::string word = table.choice("criterion", {"low_rank", "static", "worst_case", "rms"});
    request.criterion = word == "low_rank" ? CompromiseCriterion::kLowRank
                        : word == "static" ? CompromiseCriterion::kStatic
                        : word == "rms"    ? CompromiseCriterion::kRms
                                           : CompromiseCriterion::kWorstCase;
  }
  if (const std::optional<std::int64_t> rows = table.optional_integer("rows")) {
    if (*rows < 1 || *rows > kMostRows) {
      throw table.error("rows", fmt::format("found {}, expected a whole number from 1", *rows));
    }
    request.rows = static_cast<std::uint32_t>(*rows);
  }
}

}  // namespace faultline
