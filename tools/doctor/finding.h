#pragma once

#include <string>
#include <vector>

namespace faultline {

enum class FindingStatus {
  kOk,
  kWarn,  ///< the bench runs, but not as well as it could
  kFail,  ///< something the bench needs is missing
};

/// What one check found on this machine.
struct Finding {
  std::string check;  ///< what was looked at
  FindingStatus status = FindingStatus::kOk;
  std::string found;
  std::vector<std::string> remedies{};  ///< commands to type, in order
};

/// "ok", "warn", "FAIL".
[[nodiscard]] const char* status_name(FindingStatus status) noexcept;

}  // namespace faultline
