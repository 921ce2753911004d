#include "tools/log/replaced_file.h"

#include <cerrno>
#include <cstring>
#include <system_error>
#include <utility>

#include <unistd.h>

#include <fmt/format.h>

#include "tools/cli.h"

namespace faultline {

ReplacedFile::ReplacedFile(std::filesystem::path file)
    : file_(std::move(file)), temporary_(fmt::format("{}.{}.part", file_.string(), ::getpid())) {
  out_ = std::fopen(temporary_.c_str(), "wbx");
  if (out_ == nullptr) fail();
}

ReplacedFile::~ReplacedFile() {
  if (out_ == nullptr) return;
  std::fclose(out_);
  std::error_code error;
  std::filesystem::remove(temporary_, error);
}

void ReplacedFile::write(const void* bytes, std::size_t count) {
  if (std::fwrite(bytes, 1, count, out_) != count) fail();
}

void ReplacedFile::commit() {
  if (std::fflush(out_) != 0 || ::rename(temporary_.c_str(), file_.c_str()) != 0) fail();
  std::fclose(out_);
  out_ = nullptr;
}

void ReplacedFile::fail() const {
  throw OutputError(fmt::format("cannot write {}: {}", file_.string(), std::strerror(errno)));
}

}  // namespace faultline
