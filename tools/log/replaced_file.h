#pragma once

#include <cstdio>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>

namespace faultline {

/// A file that is written under a name of its own and takes its place when it is complete.
class ReplacedFile {
 public:
  /// @throws OutputError it cannot be written.
  explicit ReplacedFile(std::filesystem::path file);
  /// Without `commit` nothing is left of it.
  ~ReplacedFile();
  ReplacedFile(const ReplacedFile&) = delete;
  ReplacedFile& operator=(const ReplacedFile&) = delete;

  /// @throws OutputError
  void write(const void* bytes, std::size_t count);
  void write(std::string_view text) { write(text.data(), text.size()); }
  /// @throws OutputError
  void commit();

 private:
  [[noreturn]] void fail() const;

  std::filesystem::path file_, temporary_;
  std::FILE* out_ = nullptr;
};

}  // namespace faultline
