#include "tools/report_command.h"

#include <cstdio>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include <CLI/App.hpp>
#include <fmt/format.h>

#include "tools/cli.h"
#include "tools/log/replaced_file.h"
#include "tools/report/figure_page.h"
#include "tools/report/report_page.h"
#include "tools/version.h"

namespace faultline {
namespace {

struct ReportArguments {
  std::vector<std::string> logs;
  std::string figures;
  std::string output = "report.html";
  bool is_one_run = false;
};

/// What stood there is replaced when the page is complete.
void write_page(const std::string& page, const std::string& output) {
  if (output == "-") {
    write_to(output, [&](std::FILE* file) { std::fwrite(page.data(), 1, page.size(), file); });
    return;
  }
  ReplacedFile file(output);
  file.write(page.data(), page.size());
  file.commit();
}

int report(const ReportArguments& arguments) {
  if (!arguments.figures.empty()) {
    if (arguments.logs.size() != 1) {
      throw std::invalid_argument(
          fmt::format("LOG: found {} with --figures, expected one, the folder of the figures' logs",
                      arguments.logs.size()));
    }
    write_page(figure_page(read_figures(arguments.figures), arguments.logs.front(), kVersion),
               arguments.output);
    return kExitYes;
  }
  std::vector<std::vector<std::string>> runs;
  if (arguments.is_one_run) {
    runs.push_back(arguments.logs);
  } else {
    constexpr std::size_t kMostRuns = 2;
    if (arguments.logs.size() > kMostRuns) {
      throw std::invalid_argument(fmt::format(
          "LOG: found {} logs, expected one, or two to be compared, or --split with the files of "
          "one log that was split",
          arguments.logs.size()));
    }
    for (const std::string& log : arguments.logs) runs.push_back({log});
  }
  write_report(runs, arguments.output);
  return kExitYes;
}

}  // namespace

void write_report(const std::vector<std::vector<std::string>>& logs, const std::string& output) {
  std::vector<RunRecord> records;
  for (const std::vector<std::string>& files : logs) records.push_back(read_run_record(files));
  write_page(report_page(std::move(records), kVersion), output);
}

void add_report_command(CLI::App& program, int& exit_code) {
  CLI::App* command = program.add_subcommand(
      "report", "One HTML page of a run, made from its log; of two logs, both compared");
  auto arguments = std::make_shared<ReportArguments>();
  command
      ->add_option("LOG", arguments->logs,
                   "LCM log of a run, or two that are compared: the first is A, the second B")
      ->required();
  command
      ->add_option("-o,--output", arguments->output,
                   "The page, or - for stdout. It needs no other file and no network")
      ->capture_default_str()
      ->type_name("F.html|-");
  command->add_flag("--split", arguments->is_one_run,
                    "The logs are the files of one run, in order (--log-split-size, "
                    "--log-split-time)");
  command
      ->add_option("--figures", arguments->figures,
                   "Instead: the figures of this file, each from a log in folder LOG, with what is "
                   "claimed of them and what is true")
      ->type_name("F.toml");
  command->footer(kExitCodesHelp);
  command->callback([arguments, &exit_code] { exit_code = report(*arguments); });
}

}  // namespace faultline
