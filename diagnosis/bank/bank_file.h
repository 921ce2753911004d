#pragma once

#include <filesystem>
#include <stdexcept>
#include <string>
#include <string_view>

#include "diagnosis/bank/bank.h"

namespace faultline {

/// A bank file that cannot be used. `what()` is "file:line:column: <path>: found ..., expected
/// ...".
class BankFileError : public std::runtime_error {
 public:
  /// Position counted from 1; line 0: the file as a whole.
  BankFileError(const std::string& source, int line, int column, const std::string& text);

  [[nodiscard]] const std::string& source() const noexcept { return source_; }
  [[nodiscard]] int line() const noexcept { return line_; }
  [[nodiscard]] int column() const noexcept { return column_; }

 private:
  std::string source_;
  int line_;
  int column_;
};

/// The bank as JSON text. Doubles round-trip exactly: parse_bank(bank_text(b)) equals b to the bit.
[[nodiscard]] std::string bank_text(const Bank& bank);

/// Writes NAME.bank.json whole or not at all (temporary file, then rename).
/// @throws std::system_error the file cannot be written.
void write_bank(const Bank& bank, const std::filesystem::path& file);

/// Reads a bank file. Strict: unknown keys, wrong shapes, non-finite numbers, filters that are not
/// stable are refused.
/// @throws BankFileError anything wrong in it; @throws std::system_error it cannot be read.
[[nodiscard]] Bank read_bank(const std::filesystem::path& file);
[[nodiscard]] Bank parse_bank(std::string_view text, const std::string& source);

}  // namespace faultline
