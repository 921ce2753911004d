#pragma once

#include "diagnosis/design/uio/uio_request.h"
#include "diagnosis/model/toml_reader.h"

namespace faultline {

/// Reads [uio] of bank.toml. @throws InputError a wrong value, at its place.
void read_uio(TomlTable& table, UioRequest& request);

}  // namespace faultline
