#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

namespace faultline {

struct LogExport {
  enum class Format { kCsv, kMat };

  std::vector<std::string> files;     ///< of one log, in order; no stdin: they are read twice
  std::string folder;                 ///< made if it is not there
  std::vector<std::string> channels;  ///< none: all of a run's
  Format format = Format::kCsv;
};

struct LogExportResult {
  struct Table {
    std::string file;
    std::uint64_t rows = 0;
  };
  std::vector<Table> tables;
  std::map<std::string, std::uint64_t> skipped;  ///< messages that are in no table, by channel
  std::uint64_t damages = 0;
};

/// Writes the messages of a run as tables, a file per channel (table_file.h). What the values are
/// called, the bank in the log says (of several runs the last one's); times begin with the log's
/// first event.
/// @throws std::invalid_argument nothing to export, a channel is not in the log, `folder` is none;
///   OutputError; as LogReader.
LogExportResult export_log(const LogExport& request);

}  // namespace faultline
