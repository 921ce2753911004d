#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>

#include "tools/lcm/message_sink.h"

namespace faultline {

/// When a log goes on in another file.
struct LogSplit {
  std::uint64_t bytes = 0;   ///< before a file gets longer; 0: never
  std::int64_t time_us = 0;  ///< once its messages span so much; 0: never
  std::size_t keep = 0;      ///< the newest so many files are kept, older ones deleted; 0: all are

  [[nodiscard]] bool is_wanted() const noexcept { return bytes > 0 || time_us > 0; }
};

/// File `number` (from 1) of a log that is split: run.lcm is run-0001.lcm, run-0002.lcm, ..
[[nodiscard]] std::filesystem::path split_log_file(const std::filesystem::path& file,
                                                   std::uint64_t number);

/// All of them, for people: run-*.lcm
[[nodiscard]] std::filesystem::path split_log_pattern(const std::filesystem::path& file);

/// A log in several files, each of which can be read alone: the RUN messages are repeated at its
/// head, as they are. Together they are the log of one run. All files of an earlier log of that
/// name are deleted.
/// @throws MessageSinkError it cannot be written; std::invalid_argument a file of such a name is no
///   LCM log.
[[nodiscard]] std::unique_ptr<MessageSink> open_rotating_log(const std::filesystem::path& file,
                                                             const LogSplit& split);

}  // namespace faultline
