#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "tools/lcm/log_reader.h"

namespace faultline {

/// A stretch of one of several files that holds no event.
struct FileDamage {
  std::string file;
  LogDamage damage;
};

/// Several files as one log: those of a run whose log was split, in order. On a terminal it shows
/// on stderr how far a long log has been read.
class LogFiles {
 public:
  /// An empty file among others is passed over.
  /// @param is_quiet shows nothing, not even on a terminal.
  /// @throws as LogReader; a file is opened once those before it have been read.
  explicit LogFiles(std::vector<std::string> files, bool is_quiet = false);
  ~LogFiles();
  LogFiles(const LogFiles&) = delete;
  LogFiles& operator=(const LogFiles&) = delete;

  /// As LogReader::next.
  [[nodiscard]] const LogEvent* next();

  /// The file of the event that `next` returned last.
  [[nodiscard]] const std::string& file() const noexcept { return files_[index_]; }
  /// Index of the file of the event that `next` returned last.
  [[nodiscard]] std::size_t file_index() const noexcept { return index_; }
  /// What was passed over in all files read so far.
  [[nodiscard]] const std::vector<FileDamage>& damages() const noexcept { return damages_; }

 private:
  void take_damages();
  void show_progress();
  void clear_progress() noexcept;

  std::vector<std::string> files_;
  std::size_t index_ = 0;
  std::unique_ptr<LogReader> reader_;
  std::vector<FileDamage> damages_;
  std::size_t taken_ = 0;  ///< of the reader's damages
  std::uint64_t bytes_ = 0, bytes_before_ = 0;
  std::uint32_t until_progress_ = 0;
  std::chrono::steady_clock::time_point next_progress_;
  bool is_terminal_ = false, is_shown_ = false;
};

}  // namespace faultline
