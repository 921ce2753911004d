#include <memory>
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
#include "tools/can/frame_text.h"
#include "tools/can/output.h"
#include "tools/can/problem_report.h"
#include "tools/cli.h"

namespace faultline {
namespace {

struct DecodeArguments {
  std::string log = "-", dbc;
  std::vector<std::string> filters;
};

int decode(const DecodeArguments& arguments) {
  const DbcDatabase dbc = read_dbc(arguments.dbc);
  report_dbc_errors(dbc);
  const FrameFilter filter(arguments.filters, &dbc);
  FrameDecoder decoder(dbc);
  Output output;
  ProblemReport problems;
  FrameLogReceiver receiver;
  receiver.on_frame = [&](const CanFrame& frame, std::string_view bus) {
    if (!filter.passes(frame)) return;
    append_json(output.buffer(), frame, bus, decoder.decode(frame));
    output.flush_if_large();
  };
  receiver.on_problem = [&](const std::string& text) { problems.add(text); };
  receiver.on_remark = ProblemReport::remark;
  receiver.on_pause = [&] { output.flush(); };
  read_frame_log(arguments.log, &dbc, receiver);
  output.flush();
  return problems.exit_code();
}

}  // namespace

void add_decode_command(CLI::App& parent, int& exit_code) {
  CLI::App* command = parent.add_subcommand(
      "decode", "Decode a log of frames by a DBC: one JSON object per frame on stdout");
  auto arguments = std::make_shared<DecodeArguments>();
  command
      ->add_option("LOG", arguments->log,
                   "candump log, LCM log or CSV of signals; default: a candump log on stdin")
      ->check(CLI::ExistingFile | CLI::IsMember({"-"}));
  command->add_option("--dbc", arguments->dbc, "DBC file")->required()->check(CLI::ExistingFile);
  add_filter_option(*command, arguments->filters);
  command->footer(
      "Each line: {\"time\": s, \"bus\": \"vcan0\", \"id\": 272, \"extended\": false, \"message\": "
      "\"Sensors1\", \"signals\": {\"y1\": 1.5}}; message is null where the DBC has none, "
      "beyond_payload lists signals that a short payload lacks.\n"
      "Lines that are no frame are told on stderr and passed over; the exit code is then 2.\n" +
      std::string(kExitCodesHelp));
  command->callback([arguments, &exit_code] { exit_code = decode(*arguments); });
}

}  // namespace faultline
