#pragma once

#include <fmt/format.h>

namespace faultline {

/// Text on its way to stdout, written in large pieces.
class Output {
 public:
  [[nodiscard]] fmt::memory_buffer& buffer() noexcept { return buffer_; }
  /// Writes what is there if it is much. @throws OutputError
  void flush_if_large();
  /// Writes what is there. @throws OutputError
  void flush();

 private:
  fmt::memory_buffer buffer_;
};

}  // namespace faultline
