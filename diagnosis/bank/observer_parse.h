#pragma once

#include "diagnosis/bank/bank.h"
#include "diagnosis/bank/json_cursor.h"

namespace faultline {

/// Reads a filter's "observer" (observer_text) into `filter`, whose other fields are already there.
/// Private to diagnosis/bank. @throws BankFileError.
void read_observer(const JsonCursor& object, const Bank& bank, ResidualFilter& filter);

}  // namespace faultline
