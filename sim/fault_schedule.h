#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

#include "diagnosis/model/plant_model.h"
#include "sim/fault.h"
#include "sim/plant.h"

namespace faultline {

/// The timeline names something the plant does not have, or asks of it what it cannot do.
class ScheduleError : public std::runtime_error {
 public:
  /// `what()` is "<field>: <text>".
  ScheduleError(std::size_t entry, const std::string& field, const std::string& text,
                const std::string& table = "fault")
      : std::runtime_error(field + ": " + text), entry_(entry), field_(field), table_(table) {}
  /// Index of the offending entry of [[table]], and which of its fields it is.
  [[nodiscard]] std::size_t entry() const noexcept { return entry_; }
  [[nodiscard]] const std::string& field() const noexcept { return field_; }
  [[nodiscard]] const std::string& table() const noexcept { return table_; }

 private:
  std::size_t entry_;
  std::string field_, table_;
};

/// A channel of the plant as a target of faults.
struct ChannelTarget {
  std::string name;
  double operating = 0.0;  ///< its value at the operating point
  double range = 0.0;      ///< largest |deviation| from there (plant file)
};

/// A message of the bus as a target of faults.
struct MessageTarget {
  std::string name;
  bool is_command = false;  ///< the controller sends it; else the plant does
  bool has_crc = false, has_counter = false;
  std::uint8_t length = 0;
};

/// Everything that can fail in a run.
struct FaultTargets {
  std::string plant_name;
  std::vector<ChannelTarget> inputs, outputs;
  std::vector<PlantComponent> components;  ///< SimulatedPlant::components
  std::vector<MessageTarget> messages;     ///< by their index in the SignalMap
  /// Where the simulated plant is not at hand (a replay): any other name is taken for a component.
  bool are_components_open = false;
  double sample_time_s = 0.0;  ///< of the run; 0: not known
};

/// What a plant file alone gives: no messages.
[[nodiscard]] FaultTargets fault_targets(const PlantModel& plant);

/// What an entry sits on, resolved.
struct FaultTarget {
  FaultTargetKind kind = FaultTargetKind::kUnknown;
  std::size_t index = 0;
  std::size_t with = 0;  ///< kSwapped: index of the other channel
};

/// The timeline of faults of a run, resolved against what can fail. It only grows: one thread may
/// add and clear while others read, without a lock. What is drawn depends on the seed, the entry
/// and the time alone: all readers agree, and a run repeats to the bit.
class FaultSchedule {
 public:
  /// Entries in all; a run that is injected into live can have no more.
  static constexpr std::size_t kMostEntries = 256;

  /// No faults, of no plant.
  FaultSchedule();
  /// @throws ScheduleError unknown target (with the nearest name that such a fault can have), a
  /// kind that the target cannot have, what find_mistake finds, a fault that excludes another one
  /// on its target while both may act (whatever is drawn of spread_s), too many.
  FaultSchedule(const PlantModel& plant, std::vector<Injection> injections);
  FaultSchedule(FaultTargets targets, std::vector<Injection> injections, std::int64_t seed);
  FaultSchedule(const FaultSchedule& other);
  FaultSchedule& operator=(const FaultSchedule& other);
  FaultSchedule(FaultSchedule&&) noexcept;
  FaultSchedule& operator=(FaultSchedule&&) noexcept;
  ~FaultSchedule();

  /// Entries so far; those in front of it do not change any more, but for `clear`.
  [[nodiscard]] std::size_t size() const noexcept;
  [[nodiscard]] const Injection& injection(std::size_t entry) const noexcept;
  [[nodiscard]] const FaultTarget& target(std::size_t entry) const noexcept;
  /// a(t) of an entry, with all that is drawn. Real-time.
  [[nodiscard]] double activity(std::size_t entry, double t_s) const noexcept;
  /// injected_value of an entry; a hard-over without a value goes to the upper end of the range.
  /// Real-time.
  [[nodiscard]] double value(std::size_t entry, double t_s) const noexcept;
  /// When an entry begins: at_s and what of spread_s was drawn.
  [[nodiscard]] double onset_s(std::size_t entry) const noexcept;
  /// A random stream of an entry's own, for `t_s`: the same numbers in every reader. Real-time.
  [[nodiscard]] std::uint64_t draw(std::size_t entry, double t_s,
                                   std::uint64_t n = 0) const noexcept;

  /// Adds an entry (a live injection). One thread. @throws ScheduleError as the constructor.
  void add(Injection injection);
  /// Ends, from t_s on, what acts on `target`; all if it is empty. One thread.
  /// @return how many entries that ends.
  std::size_t clear(std::string_view target, double t_s) noexcept;

  /// Names of the targets on which something acts at t_s, sorted.
  [[nodiscard]] std::vector<std::string> active_names(double t_s) const;
  [[nodiscard]] const FaultTargets& targets() const noexcept { return targets_; }

 private:
  struct Entry;
  [[nodiscard]] FaultTarget resolve(std::size_t entry, const Injection& injection) const;
  /// Index of what kSwapped swaps its target with.
  [[nodiscard]] std::size_t resolve_other(std::size_t entry, const Injection& injection,
                                          const FaultTarget& target) const;
  void check_alone(std::size_t entry, const Injection& injection, const FaultTarget& target) const;
  void check_beside_others(std::size_t entry, const Injection& injection,
                           const FaultTarget& target) const;

  FaultTargets targets_;
  std::uint64_t seed_ = 1;
  std::unique_ptr<Entry[]> entries_;
  std::atomic<std::size_t> size_{0};
};

}  // namespace faultline
