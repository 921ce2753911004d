#include "tools/can/frame_log.h"

#include <array>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <map>
#include <optional>
#include <span>
#include <system_error>
#include <utility>
#include <vector>

#include <fcntl.h>
#include <unistd.h>

#include <faultline/can_t.hpp>
#include <faultline/run_t.hpp>
#include <fmt/format.h>
#include <sys/stat.h>

#include "diagnosis/model/digest.h"
#include "drivers/can/candump_log.h"
#include "drivers/can/line_reader.h"
#include "tools/can/signal_csv.h"
#include "tools/cli.h"
#include "tools/lcm/channels.h"
#include "tools/lcm/frame_message.h"
#include "tools/lcm/log_reader.h"
#include "tools/lcm/message_sink.h"

namespace faultline {
namespace {

/// Part of RUN that names the buses, one per line.
constexpr std::string_view kBusesPart = "buses";
constexpr std::size_t kFramesPerBatch = 64;
/// A start without a single frame among this many lines is no candump log.
constexpr std::uint64_t kHopelessLines = 100;

std::string shown(std::string_view line, std::size_t column) {
  constexpr std::size_t kShownBytes = 24;
  if (column > line.size()) return "the end of the line";
  std::string text(line.substr(column - 1, kShownBytes));
  for (char& c : text) {
    if (static_cast<unsigned char>(c) < 0x20 || static_cast<unsigned char>(c) >= 0x7F) c = '?';
  }
  return '"' + text + '"';
}

/// A text file, or (`-`) what comes on stdin, line by line.
class TextFile {
 public:
  explicit TextFile(const std::string& file)
      : source_(file == "-" ? "stdin" : file),
        fd_(file == "-" ? STDIN_FILENO : ::open(file.c_str(), O_RDONLY | O_CLOEXEC)),
        lines_(fd_, kLongestLine) {
    struct stat status {};
    const bool is_open = fd_ >= 0 && ::fstat(fd_, &status) == 0;
    const int error = is_open ? EISDIR : errno;
    if (is_open && !S_ISDIR(status.st_mode)) return;
    close();
    throw std::system_error(error, std::generic_category(), "cannot read " + source_);
  }
  ~TextFile() { close(); }
  TextFile(const TextFile&) = delete;
  TextFile& operator=(const TextFile&) = delete;

  [[nodiscard]] const std::string& source() const noexcept { return source_; }
  [[nodiscard]] std::uint64_t line() const noexcept { return lines_.line_number(); }
  [[nodiscard]] std::string_view peek(std::size_t count) { return lines_.peek(count); }

  /// The next line without its end (LF or CR LF), nothing at the end of the file. Lines beyond any
  /// measure are told and passed over.
  std::optional<std::string_view> next(const FrameLogReceiver& receiver, FrameLogCount& count) {
    for (;;) {
      if (!lines_.has_line()) receiver.on_pause();
      std::string_view line;
      switch (lines_.next(line)) {
        case LineReader::Status::kLine:
          if (line.ends_with('\r')) line.remove_suffix(1);
          return line;
        case LineReader::Status::kTooLong:
          ++count.problems;
          receiver.on_problem(
              fmt::format("{}:{}:{}: found a line of more than {} bytes, expected "
                          "its end",
                          source_, this->line(), kLongestLine + 1, kLongestLine));
          break;
        case LineReader::Status::kFailed:
          throw std::system_error(lines_.error(), std::generic_category(),
                                  "cannot read " + source_);
        case LineReader::Status::kEnd:
          return std::nullopt;
      }
    }
  }

 private:
  /// A row of a CSV has a cell for each signal of the DBC; a megabyte is enough for any.
  static constexpr std::size_t kLongestLine = std::size_t{1} << 20;

  void close() const noexcept {
    if (fd_ > STDIN_FILENO) ::close(fd_);
  }

