#pragma once

#include <cstdio>

#include "drivers/dbc/dbc_database.h"

namespace faultline {

/// Messages, signals and warnings of a DBC for people.
void print_dbc(std::FILE* out, const DbcDatabase& dbc);

/// All of them as JSON: {"kind":"dbc", "file", "version", "nodes", "message_count", "signal_count",
/// "messages", "overlaps", "warnings", "further_warnings"}. Takes no memory for it.
void write_dbc_json(std::FILE* out, const DbcDatabase& dbc);

}  // namespace faultline
