#include "tools/can/signal_csv.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <limits>
#include <map>
#include <optional>
#include <unordered_map>
#include <vector>

#include <fmt/format.h>

#include "tools/can/frame_decoder.h"
#include "tools/can/frame_text.h"
#include "tools/cli.h"

namespace faultline {
namespace {

constexpr std::array<std::string_view, 3> kFirstColumns{"time_s", "bus", "message"};

void append(fmt::memory_buffer& out, std::string_view text) {
  out.append(text.data(), text.data() + text.size());
}

/// RFC 4180: quoted where it holds a comma, a quote or a line end.
void append_cell(fmt::memory_buffer& out, std::string_view text) {
  if (text.find_first_of(",\"\r\n") == std::string_view::npos) {
    append(out, text);
    return;
  }
  out.push_back('"');
  for (const char c : text) {
    if (c == '"') out.push_back('"');
    out.push_back(c);
  }
  out.push_back('"');
}

/// The cells of a row, with the column (from 1, in bytes) at which each begins.
struct Cell {
  std::string text;
  std::size_t column = 1;
};

std::vector<Cell> split_row(std::string_view row) {
  std::vector<Cell> cells;
  std::size_t at = 0;
  for (;;) {
    Cell cell{{}, at + 1};
    if (at < row.size() && row[at] == '"') {
      for (++at; at < row.size(); ++at) {
        if (row[at] == '"') {
          if (at + 1 >= row.size() || row[at + 1] != '"') break;
          ++at;
        }
        cell.text += row[at];
      }
      at = std::min(row.find(',', at), row.size());
    } else {
      const std::size_t end = std::min(row.find(',', at), row.size());
      cell.text = row.substr(at, end - at);
      at = end;
    }
    cells.push_back(std::move(cell));
    if (at >= row.size()) return cells;
    ++at;
  }
}

template <class T>
std::optional<T> to_number(std::string_view text) {
  T value{};
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || end != text.data() + text.size()) return std::nullopt;
  return value;
}

/// "1436509052.249713", up to nine digits of a fraction, without going through a double.
std::optional<Timestamp> to_time(std::string_view text) {
  constexpr std::size_t kNanosecondDigits = 9;
  constexpr std::int64_t kMostSeconds = 9'223'372'035;  // whose nanoseconds a Timestamp holds
  const std::size_t dot = std::min(text.find('.'), text.size());
  const auto seconds = to_number<std::int64_t>(text.substr(0, dot));
  std::string fraction(text.substr(std::min(dot + 1, text.size())));
  if (!seconds || *seconds < 0 || *seconds > kMostSeconds || fraction.size() > kNanosecondDigits)
    return std::nullopt;
  fraction.resize(kNanosecondDigits, '0');
  const auto nanoseconds = to_number<std::uint32_t>(fraction);
  if (!nanoseconds) return std::nullopt;
  return Timestamp(std::chrono::seconds(*seconds) + std::chrono::nanoseconds(*nanoseconds));
}

class SignalCsvWriter final : public FrameLogWriter {
 public:
  SignalCsvWriter(const std::string& file, const DbcDatabase& dbc, const MessageSet& messages)
      : name_(file), decoder_(dbc), file_(std::fopen(file.c_str(), "w")) {
    if (file_ == nullptr) fail();
    append(buffer_, fmt::format("{}", fmt::join(kFirstColumns, ",")));
    for (const DbcMessage& message : dbc.messages) {
      if (!messages.empty() && !messages.contains(&message)) continue;
      first_column_[&message] = column_count_;
      column_count_ += message.signals.size();
      for (const DbcSignal& signal : message.signals) {
        buffer_.push_back(',');
        append_cell(buffer_, message.name + "." + signal.name);
      }
    }
    buffer_.push_back('\n');
  }
  ~SignalCsvWriter() override {
    if (file_ != nullptr) std::fclose(file_);
  }
  SignalCsvWriter(const SignalCsvWriter&) = delete;
  SignalCsvWriter& operator=(const SignalCsvWriter&) = delete;

  void write(const CanFrame& frame, std::string_view bus) override {
    const DecodedFrame decoded = decoder_.decode(frame);
    const auto first_column = first_column_.find(decoded.message);
    if (first_column == first_column_.end() || frame.is_remote) {
      ++skipped_;
      return;
    }
    append_time(buffer_, frame.stamp);
    buffer_.push_back(',');
    append_cell(buffer_, bus);
    buffer_.push_back(',');
    append_cell(buffer_, decoded.message->name);
    append_commas(first_column->second);
    for (std::size_t i = 0; i < decoded.presence.size(); ++i) {
      buffer_.push_back(',');
      if (decoded.presence[i] == SignalPresence::kPresent) {
        append_value(buffer_, frame, decoded, i);
      }
    }
    append_commas(column_count_ - first_column->second - decoded.presence.size());
    buffer_.push_back('\n');
    if (buffer_.size() > kFlushBytes) flush();
  }

  void close() override {
    flush();
    const bool is_closed = std::fclose(file_) == 0;
    file_ = nullptr;
    if (!is_closed) fail();
  }

  [[nodiscard]] std::uint64_t skipped() const noexcept override { return skipped_; }

 private:
  static constexpr std::size_t kFlushBytes = std::size_t{1} << 16;

