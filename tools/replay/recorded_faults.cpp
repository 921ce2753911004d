#include "tools/replay/recorded_faults.h"

#include <algorithm>

namespace faultline {

void RecordedFaults::on_truth(const truth_t& truth) {
  std::vector<injected_fault_t> acting = truth.faults;
  for (RecordedFault& fault : faults_) {
    if (fault.until_cycle) continue;
    const auto same = std::find_if(acting.begin(), acting.end(), [&](const injected_fault_t& now) {
      return now.target == fault.target && now.kind == fault.kind;
    });
    if (same == acting.end()) {
      fault.until_cycle = truth.cycle;
      continue;
    }
    fault.value = same->value;
    acting.erase(same);
  }
  for (const injected_fault_t& now : acting) {
    faults_.push_back({now.target, now.kind, now.value, truth.cycle});
  }
}

}  // namespace faultline
