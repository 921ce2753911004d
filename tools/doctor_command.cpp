#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include <CLI/App.hpp>
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "tools/cli.h"
#include "tools/doctor/doctor.h"

namespace faultline {
namespace {

void print_findings(std::FILE* out, const std::vector<Finding>& findings) {
  constexpr int kFoundColumn = 28;
  for (const Finding& finding : findings) {
    fmt::print(out, "[{:^4}] {:<20} {}\n", status_name(finding.status), finding.check,
               finding.found);
    for (const std::string& remedy : finding.remedies) {
      fmt::print(out, "{:{}}$ {}\n", "", kFoundColumn, remedy);
    }
  }
  fmt::print(out, "{}\n",
             is_fit(findings) ? "this machine has what the bench needs"
                              : "something that the bench needs is missing: see FAIL");
}

nlohmann::ordered_json findings_json(const std::vector<Finding>& findings) {
  nlohmann::ordered_json json{{"fit", is_fit(findings)},
                              {"checks", nlohmann::ordered_json::array()}};
  for (const Finding& finding : findings) {
    json["checks"].push_back({{"check", finding.check},
                              {"status", status_name(finding.status)},
                              {"found", finding.found},
                              {"type", finding.remedies}});
  }
  return json;
}

}  // namespace

void add_doctor_command(CLI::App& program, int& exit_code) {
  CLI::App* command = program.add_subcommand(
      "doctor",
      "Look at this machine: CAN, multicast, LCM, real-time rights, clocks; say what to type");
  auto json = std::make_shared<std::string>();
  add_json_option(*command, *json);
  command->footer(kExitCodesHelp);
  command->callback([json, &exit_code] {
    const std::vector<Finding> findings = examine_machine();
    print_findings(human_output(*json), findings);
    if (!json->empty()) write_json(findings_json(findings), *json);
    exit_code = is_fit(findings) ? kExitYes : kExitNo;
  });
}

}  // namespace faultline
