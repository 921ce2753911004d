#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string_view>

namespace faultline {

/// How the bytes of a message follow each other, one letter per member:
///
/// | letter | member |
/// |---|---|
/// | q | 8 bytes: int64_t, double |
/// | i | int32_t |
/// | c | 1 byte |
/// | s | string: its length with the final NUL as int32_t, then its bytes |
/// | N, L | the count for the arrays that follow, up to the next one: int32_t, int8_t |
/// | Q, B, S | that many q, c, s |
/// | (…) | that many structs of members … |
///
/// lcm-gen's decoder trusts counts: one of 2^29 doubles overflows its bounds check and is read from
/// beyond the message. What comes from a file is measured by this first.
namespace layout {
inline constexpr std::string_view kRun = "qqssssiiNB";
inline constexpr std::string_view kCan = "qqqiN(qicLB)";
inline constexpr std::string_view kSample = "qqqqiNQBBBNQBBB";
inline constexpr std::string_view kResidual = "qqqNQQNQQB";
inline constexpr std::string_view kDiagnosis = "qqqqqsssiN(NS)";
inline constexpr std::string_view kEstimate = "qqqqsNSQQQ";
inline constexpr std::string_view kTruth = "qqqN(ssq)NQ";
inline constexpr std::string_view kEvent = "qqqsss";
inline constexpr std::string_view kInject = "qqscsscqqqqqqqs";
inline constexpr std::string_view kStats = "qqqcqqqqqqqqqqqqqN(sqqqqiNQQ)NSQ";
}  // namespace layout

/// How many of `bytes` (a message without its fingerprint, the first 8 bytes) the layout takes;
/// nothing if they do not suffice, a count is negative, or a string is not NUL-terminated.
[[nodiscard]] std::optional<std::size_t> laid_out_size(std::string_view layout,
                                                       std::span<const std::uint8_t> bytes);

}  // namespace faultline
