#pragma once

#include <cstdio>
#include <string>
#include <vector>

#include "diagnosis/bank/bank.h"

namespace faultline {

/// "u1, u2" of indices into `names`.
[[nodiscard]] std::string join_names(const std::vector<std::string>& names,
                                     const std::vector<std::size_t>& indices);

/// A bank for people: the structure matrix as a picture, what was certified of each residual, and
/// what each fault must be for the bank to find it.
void print_bank(std::FILE* out, const Bank& bank);

/// Smallest faults that are found, and how soon.
void print_fault_reach(std::FILE* out, const Bank& bank);

/// Which faults can look like which others, and how.
void print_isolability(std::FILE* out, const Bank& bank);

/// What the bank can do with one fault.
struct FaultReach {
  double detected_from = 0.0;      ///< smallest constant size that fires a residual; 0: none does
  double isolated_from = 0.0;      ///< that fires every residual that sees it at DC; 0: none does,
                                   ///< or another fault has the same signature
  double detection_delay_s = 0.0;  ///< until the first verdict, at twice that size
  double isolation_delay_s = 0.0;  ///< until the verdict that names it, at twice that size
  std::vector<std::string> transient_only;  ///< residuals that see it only while it changes
};

/// From the certificates of the filters; dwell and settle included.
[[nodiscard]] FaultReach fault_reach(const Bank& bank, std::size_t fault);

}  // namespace faultline
