#include "tools/lcm/message_sink.h"

#include <cerrno>
#include <cstring>
#include <fstream>

#include <fmt/format.h>
#include <lcm/lcm-cpp.hpp>

#include "tools/lcm/lcm_url.h"
#include "tools/lcm/log_event.h"

namespace faultline {
namespace {

/// Whether `file` may be replaced by a log: absent, empty, a device, or an LCM log.
bool may_be_replaced(const std::filesystem::path& file) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(file, error)) return true;
  std::ifstream in(file, std::ios::binary);
  std::string first(kLogMagic.size(), '\0');
  in.read(first.data(), static_cast<std::streamsize>(first.size()));
  return in.gcount() == 0 || first == kLogMagic;
}

class LogSink final : public MessageSink {
 public:
  explicit LogSink(const std::filesystem::path& file) : name_(file.string()) {
    errno = 0;
    log_ = lcm_eventlog_create(name_.c_str(), "w");
    if (log_ == nullptr) fail("cannot open");
  }
  ~LogSink() override {
    if (log_ != nullptr) lcm_eventlog_destroy(log_);
  }
  LogSink(const LogSink&) = delete;
  LogSink& operator=(const LogSink&) = delete;

  void publish(const char* channel, std::int64_t utime,
               std::span<const std::uint8_t> message) override {
    lcm_eventlog_event_t event{};
    event.timestamp = utime;
    event.channellen = static_cast<std::int32_t>(std::strlen(channel));
    event.datalen = static_cast<std::int32_t>(message.size());
    event.channel = const_cast<char*>(channel);
    event.data = const_cast<std::uint8_t*>(message.data());
    errno = 0;
    if (lcm_eventlog_write_event(log_, &event) != 0) fail("cannot write");
  }

  void flush() override {
    errno = 0;
    if (std::fflush(log_->f) != 0) fail("cannot write");
  }

  void close() override {
    if (log_ == nullptr) return;
    flush();
    lcm_eventlog_destroy(log_);
    log_ = nullptr;
  }

 private:
  [[noreturn]] void fail(const char* what) const {
    throw MessageSinkError(fmt::format("log {}: {}: {}", name_, what, std::strerror(errno)));
  }

  std::string name_;
  lcm_eventlog_t* log_ = nullptr;
};

class LiveSink final : public MessageSink {
 public:
  explicit LiveSink(const std::string& url) : url_(url), lcm_(url) {
    if (!lcm_.good()) throw MessageSinkError(lcm_refusal_text(url));
  }

  void publish(const char* channel, std::int64_t /*utime*/,
               std::span<const std::uint8_t> message) override {
    errno = 0;
    if (lcm_.publish(channel, message.data(), static_cast<unsigned>(message.size())) != 0) {
      throw MessageSinkError(
          fmt::format("LCM {}: cannot send on {}: {}", url_, channel, std::strerror(errno)));
    }
  }
  void flush() override {}
  void close() override {}

 private:
  std::string url_;
  lcm::LCM lcm_;
};

}  // namespace

void require_replaceable(const std::filesystem::path& file) {
  if (may_be_replaced(file)) return;
  throw std::invalid_argument(fmt::format(
      "log {}: found a file that is no LCM log, expected none or a log to replace", file.string()));
}

std::unique_ptr<MessageSink> open_log(const std::filesystem::path& file) {
  require_replaceable(file);
  return std::make_unique<LogSink>(file);
}

std::unique_ptr<MessageSink> open_live(const std::string& url) {
  check_lcm_url(url);
  return std::make_unique<LiveSink>(url);
}

}  // namespace faultline
