#pragma once

#include <filesystem>
#include <stdexcept>
#include <string>
#include <string_view>

#include "drivers/dbc/dbc_database.h"

namespace faultline {

/// A DBC text that cannot be understood. `what()` is "file:line:column: found ..., expected ...".
class DbcError : public std::runtime_error {
 public:
  DbcError(const std::string& source, DbcPosition position, const std::string& text);
  [[nodiscard]] DbcPosition position() const noexcept { return position_; }

 private:
  DbcPosition position_;
};

/// Reads a DBC text. `source` is the name used in messages.
/// @throws DbcError the text is no DBC.
[[nodiscard]] DbcDatabase parse_dbc(std::string_view text, const std::string& source);

/// Reads a DBC file. @throws DbcError as parse_dbc; @throws std::system_error the file cannot be
/// read.
[[nodiscard]] DbcDatabase read_dbc(const std::filesystem::path& file);

}  // namespace faultline
