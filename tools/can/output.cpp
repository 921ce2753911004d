#include "tools/can/output.h"

#include <cerrno>
#include <cstdio>
#include <cstring>

#include "tools/cli.h"

namespace faultline {

void Output::flush_if_large() {
  constexpr std::size_t kLarge = std::size_t{1} << 16;
  if (buffer_.size() >= kLarge) flush();
}

void Output::flush() {
  if (std::fwrite(buffer_.data(), 1, buffer_.size(), stdout) != buffer_.size() ||
      std::fflush(stdout) != 0) {
    throw OutputError(fmt::format("cannot write to stdout: {}", std::strerror(errno)));
  }
  buffer_.clear();
}

}  // namespace faultline
