#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <faultline/truth_t.hpp>

namespace faultline {

/// A fault that acted in a recorded run, as TRUTH has it: from the timeline, or injected live.
struct RecordedFault {
  std::string target, kind;
  double value = 0.0;                         ///< when it was last seen to act
  std::int64_t from_cycle = 0;                ///< the first in which it acted
  std::optional<std::int64_t> until_cycle{};  ///< the first in which it did not any more
};

/// Follows the TRUTH of a run, which comes whenever the set of acting faults changes.
class RecordedFaults {
 public:
  void on_truth(const truth_t& truth);
  /// In the order of their beginnings. Each stretch of an intermittent fault is one.
  [[nodiscard]] const std::vector<RecordedFault>& faults() const noexcept { return faults_; }

 private:
  std::vector<RecordedFault> faults_;
};

}  // namespace faultline
