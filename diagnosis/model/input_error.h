#pragma once

#include <stdexcept>
#include <string>

namespace faultline {

/// Position in a text file, counted from 1; line 0: the file as a whole.
struct SourcePosition {
  int line = 0;
  int column = 0;
};

/// A file or option that cannot be used. `what()` is
/// "file:line:column: <field>: found <found>, expected <expected>".
class InputError : public std::runtime_error {
 public:
  InputError(const std::string& source, SourcePosition position, const std::string& text);

  [[nodiscard]] const std::string& source() const noexcept { return source_; }
  [[nodiscard]] SourcePosition position() const noexcept { return position_; }

 private:
  std::string source_;
  SourcePosition position_;
};

}  // namespace faultline
