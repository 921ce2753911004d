#pragma once

#include "diagnosis/design/eigenstructure/eigenstructure_request.h"
#include "diagnosis/model/toml_reader.h"

namespace faultline {

/// Reads [eigenstructure] of bank.toml. @throws InputError
void read_eigenstructure(TomlTable& table, EigenstructureRequest& request);

}  // namespace faultline
