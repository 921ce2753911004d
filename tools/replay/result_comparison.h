#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

namespace faultline {

/// What a diagnosis found, by the channel that carries it.
enum class ResultChannel : std::uint8_t { kSample, kResidual, kDiagnosis, kEstimate };
inline constexpr std::size_t kResultChannels = 4;

/// "FAULTLINE_SAMPLE" ..
[[nodiscard]] const char* result_channel_name(ResultChannel channel) noexcept;
/// The channel of that name, if it carries results.
[[nodiscard]] std::optional<ResultChannel> find_result_channel(std::string_view name) noexcept;

/// Compares the results that a log carries with those of a replay of its frames, to the bit:
/// everything in a message but its time and its sequence number.
///
/// A log has them in another order than the replay: a batch of frames may stand before or behind
/// the results made from it. Each side waits for the other; what is compared is the n-th message of
/// a channel on both sides.
///
/// Where frames are missing in the log (`on_gap`) the replay cannot know what the diagnosis knew.
/// From there on messages are matched by their cycles, and those that differ are not verifiable,
/// until kSettled cycles in a row gave the same samples and residuals; a diagnosis or estimate
/// counts again from the first one behind that which is the same.
///
/// Memory: what waits; at most kMostWaiting messages per channel.
class ResultComparison {
 public:
  struct Counts {
    std::uint64_t recorded = 0;      ///< messages of the log
    std::uint64_t identical = 0;     ///< of these, reproduced to the bit
    std::uint64_t different = 0;     ///< of these, not
    std::uint64_t unverifiable = 0;  ///< of these, for lack of frames or before it can be known
    std::uint64_t repeated = 0;      ///< of these, came again
    std::uint64_t behind_end = 0;    ///< of these, whose frames had not reached the log at its end
    std::uint64_t unrecorded = 0;    ///< results of the replay that the log does not have
  };
  /// A result that was not reproduced, as it was encoded.
  struct Difference {
    ResultChannel channel{};
    std::int64_t cycle = 0;
    std::vector<std::uint8_t> recorded, replayed;
  };
  /// Cycles whose recorded results cannot be verified, both included.
  struct CycleRange {
    std::int64_t from = 0, to = 0;
  };

  /// A missing frame shows within the commands that the sampler remembers (16) and the cycles it
  /// keeps open (2); twice that.
  static constexpr std::int64_t kSettled = 32;
  /// Longest wait, in messages: far more than the results of a CAN batch, or of a publisher's
  /// queues.
  static constexpr std::size_t kMostWaiting = 65536;

  /// An encoded message: fingerprint, utime, sequence, cycle, .. @pre at least kHeaderBytes
  void on_recorded(ResultChannel channel, std::span<const std::uint8_t> message);
  void on_replayed(ResultChannel channel, std::span<const std::uint8_t> message);
  /// Frames are missing before the next one.
  void on_gap();
  /// The log is over. @param is_complete it has the frames of all its results: what still waits is
  ///   a difference. Else the frames of the last results never reached the log.
  void finish(bool is_complete);

  [[nodiscard]] const Counts& counts(ResultChannel channel) const noexcept {
    return channels_[static_cast<std::size_t>(channel)].counts;
  }
  [[nodiscard]] Counts total() const noexcept;
  [[nodiscard]] const std::optional<Difference>& first_difference() const noexcept {
    return first_difference_;
  }
  /// Of the residuals and samples; in order.
  [[nodiscard]] const std::vector<CycleRange>& unverifiable() const noexcept {
    return unverifiable_;
  }

  /// Fingerprint, utime, sequence, cycle: how all result messages begin (lcmtypes).
  static constexpr std::size_t kHeaderBytes = 32;

 private:
  struct Message {
    std::int64_t number = 0;  ///< recorded: its sequence number; replayed: counted from 0
    std::int64_t cycle = 0;
    std::vector<std::uint8_t> bytes;
  };
  /// First in, first out; slots keep their memory.
  class Waiting {
   public:
    [[nodiscard]] bool is_empty() const noexcept { return count_ == 0; }
    [[nodiscard]] std::size_t size() const noexcept { return count_; }
    [[nodiscard]] const Message& front() const noexcept { return slots_[first_]; }
    void push(std::int64_t number, std::int64_t cycle, std::span<const std::uint8_t> bytes);
    void pop() noexcept;

   private:
    std::vector<Message> slots_;
    std::size_t first_ = 0, count_ = 0;
  };
  struct Channel {
    Counts counts;
    Waiting recorded, replayed;
    std::int64_t replayed_count = 0;
    /// Sequence number of the replay's message 0; not known: messages are matched by cycle.
    std::optional<std::int64_t> offset = 0;
    std::int64_t gap_at = 0;      ///< number of the first message of the replay behind the last gap
    std::int64_t same_since = 0;  ///< messages behind it, without a break, that were the same
  };

  [[nodiscard]] Channel& at(ResultChannel channel) noexcept {
    return channels_[static_cast<std::size_t>(channel)];
  }
  void match(ResultChannel id, Channel& channel);
  void match_by_number(ResultChannel id, Channel& channel);
  void match_by_cycle(ResultChannel id, Channel& channel);
  [[nodiscard]] bool is_settled(ResultChannel id, const Channel& channel) const noexcept;
  void note_difference(ResultChannel id, const Message& recorded, const Message* replayed);
  void pass_unverifiable(ResultChannel id, Channel& channel);
  void note_unverifiable(ResultChannel id, std::int64_t cycle);

  std::array<Channel, kResultChannels> channels_;
  std::optional<Difference> first_difference_;
  std::vector<CycleRange> unverifiable_;
};

}  // namespace faultline
