#include "tools/bench/realtime_sink.h"

namespace faultline {

using std::chrono::steady_clock;

void RealtimeSink::on_stage(DiagnosisStage stage) noexcept {
  if (until_timed_ > 0) return;
  switch (stage) {
    case DiagnosisStage::kDecoded:
      times_.decoded = steady_clock::now();
      break;
    case DiagnosisStage::kStepped:
      times_.stepped = steady_clock::now();
      break;
    case DiagnosisStage::kDecided:
      times_.decided = steady_clock::now();
      break;
  }
}

void RealtimeSink::on_record(const DiagnosisRecord& record) noexcept {
  ++record_count_;
  times_.has_stages = until_timed_ == 0;
  until_timed_ = times_.has_stages ? cycles_per_value_ - 1 : until_timed_ - 1;
  QueuedRecord* const slot = records.free_slot();
  if (slot == nullptr) return;
  slot->record = record;
  if (times_.has_stages) times_.queued = steady_clock::now();
  slot->times = times_;
  records.push_slot();
}

}  // namespace faultline
