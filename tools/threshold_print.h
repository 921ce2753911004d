#pragma once

#include <cstdio>

#include "diagnosis/bank/bank.h"

namespace faultline {

/// Where the thresholds come from: what certified ones consist of, the tests and what they are
/// tuned to, what calibrated ones were fitted to. Nothing where they are given numbers.
void print_thresholds(std::FILE* out, const Bank& bank);

}  // namespace faultline
