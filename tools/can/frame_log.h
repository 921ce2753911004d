#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <stdexcept>
#include <string>
#include <string_view>
#include <unordered_set>

#include "drivers/can/can_frame.h"
#include "drivers/dbc/dbc_database.h"

namespace faultline {

/// A file of frames is not what it claims to be. The message is "file:line:column: found ...,
/// expected ..." (exit code 2).
class FrameLogError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// What reading a log gave.
struct FrameLogCount {
  std::uint64_t frames = 0;
  std::uint64_t problems = 0;  ///< lines or messages that could not be understood
  std::uint64_t missing = 0;   ///< frames of which the log says itself that they are missing
};

/// What reading a log calls.
struct FrameLogReceiver {
  /// The frames in the log's order. `bus` is the name of the frame's bus ("vcan0").
  std::function<void(const CanFrame& frame, std::string_view bus)> on_frame;
  /// "file:line:column: found ..., expected ...": something that was passed over.
  std::function<void(const std::string& text)> on_problem;
  /// What one should know and nobody did wrong: the log of a run that was killed ends in an event.
  std::function<void(const std::string& text)> on_remark = [](const std::string&) {};
  /// Before more of the file is asked for, which on a pipe may take its time.
  std::function<void()> on_pause = [] {};
};

/// Reads a candump log (`-`: from stdin), an LCM log with FAULTLINE_CAN messages, or a CSV of
/// signals (as FrameLogWriter makes them; needs `dbc`): what it is, its first bytes say. What
/// cannot be understood is reported and passed over.
/// @throws FrameLogError it is none of these; a CSV whose head does not fit `dbc`;
/// @throws std::system_error it cannot be read.
FrameLogCount read_frame_log(const std::string& file, const DbcDatabase* dbc,
                             const FrameLogReceiver& receiver);

/// Writes frames to a file. Made by name: .lcm an LCM log, .csv a CSV of signals, anything else a
/// candump log; `-`: a candump log on stdout.
class FrameLogWriter {
 public:
  virtual ~FrameLogWriter() = default;
  /// @throws OutputError, MessageSinkError it could not be written.
  virtual void write(const CanFrame& frame, std::string_view bus) = 0;
  /// Everything is written and closed. @throws as write.
  virtual void close() = 0;
  /// Frames that the format cannot hold (a CSV: those that the DBC does not know).
  [[nodiscard]] virtual std::uint64_t skipped() const noexcept { return 0; }
};

/// Messages of a database; empty: all of them.
using MessageSet = std::unordered_set<const DbcMessage*>;

/// An existing file is replaced; an .lcm that is no LCM log is not. A CSV has columns for the
/// signals of `messages`.
/// @throws OutputError, MessageSinkError `file` cannot be written;
/// @throws std::invalid_argument a .csv without `dbc`.
[[nodiscard]] std::unique_ptr<FrameLogWriter> open_frame_log(const std::string& file,
                                                             const DbcDatabase* dbc = nullptr,
                                                             const MessageSet& messages = {});

}  // namespace faultline
