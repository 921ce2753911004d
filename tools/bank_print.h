#pragma once

#include <cstdio>

#include "diagnosis/bank/bank.h"

namespace faultline {

/// A bank for people: what it is for, its structure matrix with DC gains, thresholds, poles, and
/// how it decides.
void print_bank(std::FILE* out, const Bank& bank);

}  // namespace faultline
