#include "tools/log/log_files.h"

#include <cstdio>
#include <system_error>
#include <utility>

#include <unistd.h>

#include <fmt/format.h>

namespace faultline {
namespace {

/// The clock is read once in so many events.
constexpr std::uint32_t kEventsPerLook = 4096;
constexpr auto kProgressPeriod = std::chrono::milliseconds(200);

/// A run that is killed just when its log goes on in a new file leaves this empty.
bool is_empty(const std::string& file) {
  std::error_code error;
  return std::filesystem::is_regular_file(file, error) &&
         std::filesystem::file_size(file, error) == 0;
}

}  // namespace

LogFiles::LogFiles(std::vector<std::string> files, bool is_quiet)
    : files_(std::move(files)),
      next_progress_(std::chrono::steady_clock::now() + kProgressPeriod),
      is_terminal_(!is_quiet && ::isatty(STDERR_FILENO) == 1) {
  for (const std::string& file : files_) {
    std::error_code error;
    const auto size = std::filesystem::file_size(file, error);
    if (!error) bytes_ += size;
  }
  while (index_ + 1 < files_.size() && is_empty(files_[index_])) ++index_;
  if (is_empty(files_[index_])) index_ = 0;  // all are: no log
  reader_ = std::make_unique<LogReader>(files_[index_]);
}

LogFiles::~LogFiles() { clear_progress(); }

const LogEvent* LogFiles::next() {
  for (;;) {
    const LogEvent* const event = reader_->next();
    take_damages();
    if (event != nullptr) {
      if (is_terminal_ && until_progress_-- == 0) show_progress();
      return event;
    }
    std::size_t following = index_ + 1;
    while (following < files_.size() && is_empty(files_[following])) ++following;
    if (following == files_.size()) {
      clear_progress();
      return nullptr;
    }
    bytes_before_ += reader_->position();
    index_ = following;
    reader_ = std::make_unique<LogReader>(files_[index_]);
    taken_ = 0;
  }
}

void LogFiles::take_damages() {
  for (; taken_ < reader_->damages().size(); ++taken_) {
    damages_.push_back({reader_->name(), reader_->damages()[taken_]});
  }
}

void LogFiles::show_progress() {
  until_progress_ = kEventsPerLook;
  const auto now = std::chrono::steady_clock::now();
  if (now < next_progress_ || bytes_ == 0) return;
  next_progress_ = now + kProgressPeriod;
  const auto read = static_cast<double>(bytes_before_ + reader_->position());
  fmt::print(stderr, "\r\x1b[K  {:.0f} % of {:.1f} MB", 100.0 * read / static_cast<double>(bytes_),
             static_cast<double>(bytes_) * 1e-6);
  is_shown_ = true;
}

void LogFiles::clear_progress() noexcept {
  if (is_shown_) std::fputs("\r\x1b[K", stderr);
  is_shown_ = false;
}

}  // namespace faultline
