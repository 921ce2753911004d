#include "tools/lcm/message_layout.h"

#include <vector>

#include <faultline/can_t.hpp>
#include <faultline/diagnosis_t.hpp>
#include <faultline/estimate_t.hpp>
#include <faultline/event_t.hpp>
#include <faultline/residual_t.hpp>
#include <faultline/run_t.hpp>
#include <faultline/sample_t.hpp>
#include <faultline/stats_t.hpp>
#include <faultline/truth_t.hpp>
#include <gtest/gtest.h>

namespace faultline {
namespace {

constexpr std::size_t kFingerprintBytes = 8;

template <class Message>
std::vector<std::uint8_t> body_of(const Message& message) {
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(message.getEncodedSize()));
  EXPECT_EQ(message.encode(bytes.data(), 0, static_cast<int>(bytes.size())),
            static_cast<int>(bytes.size()));
  return {bytes.begin() + kFingerprintBytes, bytes.end()};
}

/// The layout takes the whole message, nothing shorter, and no damaged count makes it read on.
template <class Message>
void expect_layout(std::string_view layout, const Message& message) {
  SCOPED_TRACE(layout);
  const std::vector<std::uint8_t> body = body_of(message);
  EXPECT_EQ(laid_out_size(layout, body), body.size());
  for (std::size_t size = 0; size < body.size(); ++size) {
    EXPECT_EQ(laid_out_size(layout, std::span(body).first(size)), std::nullopt) << size;
  }
  for (std::size_t i = 0; i < body.size(); ++i) {
    std::vector<std::uint8_t> damaged = body;
    damaged[i] ^= 0xA0;
    EXPECT_LE(laid_out_size(layout, damaged).value_or(0), body.size());
  }
}

TEST(MessageLayout, IsThatOfEveryMessageOfALog) {
  expect_layout(layout::kRun, [] {
    run_t run{};
    run.part = "plant";
    run.data = {1, 2, 3};
    run.byte_count = 3;
    return run;
  }());
  expect_layout(layout::kCan, [] {
    can_t can{};
    can.frame_count = 2;
    can.frames.resize(2);
    can.frames[1].length = 2;
    can.frames[1].data = {1, 2};
    return can;
  }());
  expect_layout(layout::kSample, [] {
    sample_t sample{};
    sample.output_count = 2;
    sample.y = {1.0, 2.0};
    sample.y_is_fresh = {1, 0};
    sample.y_state = {0, 1};
    sample.y_age = {0, 2};
    sample.input_count = 1;
    sample.u = {1.0};
    sample.u_is_fresh = {1};
    sample.u_state = {0};
    sample.u_age = {0};
    return sample;
  }());
  expect_layout(layout::kResidual, [] {
    residual_t residual{};
    residual.row_count = 3;
    residual.residual = {1.0, 2.0, 3.0};
    residual.row_threshold = {1.0, 2.0, -1.0};
    residual.filter_count = 1;
    residual.evaluation = {1.0};
    residual.threshold = {1.0};
    residual.fired = {1};
    return residual;
  }());
  expect_layout(layout::kDiagnosis, [] {
    diagnosis_t diagnosis{};
    diagnosis.verdict = "ambiguous";
    diagnosis.blame = "Sensors1: wrong CRC";
    diagnosis.set_count = 2;
    diagnosis.sets.resize(2);
    diagnosis.sets[1].fault_count = 2;
    diagnosis.sets[1].faults = {"u1", "u2"};
    return diagnosis;
  }());
  expect_layout(layout::kEstimate, [] {
    estimate_t estimate{};
    estimate.fault_count = 1;
    estimate.fault = {"u1"};
    estimate.estimate = {2.0};
    estimate.deviation = {0.1};
    estimate.bound = {-1.0};
    return estimate;
  }());
  expect_layout(layout::kTruth, [] {
    truth_t truth{};
    truth.fault_count = 1;
    truth.faults.resize(1);
    truth.state_count = 2;
    truth.x = {1.0, 2.0};
    return truth;
  }());
  expect_layout(layout::kEvent, event_t{});
  expect_layout(layout::kStats, [] {
    stats_t stats{};
    stats.stage_count = 1;
    stats.latency.resize(1);
    stats.latency[0].bucket_count = 2;
    stats.latency[0].upper_ns = {1, 2};
    stats.latency[0].counts = {3, 4};
    return stats;
  }());
}

TEST(MessageLayout, RefusesCountsThatOverflowTheirSizeInBytes) {
  // 2^29 doubles are 2^32 bytes; -1 of them none.
  for (const std::uint8_t first : std::vector<std::uint8_t>{0x20, 0x7F, 0xFF}) {
    const std::vector<std::uint8_t> bytes = {first, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0};
    EXPECT_EQ(laid_out_size("NQ", bytes), std::nullopt);
    EXPECT_EQ(laid_out_size("N(q)", bytes), std::nullopt);
    EXPECT_EQ(laid_out_size("NS", bytes), std::nullopt);
    EXPECT_EQ(laid_out_size("s", bytes), std::nullopt);
  }
}

}  // namespace
}  // namespace faultline
