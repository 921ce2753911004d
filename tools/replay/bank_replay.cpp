#include "tools/replay/bank_replay.h"

#include <chrono>
#include <exception>
#include <utility>

#include "tools/lcm/frame_message.h"

namespace faultline {
BankReplay::BankReplay(const ReplayInputs& inputs, std::unique_ptr<MessageSink> log,
                       std::unique_ptr<MessageSink> results)
    : node_(inputs.map, inputs.bank, inputs.is_initial_state_known),
      publisher_(inputs, node_.decision_table().sets(), std::move(log), std::move(results)),
      history_(inputs.bank, node_.decision_table().sets(), inputs.scenario, inputs.schedule),
      has_log_(publisher_.has_log()) {}

void BankReplay::on_frame(const CanFrame& frame, std::uint64_t number) {
  utime_ = to_utime(frame.stamp);
  if (has_log_) {
    if (!is_begun_) publisher_.publish_parts(utime_);
    is_begun_ = true;
    publisher_.add_frame(frame, number, utime_);
  }
  ++counters_.frames_received;
  node_.on_frame(frame, *this);
  rethrow();
}

void BankReplay::finish(bool is_complete) {
  if (is_complete) node_.finish(*this);
  rethrow();
  if (!has_log_) return;
  publisher_.flush_frames();
  publisher_.publish_stats(counters_, {}, cycle_, utime_, true);
  publisher_.close();
}

void BankReplay::on_received(const CanFrame& /*frame*/) noexcept {}

void BankReplay::on_record(const DiagnosisRecord& record) noexcept {
  if (error_) return;
  try {
    const FaultEstimate* estimate = publisher_.publish_record(record, to_utime(record.stamp));
    history_.on_record(record);
    if (estimate != nullptr) history_.on_estimate(*estimate);
  } catch (...) {
    error_ = std::current_exception();
  }
  cycle_ = record.cycle;
  ++counters_.samples;
  if ((record.flags & kBadSample) != 0) ++counters_.bad_samples;
  if ((record.flags & kSampleReset) != 0) ++counters_.resets;
}

void BankReplay::rethrow() const {
  if (error_) std::rethrow_exception(error_);
}

}  // namespace faultline
