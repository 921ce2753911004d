#pragma once

#include <string>
#include <vector>

#include "diagnosis/bank/bank.h"
#include "tools/replay/result_comparison.h"

namespace faultline {

/// A difference in words, one line per member that differs, the first few of them:
/// "FAULTLINE_RESIDUAL, cycle 412", "  residual r14: recorded 0.1 (3fb999999999999a), replayed 0.2
/// (3fc999999999999a)".
[[nodiscard]] std::vector<std::string> describe(const ResultComparison::Difference& difference,
                                                const Bank& bank);

}  // namespace faultline
