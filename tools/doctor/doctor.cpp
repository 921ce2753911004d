#include "tools/doctor/doctor.h"

#include <algorithm>
#include <fstream>

#include "tools/doctor/checks.h"

namespace faultline {
namespace {

/// In the order in which they are shown.
constexpr Finding (*kChecks[])() = {
    check_can_in_kernel, check_can_interfaces, check_multicast,     check_lcm,
    check_lcm_logger,    check_receive_buffer, check_input_backlog, check_cpus,
    check_priority,      check_locked_memory,  check_cpu_latency,   check_realtime_share,
    check_governor,      check_clock,          check_timer,
};

}  // namespace

const char* status_name(FindingStatus status) noexcept {
  switch (status) {
    case FindingStatus::kOk:
      return "ok";
    case FindingStatus::kWarn:
      return "warn";
    case FindingStatus::kFail:
      break;
  }
  return "FAIL";
}

std::string first_line(const char* path) {
  std::ifstream file(path);
  std::string line;
  std::getline(file, line);
  return line;
}

std::vector<Finding> examine_machine() {
  std::vector<Finding> findings;
  for (const auto check : kChecks) findings.push_back(check());
  return findings;
}

bool is_fit(const std::vector<Finding>& findings) noexcept {
  return std::none_of(findings.begin(), findings.end(), [](const Finding& finding) {
    return finding.status == FindingStatus::kFail;
  });
}

}  // namespace faultline
