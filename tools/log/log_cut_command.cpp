#include <cmath>
#include <memory>
#include <stdexcept>
#include <string>

#include <CLI/App.hpp>
#include <CLI/Validators.hpp>
#include <fmt/format.h>

#include "tools/cli.h"
#include "tools/log/log_command.h"
#include "tools/log/log_cut.h"

namespace faultline {
namespace {

struct CutArguments {
  std::string log, out;
  LogCut cut;
};

int cut_file(const CutArguments& arguments) {
  const LogCut& cut = arguments.cut;
  for (const auto& time_s : {cut.from_s, cut.to_s}) {
    if (time_s && !std::isfinite(*time_s)) {
      throw std::invalid_argument(
          fmt::format("log cut: found a time of {} s, expected a finite one", *time_s));
    }
  }
  if ((cut.from_s && cut.to_s && *cut.from_s >= *cut.to_s) ||
      (cut.from_cycle && cut.to_cycle && *cut.from_cycle >= *cut.to_cycle)) {
    throw std::invalid_argument(
        "log cut: found an end that is not behind the beginning, expected "
        "--to behind --from");
  }
  const LogCutResult result = cut_log(arguments.log, arguments.out, cut);
  fmt::print(stderr, "{} events, {} bytes from {} to {}{}\n", result.events, result.bytes,
             arguments.log, arguments.out,
             result.damages > 0
                 ? fmt::format("; {} damaged places in the log (see log check)", result.damages)
                 : std::string());
  return kExitYes;
}

}  // namespace

void add_log_cut_command(CLI::App& parent, int& exit_code) {
  CLI::App* command = parent.add_subcommand(
      "cut", "Copy a part of a log, by time, cycles or channels, to a log that stands alone");
  auto arguments = std::make_shared<CutArguments>();
  LogCut& cut = arguments->cut;
  command->add_option("LOG", arguments->log, "LCM log")->required()->check(CLI::ExistingFile);
  command->add_option("-o,--output", arguments->out, "Log to write; an existing log is replaced")
      ->required();
  auto* from = command->add_option("--from", cut.from_s,
                                   "From here, in seconds since the log's first event; default: "
                                   "from the beginning");
  auto* to = command->add_option("--to", cut.to_s, "To here, not included; default: to the end");
  command->add_option("--from-cycle", cut.from_cycle, "From this cycle of the bench")
      ->excludes(from)
      ->excludes(to);
  command->add_option("--to-cycle", cut.to_cycle, "To this cycle, not included")
      ->excludes(from)
      ->excludes(to);
  command
      ->add_option("--channel", cut.channels,
                   "Only these channels: SAMPLE, FAULTLINE_CAN, ..; default: all")
      ->type_name("NAME");
  command->footer(
      "Events are kept to the byte, their numbers and times too. RUN, what the run was made from, "
      "is "
      "always kept: a cut can be looked into and replayed like the whole.\n" +
      std::string(kExitCodesHelp));
  command->callback([arguments, &exit_code] { exit_code = cut_file(*arguments); });
}

}  // namespace faultline