  std::string source_;
  int fd_;
  LineReader lines_;
};

FrameLogCount read_candump(TextFile& file, const FrameLogReceiver& receiver) {
  FrameLogCount count;
  CandumpRecord record;
  CandumpProblem problem;
  while (const auto line = file.next(receiver, count)) {
    const CandumpStatus status = parse_candump_line(*line, record, problem);
    if (status == CandumpStatus::kBlank) continue;
    if (status == CandumpStatus::kRecord) {
      ++count.frames;
      receiver.on_frame(record.frame, record.interface_name);
      continue;
    }
    const std::string text =
        fmt::format("{}:{}:{}: found {}, expected {}", file.source(), file.line(), problem.column,
                    shown(*line, problem.column), problem.expected);
    ++count.problems;
    if (count.frames == 0 && count.problems >= kHopelessLines) {
      throw FrameLogError(text + fmt::format("; the first {} lines hold no frame", count.problems));
    }
    receiver.on_problem(text);
  }
  return count;
}

FrameLogCount read_csv(TextFile& file, const DbcDatabase& dbc, const FrameLogReceiver& receiver) {
  FrameLogCount count;
  const auto head = file.next(receiver, count);
  if (!head) throw FrameLogError(file.source() + ": found no line, expected the head of a CSV");
  SignalCsvReader csv(*head, file.source(), dbc);
  CanFrame frame;
  std::string_view bus;
  while (const auto line = file.next(receiver, count)) {
    if (line->empty()) continue;
    const std::string problem = csv.read(*line, file.line(), frame, bus);
    if (problem.empty()) {
      ++count.frames;
      receiver.on_frame(frame, bus);
    } else {
      ++count.problems;
      receiver.on_problem(file.source() + ":" + problem);
    }
  }
  return count;
}

std::vector<std::string> split_lines(std::string_view text) {
  std::vector<std::string> lines;
  while (!text.empty()) {
    const std::size_t end = std::min(text.find('\n'), text.size());
    lines.emplace_back(text.substr(0, end));
    text.remove_prefix(std::min(end + 1, text.size()));
  }
  return lines;
}

FrameLogCount read_lcm(const std::string& file, const FrameLogReceiver& receiver) {
  LogReader log(file);
  FrameLogCount count;
  std::vector<std::string> names;
  std::int64_t next_frame = 0;
  std::size_t told_damages = 0;
  run_t run;
  FrameBatch batch;
  const auto tell = [&](const std::string& text) {
    ++count.problems;
    receiver.on_problem(text);
  };
  const auto tell_damages = [&] {
    for (; told_damages < log.damages().size(); ++told_damages) {
      const LogDamage& damage = log.damages()[told_damages];
      if (damage.is_end) {
        receiver.on_remark(describe(log.name(), damage));
      } else {
        tell(describe(log.name(), damage));
      }
    }
  };
  while (const LogEvent* event = log.next()) {
    tell_damages();
    if (event->channel == kRunChannel && decode_message(event->data, layout::kRun, run) &&
        run.part == kBusesPart && run.byte_count > 0) {
      names = split_lines({reinterpret_cast<const char*>(run.data.data()), run.data.size()});
    }
    if (event->channel != kCanChannel) continue;
    if (!decode_frames(event->data, batch)) {
      tell(fmt::format("{}: event {}: found a {} message of another type, expected can_t", file,
                       event->number, kCanChannel));
      continue;
    }
    if (batch.first_frame > next_frame) {
      count.missing += static_cast<std::uint64_t>(batch.first_frame - next_frame);
      receiver.on_problem(fmt::format("{}: event {}: frames {} to {} are missing", file,
                                      event->number, next_frame, batch.first_frame - 1));
    }
    next_frame = batch.first_frame + batch.frame_count;
    if (batch.malformed > 0) {
      count.problems += batch.malformed;
      receiver.on_problem(fmt::format("{}: event {}: found {} of {} frames that no bus can carry",
                                      file, event->number, batch.malformed, batch.frame_count));
    }
    const std::string bus =
        batch.bus < names.size() ? names[batch.bus] : fmt::format("can{}", batch.bus);
    for (const CanFrame& frame : batch.frames) {
      ++count.frames;
      receiver.on_frame(frame, bus);
    }
  }
  tell_damages();
  return count;
}

class CandumpWriter final : public FrameLogWriter {
 public:
  explicit CandumpWriter(const std::string& file)
      : name_(file == "-" ? "stdout" : file),
        file_(file == "-" ? stdout : std::fopen(file.c_str(), "w")) {
    if (file_ == nullptr) fail();
  }
  ~CandumpWriter() override {
    if (file_ != nullptr && file_ != stdout) std::fclose(file_);
  }
  CandumpWriter(const CandumpWriter&) = delete;
  CandumpWriter& operator=(const CandumpWriter&) = delete;

  void write(const CanFrame& frame, std::string_view bus) override {
    const std::size_t size = format_candump_line(frame, bus, line_);
    if (size == 0) {
      throw FrameLogError(
          fmt::format("bus \"{}\": expected a name that candump can write: 1 to 15 "
                      "characters without blanks",
                      bus));
    }
    if (std::fwrite(line_.data(), 1, size, file_) != size) fail();
  }
  void close() override {
    std::FILE* const file = std::exchange(file_, nullptr);
    if ((file == stdout ? std::fflush(file) : std::fclose(file)) != 0) fail();
  }

