#include "tools/log/log_export.h"

#include <algorithm>
#include <cctype>
#include <filesystem>
#include <iterator>
#include <memory>
#include <optional>
#include <set>
#include <stdexcept>
#include <system_error>
#include <utility>

#include <faultline/estimate_t.hpp>
#include <faultline/run_t.hpp>
#include <fmt/format.h>
#include <fmt/ranges.h>

#include "tools/cli.h"
#include "tools/lcm/channels.h"
#include "tools/log/channel_choice.h"
#include "tools/log/log_files.h"
#include "tools/log/message_table.h"
#include "tools/log/replaced_file.h"

namespace faultline {
namespace {

/// What must be known of a log before its tables are begun.
struct Survey {
  ChannelNames names;
  std::int64_t first_utime = 0;
};

Survey survey(const LogExport& request) {
  LogFiles log(request.files);
  RunParts parts;
  std::vector<std::string> estimated;
  std::set<std::string> channels;
  std::optional<std::int64_t> first_utime;
  while (const LogEvent* event = log.next()) {
    if (!first_utime) first_utime = event->utime;
    channels.emplace(event->channel);
    run_t run;
    estimate_t estimate;
    if (event->channel == kRunChannel && decode_message(event->data, layout::kRun, run)) {
      parts.take(run);
    } else if (event->channel == kEstimateChannel &&
               decode_message(event->data, layout::kEstimate, estimate)) {
      for (std::string& fault : estimate.fault) {
        if (std::find(estimated.begin(), estimated.end(), fault) == estimated.end()) {
          estimated.push_back(std::move(fault));
        }
      }
    }
  }
  require_found(request.channels, {channels.begin(), channels.end()},
                fmt::format("{}", fmt::join(request.files, ", ")));
  Survey survey{names_of(parts), first_utime.value_or(0)};
  // Without a bank, those that occur.
  for (const std::string& fault : estimated) {
    auto& faults = survey.names.faults;
    if (std::find(faults.begin(), faults.end(), fault) == faults.end()) faults.push_back(fault);
  }
  return survey;
}

void append(fmt::memory_buffer& out, std::string_view text) {
  out.append(text.data(), text.data() + text.size());
}

/// RFC 4180: quoted where it holds a comma, a quote or a line end. Doubles: the shortest text that
/// reads back to the bit.
void append_cell(fmt::memory_buffer& out, const Cell& cell) {
  if (const auto* whole = std::get_if<std::int64_t>(&cell)) {
    fmt::format_to(std::back_inserter(out), "{}", *whole);
  } else if (const auto* real = std::get_if<double>(&cell)) {
    fmt::format_to(std::back_inserter(out), "{}", *real);
  } else if (const auto* text = std::get_if<std::string>(&cell)) {
    if (text->find_first_of(",\"\r\n") == std::string::npos) return append(out, *text);
    out.push_back('"');
    for (const char c : *text) {
      if (c == '"') out.push_back('"');
      out.push_back(c);
    }
    out.push_back('"');
  }
}

class CsvTable {
 public:
  CsvTable(const MessageType& type, const Survey& survey, std::filesystem::path file)
      : table_(type, survey.names, survey.first_utime), name_(file.string()), file_(name_) {}

  /// @return false if the message is in no row.
  bool take(const LogEvent& event) {
    const bool is_read = table_.read(event, [this](std::span<const Cell> cells) {
      if (rows_++ == 0) write_columns();
      write_row(cells);
    });
    flush(kLarge);
    return is_read;
  }
  LogExportResult::Table commit() {
    flush(0);
    file_.commit();
    return {name_, rows_};
  }

 private:
  static constexpr std::size_t kLarge = std::size_t{1} << 16;

  void write_columns() {
    for (std::size_t i = 0; i < table_.columns().size(); ++i) {
      if (i > 0) buffer_.push_back(',');
      append_cell(buffer_, Cell(table_.columns()[i]));
    }
    append(buffer_, "\n");
  }
  void write_row(std::span<const Cell> cells) {
    for (std::size_t i = 0; i < cells.size(); ++i) {
      if (i > 0) buffer_.push_back(',');
      append_cell(buffer_, cells[i]);
    }
    append(buffer_, "\n");
  }
  void flush(std::size_t from) {
    if (buffer_.size() <= from) return;
    file_.write(buffer_.data(), buffer_.size());
    buffer_.clear();
  }

  MessageTable table_;
  std::string name_;
  ReplacedFile file_;
  fmt::memory_buffer buffer_;
  std::uint64_t rows_ = 0;
};

/// FAULTLINE_SAMPLE: sample.csv
std::string file_name(const MessageType& type) {
  std::string name(type.channel.substr(type.channel.find('_') + 1));
  std::transform(name.begin(), name.end(), name.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return name + ".csv";
}

void make_folder(const std::string& folder) {
  std::error_code error;
  if (std::filesystem::exists(folder, error) && !std::filesystem::is_directory(folder, error)) {
    throw std::invalid_argument(fmt::format("{}: found a file, expected a folder or none", folder));
  }
  std::filesystem::create_directories(folder, error);
  if (error) throw OutputError(fmt::format("cannot make folder {}: {}", folder, error.message()));
}

}  // namespace

LogExportResult export_log(const LogExport& request) {
  const Survey found = survey(request);
  LogExportResult result;
  std::map<std::string, std::unique_ptr<CsvTable>, std::less<>> tables;
  LogFiles log(request.files);
  while (const LogEvent* event = log.next()) {
    if (!is_chosen(request.channels, event->channel)) continue;
    const MessageType* const type = find_message_type(event->channel);
    const bool is_tabular = type != nullptr && MessageTable::is_tabular(*type);
    if (is_tabular && tables.find(event->channel) == tables.end()) {
      make_folder(request.folder);
      tables[std::string(event->channel)] = std::make_unique<CsvTable>(
          *type, found, std::filesystem::path(request.folder) / file_name(*type));
    }
    if (!is_tabular || !tables.find(event->channel)->second->take(*event)) {
      ++result.skipped[std::string(event->channel)];
    }
  }
  if (tables.empty()) {
    throw std::invalid_argument(fmt::format("{}: found no messages of a run, expected some",
                                            fmt::join(request.files, ", ")));
  }
  for (const auto& [channel, table] : tables) result.tables.push_back(table->commit());
  result.damages = log.damages().size();
  return result;
}

}  // namespace faultline
