#include <algorithm>
#include <cstdio>
#include <memory>
#include <string>

#include <CLI/App.hpp>
#include <CLI/Validators.hpp>

#include "drivers/dbc/dbc_parser.h"
#include "tools/can/can_command.h"
#include "tools/can/dbc_print.h"
#include "tools/cli.h"

namespace faultline {
namespace {

int dbc_check(const std::string& file, const std::string& json_target) {
  const DbcDatabase dbc = read_dbc(file);
  print_dbc(human_output(json_target), dbc);
  if (!json_target.empty()) {
    write_to(json_target, [&](std::FILE* out) { write_dbc_json(out, dbc); });
  }
  const bool has_error = std::any_of(
      dbc.warnings.begin(), dbc.warnings.end(),
      [](const DbcWarning& warning) { return warning.severity == DbcSeverity::kError; });
  return has_error ? kExitNo : kExitYes;
}

}  // namespace

void add_dbc_check_command(CLI::App& parent, int& exit_code) {
  CLI::App* command = parent.add_subcommand(
      "check", "Read a DBC file: its messages and signals, and everything in it that is odd");
  auto file = std::make_shared<std::string>();
  auto json_target = std::make_shared<std::string>();
  command->add_option("FILE", *file, "DBC file")->required()->check(CLI::ExistingFile);
  add_json_option(*command, *json_target);
  command->footer(
      "note: nothing is lost; warning: understood, but wrong or unusual; error: a statement that "
      "could not be understood was skipped (exit code 1).\n" +
      std::string(kExitCodesHelp));
  command->callback(
      [file, json_target, &exit_code] { exit_code = dbc_check(*file, *json_target); });
}

}  // namespace faultline