 private:
  [[noreturn]] void fail() const {
    throw OutputError(fmt::format("cannot write {}: {}", name_, std::strerror(errno)));
  }
  std::string name_;
  std::FILE* file_;
  std::array<char, kLongestCandumpLine> line_{};
};

/// FAULTLINE_CAN in batches of one bus, and a RUN part with the buses' names.
class LcmWriter final : public FrameLogWriter {
 public:
  explicit LcmWriter(const std::string& file) : log_(open_log(file)) {}

  void write(const CanFrame& frame, std::string_view bus) override {
    const std::int32_t index = index_of(bus, frame.stamp);
    if (batch_.frames.size() == kFramesPerBatch ||
        (index != batch_.bus && !batch_.frames.empty())) {
      flush();
    }
    batch_.bus = index;
    batch_.frames.push_back(to_message(frame));
    batch_.utime = to_utime(frame.stamp);
  }
  void close() override {
    flush();
    log_->close();
  }

 private:
  std::int32_t index_of(std::string_view bus, Timestamp stamp) {
    const auto found = indices_.find(bus);
    if (found != indices_.end()) return found->second;
    const auto index = static_cast<std::int32_t>(indices_.size());
    indices_.emplace(bus, index);
    names_ += std::string(bus) + "\n";
    flush();
    run_t run;
    run.utime = to_utime(stamp);
    run.sequence = run_sequence_++;
    run.run_id = "convert";
    run.part = kBusesPart;
    run.name = "buses";
    run.digest = text_digest(names_);
    run.chunk = 0;
    run.chunk_count = 1;
    run.data.assign(names_.begin(), names_.end());
    run.byte_count = static_cast<std::int32_t>(run.data.size());
    publish(kRunChannel, run);
    return index;
  }

  void flush() {
    if (batch_.frames.empty()) return;
    batch_.sequence = can_sequence_++;
    batch_.first_frame = frame_count_;
    batch_.frame_count = static_cast<std::int32_t>(batch_.frames.size());
    frame_count_ += batch_.frame_count;
    publish(kCanChannel, batch_);
    batch_.frames.clear();
  }

  template <class Message>
  void publish(const char* channel, const Message& message) {
    buffer_.resize(static_cast<std::size_t>(message.getEncodedSize()));
    message.encode(buffer_.data(), 0, static_cast<int>(buffer_.size()));
    log_->publish(channel, message.utime, buffer_);
  }

  std::unique_ptr<MessageSink> log_;
  std::map<std::string, std::int32_t, std::less<>> indices_;  ///< of the buses, by name
  std::string names_;                                         ///< one per line
  can_t batch_{};
  std::int64_t frame_count_ = 0, can_sequence_ = 0, run_sequence_ = 0;
  std::vector<std::uint8_t> buffer_;
};

}  // namespace

FrameLogCount read_frame_log(const std::string& file, const DbcDatabase* dbc,
                             const FrameLogReceiver& receiver) {
  TextFile text(file);
  const std::string_view head = text.peek(2 * kLogMagic.size());
  if (head.starts_with(kLogMagic)) {
    if (file == "-") throw FrameLogError("stdin: found an LCM log, expected it as a file");
    return read_lcm(file, receiver);
  }
  if (head.find('\0') != std::string_view::npos) {
    throw FrameLogError(
        fmt::format("{}: found binary data, expected a candump log, an LCM log or a CSV of signals",
                    text.source()));
  }
  if (!is_signal_csv(head)) return read_candump(text, receiver);
  if (dbc == nullptr) {
    throw FrameLogError(
        fmt::format("{}:1:1: found a CSV of signals, expected --dbc beside it", text.source()));
  }
  return read_csv(text, *dbc, receiver);
}

std::unique_ptr<FrameLogWriter> open_frame_log(const std::string& file, const DbcDatabase* dbc,
                                               const MessageSet& messages) {
  const std::string extension = std::filesystem::path(file).extension().string();
  if (extension == ".lcm") return std::make_unique<LcmWriter>(file);
  if (extension != ".csv") return std::make_unique<CandumpWriter>(file);
  if (dbc == nullptr) {
    throw std::invalid_argument(fmt::format("{}: a CSV of signals needs --dbc", file));
  }
  return open_signal_csv(file, *dbc, messages);
}

}  // namespace faultline
