#pragma once

#include <string>

#include "diagnosis/bank/bank.h"

namespace faultline {

/// What was proved of a filter, in words: "r23 ignores u2 and u3: leakage 3e-14. It sees u1 from
/// 0.5, within 0.12 s of twice that; ..". The leakage is the largest gain at any frequency, per
/// fault size, from the faults that it ignores; that of inputs and decoupled disturbances follows.
[[nodiscard]] std::string certificate_text(const Bank& bank, const ResidualFilter& filter);

/// "u2", "u2 and u3", "u1, u2 and u3"; "nothing" for none.
[[nodiscard]] std::string names_in_words(const std::vector<std::string>& names);

}  // namespace faultline
