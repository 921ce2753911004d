#include "tools/lcm/message_type.h"

#include <algorithm>
#include <array>
#include <cstddef>

#include <faultline/can_t.hpp>
#include <faultline/diagnosis_t.hpp>
#include <faultline/estimate_t.hpp>
#include <faultline/event_t.hpp>
#include <faultline/residual_t.hpp>
#include <faultline/run_t.hpp>
#include <faultline/sample_t.hpp>
#include <faultline/stats_t.hpp>
#include <faultline/truth_t.hpp>

#include "tools/lcm/channels.h"
#include "tools/lcm/message_layout.h"

namespace faultline {
namespace {

constexpr std::size_t kFingerprintBytes = 8;
/// Fingerprint, utime, sequence, and where it has one, cycle.
constexpr std::size_t kUtimeAt = 8, kSequenceAt = 16, kCycleAt = 24, kHeadBytes = 32;
/// No run counts so far: a number beyond is damage, and counting on from it must not overflow.
constexpr std::int64_t kLargestNumber = std::int64_t{1} << 62;

}  // namespace

std::int64_t big_endian_at(std::span<const std::uint8_t> data, std::size_t at) noexcept {
  std::uint64_t value = 0;
  for (std::size_t i = 0; i < sizeof value; ++i) value = value << 8 | data[at + i];
  return static_cast<std::int64_t>(value);
}

std::span<const MessageType> message_types() noexcept {
  static const std::array<MessageType, 9> types{{
      {kRunChannel, "run_t", layout::kRun, run_t::getHash(), false},
      {kCanChannel, "can_t", layout::kCan, can_t::getHash(), false},
      {kSampleChannel, "sample_t", layout::kSample, sample_t::getHash(), true},
      {kResidualChannel, "residual_t", layout::kResidual, residual_t::getHash(), true},
      {kDiagnosisChannel, "diagnosis_t", layout::kDiagnosis, diagnosis_t::getHash(), true},
      {kEstimateChannel, "estimate_t", layout::kEstimate, estimate_t::getHash(), true},
      {kTruthChannel, "truth_t", layout::kTruth, truth_t::getHash(), true},
      {kEventChannel, "event_t", layout::kEvent, event_t::getHash(), true},
      {kStatsChannel, "stats_t", layout::kStats, stats_t::getHash(), true},
  }};
  return types;
}

const MessageType* find_message_type(std::string_view channel) noexcept {
  const auto types = message_types();
  const auto found = std::find_if(types.begin(), types.end(),
                                  [&](const MessageType& type) { return type.channel == channel; });
  return found == types.end() ? nullptr : &*found;
}

MessageStatus read_head(const MessageType& type, std::span<const std::uint8_t> data,
                        MessageHead& head) noexcept {
  if (data.size() < kFingerprintBytes) return MessageStatus::kDamaged;
  if (big_endian_at(data, 0) != type.fingerprint) return MessageStatus::kOtherSchema;
  const auto body = data.subspan(kFingerprintBytes);
  if (laid_out_size(type.layout, body) != body.size() || data.size() < kHeadBytes) {
    return MessageStatus::kDamaged;
  }
  head = {big_endian_at(data, kUtimeAt), big_endian_at(data, kSequenceAt),
          type.has_cycle ? big_endian_at(data, kCycleAt) : -1};
  const bool is_number = head.sequence >= 0 && head.sequence < kLargestNumber;
  const bool is_cycle = head.cycle >= -1 && head.cycle < kLargestNumber;
  return is_number && is_cycle ? MessageStatus::kWhole : MessageStatus::kDamaged;
}

}  // namespace faultline
