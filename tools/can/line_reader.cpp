#include "tools/can/line_reader.h"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <system_error>

#include <fcntl.h>
#include <unistd.h>

#include <sys/stat.h>

namespace faultline {
namespace {

constexpr std::size_t kReadBytes = std::size_t{1} << 16;

}  // namespace

LineReader::LineReader(const std::string& file, std::function<void()> on_pause)
    : source_(file == "-" ? "stdin" : file),
      on_pause_(std::move(on_pause)),
      buffer_(LineReader::kLongestLine + kReadBytes) {
  fd_ = file == "-" ? STDIN_FILENO : ::open(file.c_str(), O_RDONLY | O_CLOEXEC);
  struct stat status {};
  const bool is_open = fd_ >= 0 && ::fstat(fd_, &status) == 0;
  const int error = is_open && S_ISDIR(status.st_mode) ? EISDIR : errno;
  if (!is_open || S_ISDIR(status.st_mode)) {
    if (fd_ > STDIN_FILENO) ::close(fd_);
    throw std::system_error(error, std::generic_category(), "cannot read " + source_);
  }
}

LineReader::~LineReader() {
  if (fd_ != STDIN_FILENO) ::close(fd_);
}

bool LineReader::fill() {
  if (is_at_end_) return false;
  if (begin_ > 0) {
    std::memmove(buffer_.data(), buffer_.data() + begin_, end_ - begin_);
    end_ -= begin_;
    begin_ = 0;
  }
  on_pause_();
  for (;;) {
    const ssize_t count =
        ::read(fd_, buffer_.data() + end_, std::min(kReadBytes, buffer_.size() - end_));
    if (count > 0) {
      end_ += static_cast<std::size_t>(count);
      return true;
    }
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) {
      throw std::system_error(errno, std::generic_category(), "cannot read " + source_);
    }
    is_at_end_ = true;
    return false;
  }
}

std::string_view LineReader::peek(std::size_t count) {
  count = std::min(count, kReadBytes);
  while (end_ - begin_ < count && fill()) {
  }
  return {buffer_.data() + begin_, std::min(count, end_ - begin_)};
}

std::optional<std::string_view> LineReader::next() {
  if (is_cut_) skip_rest_of_line();
  is_cut_ = false;
  std::size_t searched = 0;
  for (;;) {
    const char* const from = buffer_.data() + begin_ + searched;
    const std::size_t size = end_ - begin_;
    const auto* const newline =
        size == searched ? nullptr
                         : static_cast<const char*>(std::memchr(from, '\n', size - searched));
    const bool is_too_long = newline == nullptr && size >= kLongestLine;
    if (newline == nullptr && !is_too_long) {
      searched = size;
      if (fill()) continue;
      if (size == 0) return std::nullopt;
    }
    std::string_view text(buffer_.data() + begin_, size);
    if (newline != nullptr) {
      text = text.substr(0, static_cast<std::size_t>(newline - text.data()));
      begin_ += text.size() + 1;
    } else {
      begin_ += size;
      is_cut_ = is_too_long;
    }
    if (text.ends_with('\r')) text.remove_suffix(1);
    ++line_;
    return text;
  }
}

void LineReader::skip_rest_of_line() {
  for (;;) {
    const auto* const newline =
        static_cast<const char*>(std::memchr(buffer_.data() + begin_, '\n', end_ - begin_));
    if (newline != nullptr) {
      begin_ = static_cast<std::size_t>(newline - buffer_.data()) + 1;
      return;
    }
    begin_ = end_;
    if (!fill()) return;
  }
}

}  // namespace faultline