  void append_commas(std::size_t count) {
    for (std::size_t i = 0; i < count; ++i) buffer_.push_back(',');
  }
  void flush() {
    if (std::fwrite(buffer_.data(), 1, buffer_.size(), file_) != buffer_.size()) fail();
    buffer_.clear();
  }
  [[noreturn]] void fail() const {
    throw OutputError(fmt::format("cannot write {}: {}", name_, std::strerror(errno)));
  }

  std::string name_;
  FrameDecoder decoder_;
  std::FILE* file_;
  /// Where the message's signals begin among the signals' columns.
  std::unordered_map<const DbcMessage*, std::size_t> first_column_;
  std::size_t column_count_ = 0;
  fmt::memory_buffer buffer_;
  std::uint64_t skipped_ = 0;
};

}  // namespace

bool is_signal_csv(std::string_view head) noexcept {
  return head.starts_with(kFirstColumns[0]) &&
         head.substr(kFirstColumns[0].size()).starts_with(',');
}

std::unique_ptr<FrameLogWriter> open_signal_csv(const std::string& file, const DbcDatabase& dbc,
                                                const MessageSet& messages) {
  return std::make_unique<SignalCsvWriter>(file, dbc, messages);
}

struct SignalCsvReader::State {
  struct Column {
    const DbcMessage* message = nullptr;
    std::size_t signal = 0;
  };

  explicit State(const DbcDatabase& dbc) : decoder(dbc) {
    for (const DbcMessage& message : dbc.messages) messages.try_emplace(message.name, &message);
  }

  FrameDecoder decoder;
  std::unordered_map<std::string_view, const DbcMessage*> messages;  ///< the first of each name
  std::vector<Column> columns;                                       ///< behind the first three
  std::vector<double> values;
  std::vector<Cell> cells;
};

SignalCsvReader::SignalCsvReader(std::string_view head, const std::string& source,
                                 const DbcDatabase& dbc)
    : state_(std::make_unique<State>(dbc)) {
  const std::vector<Cell> cells = split_row(head);
  const auto fail = [&](std::size_t column, const std::string& text) {
    throw FrameLogError(fmt::format("{}:1:{}: {}", source, column, text));
  };
  std::unordered_map<std::string, State::Column> signals;
  for (const DbcMessage& message : dbc.messages) {
    for (std::size_t i = 0; i < message.signals.size(); ++i) {
      signals.try_emplace(message.name + "." + message.signals[i].name, State::Column{&message, i});
    }
  }
  for (std::size_t i = 0; i < std::max(cells.size(), kFirstColumns.size()); ++i) {
    const bool is_signal = i >= kFirstColumns.size();
    const std::string found = i < cells.size() ? cells[i].text : "the end of the line";
    const std::size_t column = i < cells.size() ? cells[i].column : head.size() + 1;
    if (!is_signal) {
      if (found != kFirstColumns[i]) {
        fail(column, fmt::format("found \"{}\", expected \"{}\"", found, kFirstColumns[i]));
      }
      continue;
    }
    const auto signal = signals.find(found);
    if (signal == signals.end()) {
      fail(column, fmt::format("found column \"{}\", expected a signal of {} as Message.Signal",
                               found, dbc.source));
    }
    state_->columns.push_back(signal->second);
  }
}

SignalCsvReader::~SignalCsvReader() = default;

std::string SignalCsvReader::read(std::string_view row, std::uint64_t line, CanFrame& frame,
                                  std::string_view& bus) {
  State& state = *state_;
  state.cells = split_row(row);
  const std::vector<Cell>& cells = state.cells;
  const auto problem = [&](std::size_t column, const std::string& text) {
    return fmt::format("{}:{}: {}", line, column, text);
  };
  const std::size_t expected = kFirstColumns.size() + state.columns.size();
  if (cells.size() != expected) {
    return problem(1, fmt::format("found {} cells, expected {}", cells.size(), expected));
  }
  frame = {};
  const auto time = to_time(cells[0].text);
  if (!time) {
    return problem(cells[0].column, fmt::format("found \"{}\", expected a time such as "
                                                "1436509052.249713",
                                                cells[0].text));
  }
  frame.stamp = *time;
  bus = cells[1].text;
  const auto named = state.messages.find(cells[2].text);
  if (named == state.messages.end()) {
    return problem(cells[2].column,
                   fmt::format("found message \"{}\", expected one of the DBC", cells[2].text));
  }
  const DbcMessage& message = *named->second;
  state.values.assign(message.signals.size(), std::numeric_limits<double>::quiet_NaN());
  for (std::size_t i = 0; i < state.columns.size(); ++i) {
    const Cell& cell = cells[kFirstColumns.size() + i];
    if (cell.text.empty()) continue;
    const State::Column& column = state.columns[i];
    const auto value = to_number<double>(cell.text);
    if (!value || !std::isfinite(*value)) {
      return problem(cell.column, fmt::format("found \"{}\", expected a number", cell.text));
    }
    if (column.message != &message) {
      return problem(cell.column, fmt::format("found a value of {}, expected none in a row of {}",
                                              column.message->name, message.name));
    }
    state.values[column.signal] = *value;
  }
  if (message.length > kMaxPayload) {
    return problem(cells[2].column, fmt::format("message {} has {} bytes, expected up to {}",
                                                message.name, message.length, kMaxPayload));
  }
  frame.id = message.id;
  frame.is_extended = message.is_extended;
  frame.is_fd = message.length > kMaxClassicPayload;
  frame.length = static_cast<std::uint8_t>(message.length);
  state.decoder.codec_of(message).encode(state.values, {frame.data.data(), frame.length});
  return {};
}

}  // namespace faultline
