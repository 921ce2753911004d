#include "tools/bench/fault_estimate.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "drivers/signal/sample.h"

namespace faultline {
namespace {

// Per output: the step between values that its signal can carry; 0 for a float.
std::vector<double> output_resolution(const DiagnosisInputs& inputs) {
  std::vector<double> resolution(inputs.bank.output_names.size());
  for (const MappedMessage& message : inputs.map.sensor_messages) {
    for (const MappedSignal& signal : message.channels) {
      resolution[signal.channel] = std::abs(signal.scale) * signal.codec.resolution();
    }
  }
  return resolution;
}

}  // namespace

FaultEstimator::FaultEstimator(const DiagnosisInputs& inputs)
    : window_(inputs.bank, output_resolution(inputs)), filters_(inputs.bank) {}

void FaultEstimator::push(const DiagnosisRecord& record, std::span<const std::size_t> isolated) {
  // A bad sample moves the filters' state, which the window takes for unknown anyway.
  if ((record.flags & kBadSample) == 0) {
    window_.push(record.cycle, record.residual);
    filters_.push(record.cycle, record.fired, record.residual);
  } else {
    window_.restart();
    filters_.restart();
  }
  if (is_first_record_ || !is_same_verdict(record.decision, last_decision_)) {
    is_pending_ = !isolated.empty();
    estimate_.onset_cycle = record.onset.cycle;
  }
  is_first_record_ = false;
  last_decision_ = record.decision;
  is_ready_ = !isolated.empty() && is_ready(record, isolated);
}

bool FaultEstimator::is_ready(const DiagnosisRecord& record,
                              std::span<const std::size_t> isolated) const {
  return filters_.can_estimate(isolated) ? filters_.is_settled(isolated)
                                         : window_.is_window_behind(record.onset.last_cycle);
}

const FaultEstimate& FaultEstimator::estimate(const DiagnosisRecord& record,
                                              std::span<const std::size_t> isolated) {
  const bool is_by_filter = filters_.can_estimate(isolated);
  estimate_.magnitudes = is_by_filter ? filters_.estimate(isolated)
                                      : window_.estimate(isolated, record.onset.last_cycle);
  if (!is_first_due()) return estimate_;
  is_pending_ = false;
  if (!is_by_filter) refine_onset(record);
  return estimate_;
}

// Refined once: later magnitudes need not be those that made the residual cross. Where it has
// cleared, a fault went, and the response to those that stay says nothing.
void FaultEstimator::refine_onset(const DiagnosisRecord& record) {
  const std::int64_t filter = record.onset.filter;
  if (filter == Onset::kNone || record.fired[static_cast<std::size_t>(filter)] == 0) return;
  if (const auto delay = window_.response_delay(static_cast<std::size_t>(filter))) {
    estimate_.onset_cycle = std::max<std::int64_t>(record.onset.cycle - *delay, 0);
  }
}

}  // namespace faultline
