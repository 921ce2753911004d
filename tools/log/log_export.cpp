#include "tools/log/log_export.h"

#include <algorithm>
#include <cctype>
#include <filesystem>
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
#include "tools/log/table_file.h"

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

/// The messages of a channel on their way to a file.
class ChannelTable {
 public:
  ChannelTable(const MessageType& type, const Survey& survey, std::filesystem::path file,
               LogExport::Format format)
      : table_(type, survey.names, survey.first_utime),
        name_(file.string()),
        file_(format == LogExport::Format::kMat ? open_mat_file(file) : open_csv_file(file)) {}

  /// @return false if the message is in no row.
  bool take(const LogEvent& event) {
    return table_.read(event, [this](std::span<const Cell> cells) {
      file_->add_row(table_.columns(), cells);
      ++rows_;
    });
  }
  LogExportResult::Table commit() {
    file_->commit();
    return {name_, rows_};
  }

 private:
  MessageTable table_;
  std::string name_;
  std::unique_ptr<TableFile> file_;
  std::uint64_t rows_ = 0;
};

/// FAULTLINE_SAMPLE: sample.csv
std::string file_name(const MessageType& type, LogExport::Format format) {
  std::string name(type.channel.substr(type.channel.find('_') + 1));
  std::transform(name.begin(), name.end(), name.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return name + (format == LogExport::Format::kMat ? ".mat" : ".csv");
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
  std::map<std::string, std::unique_ptr<ChannelTable>, std::less<>> tables;
  LogFiles log(request.files);
  while (const LogEvent* event = log.next()) {
    if (!is_chosen(request.channels, event->channel)) continue;
    const MessageType* const type = find_message_type(event->channel);
    const bool is_tabular = type != nullptr && MessageTable::is_tabular(*type);
    if (is_tabular && tables.find(event->channel) == tables.end()) {
      make_folder(request.folder);
      tables[std::string(event->channel)] = std::make_unique<ChannelTable>(
          *type, found, std::filesystem::path(request.folder) / file_name(*type, request.format),
          request.format);
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
