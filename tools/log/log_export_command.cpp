#include <map>
#include <memory>
#include <string>

#include <CLI/App.hpp>
#include <CLI/Validators.hpp>
#include <fmt/format.h>

#include "tools/cli.h"
#include "tools/lcm/channels.h"
#include "tools/log/log_command.h"
#include "tools/log/log_export.h"

namespace faultline {
namespace {

int export_tables(const LogExport& request) {
  const LogExportResult result = export_log(request);
  for (const LogExportResult::Table& table : result.tables) {
    fmt::print(stderr, "{}: {} rows\n", table.file, table.rows);
  }
  for (const auto& [channel, count] : result.skipped) {
    if (channel == kRunChannel) continue;  // it carries files, and is no table
    fmt::print(stderr, "{}: {} messages are in no table: of another type, or damaged\n", channel,
               count);
  }
  if (result.damages > 0) {
    fmt::print(stderr, "{} damaged places in the log (see log check)\n", result.damages);
  }
  return kExitYes;
}

}  // namespace

void add_log_export_command(CLI::App& parent, int& exit_code) {
  CLI::App* command = parent.add_subcommand(
      "export", "Write a log's messages as tables: a CSV or MAT file per channel");
  auto request = std::make_shared<LogExport>();
  command->add_option("FILE", request->files, "LCM log; several: one log that was split, in order")
      ->required()
      ->check(CLI::ExistingFile);
  command
      ->add_option(
          "-o,--output", request->folder,
          "Folder for sample.csv, can.csv, .. (or .mat); made if it is not there. Files of these "
          "names are replaced")
      ->required();
  command
      ->add_option("--channel", request->channels,
                   "Only these channels: SAMPLE, FAULTLINE_CAN, ..; default: all")
      ->type_name("NAME");
  using Format = LogExport::Format;
  const std::map<std::string, Format> formats{{"csv", Format::kCsv}, {"mat", Format::kMat}};
  command
      ->add_option("--format", request->format,
                   "csv (default); mat: MATLAB, a variable per column (memory: the whole table)")
      ->type_name("csv|mat")
      ->transform(CLI::CheckedTransformer(formats).description(""));
  command->footer(
      "A row per message, in can.csv per frame. t_s counts from the log's first event. Columns "
      "have "
      "the names of the bank's inputs, outputs and residuals and of the plant's states; numbers "
      "read "
      "back to the bit.\n" +
      std::string(kExitCodesHelp));
  command->callback([request, &exit_code] { exit_code = export_tables(*request); });
}

}  // namespace faultline
