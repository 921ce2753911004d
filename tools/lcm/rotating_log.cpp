#include "tools/lcm/rotating_log.h"

#include <algorithm>
#include <cstring>
#include <deque>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include "tools/lcm/channels.h"

namespace faultline {
namespace {

/// Of an event, beside channel and message (lcm/eventlog.c).
constexpr std::uint64_t kEventHeaderBytes = 28;

/// Whether `name` is that of a file of the split log `file`.
bool is_part_of(const std::filesystem::path& file, const std::string& name) {
  const std::string stem = file.stem().string() + "-";
  const std::string extension = file.extension().string();
  constexpr std::size_t kFewestDigits = 4;
  if (name.size() < stem.size() + kFewestDigits + extension.size()) return false;
  if (!name.starts_with(stem) || !name.ends_with(extension)) return false;
  const auto digits =
      std::string_view(name).substr(stem.size(), name.size() - stem.size() - extension.size());
  return digits.find_first_not_of("0123456789") == std::string_view::npos;
}

/// Files of an earlier run beside those of this one would be taken for its own.
void delete_earlier(const std::filesystem::path& file) {
  const auto folder = file.has_parent_path() ? file.parent_path() : std::filesystem::path(".");
  std::vector<std::filesystem::path> earlier;
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator(folder, error)) {
    if (is_part_of(file, entry.path().filename().string())) earlier.push_back(entry.path());
  }
  for (const auto& part : earlier) require_replaceable(part);
  for (const auto& part : earlier) std::filesystem::remove(part, error);
}

class RotatingLog final : public MessageSink {
 public:
  RotatingLog(std::filesystem::path file, const LogSplit& split)
      : file_(std::move(file)), split_(split) {
    delete_earlier(file_);
    open_next();
  }

  void publish(const char* channel, std::int64_t utime,
               std::span<const std::uint8_t> message) override {
    if (std::strcmp(channel, kRunChannel) == 0) {
      runs_.push_back({utime, {message.begin(), message.end()}});
    } else {
      const std::uint64_t bytes = kEventHeaderBytes + std::strlen(channel) + message.size();
      if (is_full(utime, bytes)) rotate();
      // Messages need not come in the order of their times.
      first_utime_ = has_messages_ ? std::min(first_utime_, utime) : utime;
      has_messages_ = true;
    }
    write(channel, utime, message);
  }
  void flush() override { log_->flush(); }
  void close() override { log_->close(); }

 private:
  struct RunMessage {
    std::int64_t utime = 0;
    std::vector<std::uint8_t> bytes;
  };

  /// Every file gets a message, however small it shall be.
  [[nodiscard]] bool is_full(std::int64_t utime, std::uint64_t bytes) const noexcept {
    if (!has_messages_) return false;
    return (split_.bytes > 0 && bytes_ + bytes > split_.bytes) ||
           (split_.time_us > 0 && utime - first_utime_ >= split_.time_us);
  }

  void write(const char* channel, std::int64_t utime, std::span<const std::uint8_t> message) {
    log_->publish(channel, utime, message);
    bytes_ += kEventHeaderBytes + std::strlen(channel) + message.size();
  }

  void rotate() {
    log_->close();
    open_next();
    for (const RunMessage& run : runs_) write(kRunChannel, run.utime, run.bytes);
  }

  void open_next() {
    log_ = open_log(split_log_file(file_, ++number_));
    bytes_ = 0;
    has_messages_ = false;
    kept_.push_back(number_);
    // One that somebody moved away is none of ours any more.
    while (split_.keep > 0 && kept_.size() > split_.keep) {
      std::error_code error;
      std::filesystem::remove(split_log_file(file_, kept_.front()), error);
      kept_.pop_front();
    }
  }

  std::filesystem::path file_;
  LogSplit split_;
  std::unique_ptr<MessageSink> log_;
  std::vector<RunMessage> runs_;
  std::deque<std::uint64_t> kept_;
  std::uint64_t number_ = 0, bytes_ = 0;
  std::int64_t first_utime_ = 0;
  bool has_messages_ = false;
};

}  // namespace

std::filesystem::path split_log_file(const std::filesystem::path& file, std::uint64_t number) {
  std::filesystem::path part = file;
  part.replace_filename(
      fmt::format("{}-{:04}{}", file.stem().string(), number, file.extension().string()));
  return part;
}

std::filesystem::path split_log_pattern(const std::filesystem::path& file) {
  std::filesystem::path pattern = file;
  pattern.replace_filename(file.stem().string() + "-*" + file.extension().string());
  return pattern;
}

std::unique_ptr<MessageSink> open_rotating_log(const std::filesystem::path& file,
                                               const LogSplit& split) {
  return std::make_unique<RotatingLog>(file, split);
}

}  // namespace faultline
