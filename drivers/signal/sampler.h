#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "drivers/can/can_frame.h"
#include "drivers/signal/signal_map.h"

namespace faultline {

/// Why a sample is not to be trusted, or how it was made. Bits; a sample is good iff it has none of
/// kBadSample.
enum SampleFlag : std::uint32_t {
  kSampleSensorMissing = 1u << 0,   ///< a sensor message of the cycle never came
  kSampleCommandMissing = 1u << 1,  ///< command c_k is unknown (no SYNC) or incomplete
  kSampleRepeated = 1u << 2,        ///< a message of this cycle came twice; the first one counts
  kSampleLate = 1u << 3,            ///< since the last sample, a message of a closed cycle came
  kSampleGap = 1u << 4,             ///< no frame of this cycle came: the counter jumped over it
  kSampleShortPayload = 1u << 5,    ///< a message was shorter than its signals need
  kSampleChecksum = 1u << 6,        ///< a checksum or alive counter was wrong
  kSampleReset = 1u << 7,      ///< first sample after a restart or a long gap: forget everything
  kSampleBusOrder = 1u << 8,   ///< aligned by bus order (no SYNC or no c_k): a remark, not a fault
  kSampleNotFinite = 1u << 9,  ///< a float on the bus was NaN or infinite; its message is held
};
inline constexpr std::uint32_t kBadSample =
    kSampleSensorMissing | kSampleCommandMissing | kSampleRepeated | kSampleLate | kSampleGap |
    kSampleShortPayload | kSampleChecksum | kSampleReset | kSampleNotFinite;

/// One sample (y_k, u_k): outputs measured at cycle k, inputs acting over [t_k, t_k+1).
/// Views into the sampler, valid until its next call.
struct Sample {
  std::uint32_t cycle = 0;  ///< k
  /// c_k; kNoCommand before the first command, where it is unknown, and in bus order.
  std::uint32_t command_cycle = kNoCommand;
  std::uint32_t flags = 0;                   ///< SampleFlag bits
  Timestamp stamp{};                         ///< receive time of the frame that closed it
  std::span<const double> y;                 ///< outputs; a missing one holds its last value
  std::span<const double> u;                 ///< inputs; a missing one holds its last value
  std::span<const std::uint8_t> y_is_fresh;  ///< per output: 1 measured in this cycle, 0 held
  /// Per input: 1 the value acting in this cycle is known, 0 held. In bus order: 1 received since
  /// the sample before.
  std::span<const std::uint8_t> u_is_fresh;
  [[nodiscard]] bool is_good() const noexcept { return (flags & kBadSample) == 0; }
};

/// Counters only grow (until `Sampler::reset`).
struct SamplerCounters {
  std::uint64_t samples = 0;
  std::uint64_t bad_samples = 0;
  std::uint64_t missing_messages = 0;  ///< SYNC and sensor messages that closed samples lacked
  std::uint64_t late_frames = 0;       ///< of a cycle already closed, or of a command overtaken
  std::uint64_t repeated_frames = 0;
  std::uint64_t short_frames = 0;
  std::uint64_t not_finite_frames = 0;  ///< with a NaN or an infinity
  std::uint64_t resets = 0;
  /// Frames that are no mapped message, came before the first SYNC, or whose counter is out of
  /// reach.
  std::uint64_t ignored_frames = 0;
  std::uint64_t unstarted_cycles = 0;  ///< incomplete cycles skipped at the start; see Sampler
};

/// Aligns frames to samples by counters, not clocks (docs/design.md, "The cycle").
///
/// Samples close strictly in order: when complete (SYNC, every sensor message of k, command c_k),
/// at the first frame of a cycle >= k+2, or at the end of the run. A cycle that was jumped over
/// still gives one (bad) sample, so that the bank steps once per cycle; a jump of more than kMaxGap
/// cycles, or a SYNC more than kMaxBack behind, resets: what is open is dropped, and the next
/// sample says kSampleReset.
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

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace faultline
