#pragma once

#include <cstdio>

#include <nlohmann/json_fwd.hpp>

#include "drivers/dbc/dbc_database.h"

namespace faultline {

/// Messages, signals and warnings of a DBC for people.
void print_dbc(std::FILE* out, const DbcDatabase& dbc);

/// All of them as data: {"kind":"dbc", "file", "version", "nodes", "counts", "messages",
/// "overlaps", "warnings"}.
[[nodiscard]] nlohmann::ordered_json dbc_json(const DbcDatabase& dbc);

}  // namespace faultline
