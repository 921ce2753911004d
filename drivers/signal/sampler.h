#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>

#include "drivers/can/can_frame.h"
#include "drivers/signal/message_watch.h"
#include "drivers/signal/sample.h"
#include "drivers/signal/signal_map.h"

namespace faultline {

/// Counters only grow (until `Sampler::reset`). A bad frame is counted once.
struct SamplerCounters {
  std::uint64_t samples = 0;
  std::uint64_t bad_samples = 0;
  std::uint64_t missing_messages = 0;  ///< SYNC and sensor messages that closed samples lacked
  std::uint64_t late_frames = 0;       ///< of a cycle already closed, or of a command overtaken
  std::uint64_t repeated_frames = 0;
  std::uint64_t short_frames = 0;
  std::uint64_t not_finite_frames = 0;  ///< with a NaN or an infinity
  std::uint64_t refused_frames = 0;     ///< wrong checksum or alive counter
  std::uint64_t resets = 0;
  /// Frames that are no mapped message, came before the first SYNC, or whose counter is out of
  /// reach.
  std::uint64_t ignored_frames = 0;
  std::uint64_t unstarted_cycles = 0;  ///< incomplete cycles skipped at the start; see Sampler

  /// Frames that came and were not used.
  [[nodiscard]] std::uint64_t bad_frames() const noexcept {
    return late_frames + repeated_frames + short_frames + not_finite_frames + refused_frames;
  }
};

/// Aligns frames to samples by counters, not clocks (docs/design.md, "The cycle").
///
/// Samples close strictly in order: when complete (SYNC, every sensor message of k, command c_k),
/// at the first frame of a cycle >= k+2, or at the end of the run. A cycle that was jumped over
/// still gives one (bad) sample, so that the bank steps once per cycle; a jump of more than kMaxGap
/// cycles, or a SYNC more than kMaxBack behind, resets: what is open is dropped, and the next
/// sample says kSampleReset.
///
/// A sensor message that is slower than the cycle (MappedMessage::cycles_per_frame = N) is waited
/// for, and its lack marks samples, from N cycles after its last frame on; in those before, its
/// channels hold their values, with their age, and the sample is good.
///
/// Which cycle a frame is of: its counter mod 2^w is taken nearest to the newest cycle seen; k
/// itself wraps at 2^32. A sensor message without counter is of the newest SYNC's cycle. c_k =
/// kNoCommand: u = 0. Commands are remembered for kCommandDepth counters, the last one used for
/// ever.
///
/// Start, also after a reset: the first SYNC defines the first cycle. Of the kJoinCycles cycles
/// from there on, those before the first complete one are skipped, as their frames may have come
/// before we listened.
///
/// A repeated frame, identical or not, is a defect of the bus: it marks its sample, and its values
/// are not used. If that sample has closed, the repeat is a late frame and marks the next one.
///
/// Integrity. Frames of a protected message (message_protection.h) are checked first, also before
/// the start. One with a wrong checksum is not used, and as its cycle cannot be trusted either it
/// marks the next sample to close. One whose alive counter repeated or left its sequence is not
/// used, and marks the sample of its cycle. One after a gap is good: the samples that lack the
/// frames lost are bad already; only a message without cycle counter marks its sample, as nothing
/// else tells. A command refused for its counter, or doubled, marks the sample in which it should
/// act, also where the unit refused it too and acts on an older one (c_k says so). The unit's
/// messages that a bad sample lacks, or that marked it, are to blame.
///
/// Bus order. Where the map has no SYNC, no c_k, or a mapped message without counter, samples carry
/// kSampleBusOrder. Without SYNC the sensors' counters count the cycles; if one has none, a cycle
/// ends when a sensor message comes again. Without c_k or commands' counters, u_k is what commands
/// said before the first sensor frame of the cycle; zero before the first command.
///
/// Real-time: after construction nothing allocates or throws. Use from one thread.
///
///   sampler.push(frame);
///   while (const Sample* sample = sampler.take()) { ... }
class Sampler {
 public:
  static constexpr std::uint32_t kMaxGap = 100;  ///< cycles (docs/design.md)
  static constexpr std::uint32_t kMaxBack = 8;   ///< cycles (docs/design.md)
  /// Commands remembered by counter: as many as the narrowest counter (4 bits) tells apart.
  static constexpr std::uint32_t kCommandDepth = 16;
  /// c_k of the first cycle, and the second's if the controller is late, may precede the first
  /// SYNC.
  static constexpr std::uint32_t kJoinCycles = 2;

  /// Copies what it needs of `map`.
  explicit Sampler(const SignalMap& map);
  ~Sampler();
  Sampler(Sampler&&) noexcept;
  Sampler& operator=(Sampler&&) noexcept;

  /// Takes one received frame in bus order. @pre `take` was called until nullptr since the last
  /// push
  void push(const CanFrame& frame) noexcept;
  /// The run is over: what is open may close. Frames pushed from now on are ignored, until reset.
  void finish() noexcept;
  /// Next closed sample, or nullptr. Call until nullptr after each push.
  [[nodiscard]] const Sample* take() noexcept;
  /// Back to the first instant, counters included, without reallocating.
  void reset() noexcept;

  [[nodiscard]] const SamplerCounters& counters() const noexcept;
  /// What one message did. @pre message < SignalMap::message_count()
  [[nodiscard]] MessageCounters message_counters(std::size_t message) const noexcept;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace faultline
