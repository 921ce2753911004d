#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "diagnosis/bank/bank.h"
#include "diagnosis/runtime/decision.h"
#include "diagnosis/runtime/onset.h"
#include "drivers/can/can_frame.h"
#include "drivers/signal/sample.h"

namespace faultline {

/// All that the diagnosis knows after one sample. Sized once by the bank; copying between records
/// of one bank does not allocate.
struct DiagnosisRecord {
  explicit DiagnosisRecord(const Bank& bank);

  std::uint32_t cycle = 0;
  std::uint32_t command_cycle = 0;
  std::uint32_t flags = 0;  ///< SampleFlag bits
  Timestamp stamp{};        ///< receive time of the frame that closed the sample
  std::vector<double> y, u;
  std::vector<std::uint8_t> y_is_fresh, u_is_fresh;
  std::vector<SignalState> y_state, u_state;
  std::vector<std::uint32_t> y_age, u_age;  ///< samples; kNeverCame
  std::vector<double> residual;             ///< rows of all filters, stacked
  std::vector<double> evaluation;           ///< per filter
  std::vector<double> thresholds;           ///< of the evaluation, per filter, at this sample
  std::vector<double> row_thresholds;       ///< per row; ResidualBank::kNoThreshold: it has none
  std::vector<std::uint8_t> fired;          ///< per filter
  Decision decision;                        ///< the announced one
  std::uint32_t since_cycle = 0;            ///< first cycle of its verdict and sets
  Onset onset;                              ///< of the announced decision

  /// While inhibited: what the first message to blame did; kNone: nothing, or start-up or a reset.
  MessageFault fault = MessageFault::kNone;
  /// Its name; empty if no frame came at all. Belongs to the DiagnosisNode, valid as long as that.
  std::string_view blamed_message;
  std::uint64_t bad_frames = 0;        ///< came and were not used, since the start
  std::uint64_t missing_messages = 0;  ///< SYNC and sensor messages, since the start
};

/// "Sensors1: wrong CRC", "no frames"; empty if nothing is to blame.
[[nodiscard]] std::string blame_text(const DiagnosisRecord& record);

/// What the diagnosis of one sample has come to.
enum class DiagnosisStage {
  kDecoded,  ///< the sample is closed, its values are decoded
  kStepped,  ///< the residuals are there
  kDecided,  ///< the verdict is
};

/// Where the diagnosis node puts what it received and what it found. Called on the diagnosis
/// thread.
class DiagnosisSink {
 public:
  virtual ~DiagnosisSink() = default;
  virtual void on_received(const CanFrame& frame) noexcept = 0;
  /// Per sample, in order, before its `on_record`. The node owns no clock: whoever has one may time
  /// the stages.
  virtual void on_stage(DiagnosisStage /*stage*/) noexcept {}
  virtual void on_record(const DiagnosisRecord& record) noexcept = 0;
};

}  // namespace faultline
