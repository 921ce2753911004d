#include "drivers/can/line_reader.h"

#include <algorithm>
#include <cerrno>
#include <cstring>

#include <unistd.h>

namespace faultline {
namespace {

/// Bytes asked for at a time.
constexpr std::size_t kReadSize = 1 << 16;

}  // namespace

LineReader::LineReader(int fd, std::size_t longest_line)
    : fd_(fd), longest_line_(longest_line), buffer_(longest_line + kReadSize) {}

bool LineReader::has_line() const noexcept {
  return begin_ != end_ && std::memchr(buffer_.data() + begin_, '\n', end_ - begin_) != nullptr;
}

std::string_view LineReader::peek(std::size_t count) noexcept {
  count = std::min(count, kReadSize);
  while (end_ - begin_ < count && fill()) {
  }
  return {buffer_.data() + begin_, std::min(count, end_ - begin_)};
}

LineReader::Status LineReader::next(std::string_view& line) noexcept {
  bool is_too_long = false;
  for (std::size_t searched = 0;;) {
    const char* const first = buffer_.data() + begin_;
    const std::size_t size = end_ - begin_;
    const void* const newline = std::memchr(first + searched, '\n', size - searched);
    if (newline != nullptr) {
      line = {first, static_cast<std::size_t>(static_cast<const char*>(newline) - first)};
      begin_ += line.size() + 1;
      break;
    }
    if (size > longest_line_) {
      is_too_long = true;
      begin_ = end_;  // only its end is still of interest
    }
    searched = end_ - begin_;
    if (fill()) continue;
    if (error_ != 0) return Status::kFailed;
    if (begin_ == end_ && !is_too_long) return Status::kEnd;
    line = {buffer_.data() + begin_, end_ - begin_};
    begin_ = end_;
    break;
  }
  ++line_number_;
  return is_too_long || line.size() > longest_line_ ? Status::kTooLong : Status::kLine;
}

bool LineReader::fill() noexcept {
  if (is_at_end_ || error_ != 0) return false;
  if (buffer_.size() - end_ < kReadSize) {
    std::memmove(buffer_.data(), buffer_.data() + begin_, end_ - begin_);
    end_ -= begin_;
    begin_ = 0;
  }
  for (;;) {
    const ::ssize_t count = ::read(fd_, buffer_.data() + end_, buffer_.size() - end_);
    if (count > 0) {
      end_ += static_cast<std::size_t>(count);
      return true;
    }
    if (count == 0) {
      is_at_end_ = true;
      return false;
    }
    if (errno == EINTR) continue;
    error_ = errno;
    return false;
  }
}

}  // namespace faultline
