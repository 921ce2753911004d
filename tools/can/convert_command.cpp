#include <cstdio>
#include <filesystem>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include <CLI/App.hpp>
#include <CLI/Validators.hpp>
#include <fmt/format.h>

#include "drivers/dbc/dbc_parser.h"
#include "tools/can/can_command.h"
#include "tools/can/frame_decoder.h"
#include "tools/can/frame_filter.h"
#include "tools/can/frame_log.h"
#include "tools/can/problem_report.h"
#include "tools/cli.h"

namespace faultline {
namespace {

struct ConvertArguments {
  std::string in, out, dbc;
  std::vector<std::string> filters;
};

void require_different_files(const std::string& in, const std::string& out) {
  std::error_code error;
  if (in != "-" && out != "-" && std::filesystem::equivalent(in, out, error)) {
    throw std::invalid_argument(
        fmt::format("{}: found the same file as input and output, expected another", out));
  }
}

/// The DBC's messages that occur in a log: a CSV has columns for these alone.
MessageSet messages_in(const std::string& log, const DbcDatabase& dbc, const FrameFilter& filter) {
  const FrameDecoder decoder(dbc);
  MessageSet messages;
  FrameLogReceiver receiver;
  receiver.on_frame = [&](const CanFrame& frame, std::string_view) {
    const DbcMessage* const message = filter.passes(frame) ? decoder.find_message(frame) : nullptr;
    if (message != nullptr) messages.insert(message);
  };
  receiver.on_problem = [](const std::string&) {};
  read_frame_log(log, &dbc, receiver);
  if (messages.empty()) {
    throw std::invalid_argument(
        fmt::format("{}: found no frame of a message in {}, expected some", log, dbc.source));
  }
  return messages;
}

int convert(const ConvertArguments& arguments) {
  require_different_files(arguments.in, arguments.out);
  std::optional<DbcDatabase> dbc;
  if (!arguments.dbc.empty()) {
    dbc = read_dbc(arguments.dbc);
    report_dbc_errors(*dbc);
  }
  const DbcDatabase* const known = dbc ? &*dbc : nullptr;
  const FrameFilter filter(arguments.filters, known);
  MessageSet messages;
  const bool is_csv = std::filesystem::path(arguments.out).extension() == ".csv";
  if (is_csv && known != nullptr && arguments.in != "-") {
    messages = messages_in(arguments.in, *known, filter);
  }
  const auto writer = open_frame_log(arguments.out, known, messages);
  ProblemReport problems;
  FrameLogReceiver receiver;
  std::uint64_t passed = 0;
  receiver.on_frame = [&](const CanFrame& frame, std::string_view bus) {
    if (!filter.passes(frame)) return;
    writer->write(frame, bus);
    ++passed;
  };
  receiver.on_problem = [&](const std::string& text) { problems.add(text); };
  receiver.on_remark = ProblemReport::remark;
  const FrameLogCount count = read_frame_log(arguments.in, known, receiver);
  writer->close();
  fmt::print(stderr, "{} frames from {} to {}", passed - writer->skipped(), arguments.in,
             arguments.out);
  if (writer->skipped() > 0) fmt::print(stderr, ", {} skipped: not in the DBC", writer->skipped());
  if (count.missing > 0) fmt::print(stderr, ", {} missing from the log", count.missing);
  fmt::print(stderr, "\n");
  return problems.exit_code();
}

}  // namespace

void add_convert_command(CLI::App& parent, int& exit_code) {
  CLI::App* command = parent.add_subcommand(
      "convert", "Convert between candump logs, LCM logs and CSV files of signals");
  auto arguments = std::make_shared<ConvertArguments>();
  command
      ->add_option("IN", arguments->in,
                   "Any of the three; what it is, its first bytes say; -: stdin")
      ->required()
      ->check(CLI::ExistingFile | CLI::IsMember({"-"}));
  command
      ->add_option("OUT", arguments->out,
                   ".lcm an LCM log, .csv signals, else a candump log; -: candump on stdout")
      ->required();
  command->add_option("--dbc", arguments->dbc, "DBC file, for CSV files and names in filters")
      ->check(CLI::ExistingFile);
  add_filter_option(*command, arguments->filters);
  command->footer(
      "A CSV has a row per frame (time_s, bus, message) and a column per signal (Message.Signal); "
      "back from it, bits that no signal describes are zero.\n" +
      std::string(kExitCodesHelp));
  command->callback([arguments, &exit_code] { exit_code = convert(*arguments); });
}

}  // namespace faultline
