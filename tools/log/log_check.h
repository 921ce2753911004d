#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "tools/log/log_files.h"
#include "tools/log/number_ranges.h"

namespace faultline {

/// What a log holds of one channel of a run, by the sequence numbers of its messages.
struct ChannelCheck {
  std::string channel;
  std::uint64_t logged = 0;               ///< different messages
  std::uint64_t repeats = 0;              ///< messages that came again: of RUN as they should
  std::uint64_t differing_repeats = 0;    ///< RUN: under a known number something else
  std::optional<std::int64_t> published;  ///< as the run's last STATS says
  std::vector<NumberRange> missing;
  std::uint64_t beyond = 0;  ///< more than the run says that it published

  /// Nothing is missing from where the log begins to where it ends.
  [[nodiscard]] bool is_complete() const;
};

/// The frames in the FAULTLINE_CAN messages, by their running numbers.
struct FrameCheck {
  std::uint64_t logged = 0;
  std::vector<NumberRange> missing;
  /// Of the missing ones, as the run says itself: its queue was full. Some may be missing at the
  /// end, where no number tells.
  std::optional<std::int64_t> unlogged;
  std::uint64_t malformed = 0;  ///< no bus could have carried them
};

/// What a log holds of one run.
struct RunCheck {
  struct Part {
    std::string part, name;
    bool is_whole = false;  ///< all chunks, and they come to the digest that the run gave
  };

  std::string run_id;                                   ///< empty: no RUN message is there
  std::optional<std::int64_t> first_cycle, last_cycle;  ///< of its samples
  bool begins_late = false;                             ///< no channel has its first message
  bool has_ended = false;                               ///< its final STATS is there
  std::vector<ChannelCheck> channels;
  FrameCheck frames;
  std::vector<Part> parts;
  std::int64_t records_dropped = 0;  ///< diagnoses that the run itself had no room for
  std::int64_t frames_dropped = 0;   ///< lost on the bus: nothing a log could hold

  /// Nothing is missing from where the log begins to where it ends.
  [[nodiscard]] bool has_no_gaps() const;
  /// All that the run published is logged, and it could publish all.
  [[nodiscard]] bool is_complete() const { return !begins_late && has_ended && has_no_gaps(); }
};

/// What a log is worth.
struct LogCheck {
  std::vector<RunCheck> runs;  ///< in order; empty: nothing in it is of ours
  std::vector<FileDamage> damages;
  std::map<std::string, std::uint64_t> other_schema;    ///< by type, "sample_t"
  std::map<std::string, std::uint64_t> undecodable;     ///< likewise: of our type, but damaged
  std::map<std::string, std::uint64_t> other_channels;  ///< messages by channel
  std::uint64_t events = 0;
  /// Events that are missing by the numbers their writer gave them. Where a log was cut on purpose,
  /// too: not a fault of its own where there are sequence numbers.
  std::uint64_t missing_events = 0;

  [[nodiscard]] bool is_complete() const;
};

/// Reads a log through, ours or another's, and past what is damaged in it.
/// @param files of one log, in order: a run's whose log was split.
/// @throws as LogReader.
[[nodiscard]] LogCheck check_log(const std::vector<std::string>& files);

}  // namespace faultline
