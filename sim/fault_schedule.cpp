#include "sim/fault_schedule.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>
#include <utility>

#include <fmt/format.h>

#include "diagnosis/model/toml_reader.h"

namespace faultline {
namespace {

/// One of 2^64 equally likely numbers for each pair: the finaliser of SplitMix64 (Steele, Lea,
/// Flood 2014) over a running sum.
std::uint64_t mix(std::uint64_t state, std::uint64_t next) noexcept {
  std::uint64_t z = state + 0x9e3779b97f4a7c15U * (next + 1);
  z = (z ^ (z >> 30U)) * 0xbf58476d1ce4e5b9U;
  z = (z ^ (z >> 27U)) * 0x94d049bb133111ebU;
  return z ^ (z >> 31U);
}

/// Uniform in [0, 1).
double fraction(std::uint64_t draw) noexcept { return static_cast<double>(draw >> 11U) * 0x1p-53; }

/// Which numbers of an entry's stream are spoken for.
constexpr std::uint64_t kSpreadDraw = 0xffff'0000;
constexpr std::uint64_t kProbabilityDraw = 0xffff'0001;

template <class Named>
std::optional<std::size_t> index_of(const std::vector<Named>& list, const std::string& name) {
  const auto found =
      std::find_if(list.begin(), list.end(), [&](const Named& one) { return one.name == name; });
  if (found == list.end()) return std::nullopt;
  return static_cast<std::size_t>(found - list.begin());
}

template <class Named>
void append_names(const std::vector<Named>& list, std::vector<std::string>& names) {
  for (const Named& one : list) names.push_back(one.name);
}

std::string unknown_target(const FaultTargets& targets, const std::string& target) {
  std::vector<std::string> known;
  append_names(targets.inputs, known);
  append_names(targets.outputs, known);
  append_names(targets.components, known);
  std::string text =
      fmt::format("found \"{}\", expected an input, an output or a fault of plant \"{}\" ({})",
                  target, targets.plant_name, fmt::join(known, ", "));
  if (const auto near = nearest_name(target, known)) {
    text += fmt::format("; did you mean \"{}\"?", *near);
  }
  return text;
}

}  // namespace

struct FaultSchedule::Entry {
  Injection injection;
  FaultTarget target;
  double shift_s = 0.0;  ///< what of spread_s was drawn
  std::atomic<double> cleared_at_s{std::numeric_limits<double>::infinity()};

  Entry() = default;
  Entry& operator=(const Entry& other) {
    injection = other.injection;
    target = other.target;
    shift_s = other.shift_s;
    cleared_at_s = other.cleared_at_s.load();
    return *this;
  }
};

FaultTargets fault_targets(const PlantModel& plant) {
  FaultTargets targets;
  targets.plant_name = plant.name;
  const auto channels = [](const std::vector<std::string>& names, const Eigen::VectorXd& operating,
                           const Eigen::VectorXd& range) {
    std::vector<ChannelTarget> made;
    for (std::size_t i = 0; i < names.size(); ++i) {
      const auto at = static_cast<Eigen::Index>(i);
      made.push_back({names[i], at < operating.size() ? operating[at] : 0.0,
                      at < range.size() ? range[at] : 0.0});
    }
    return made;
  };
  targets.inputs = channels(plant.input_names, plant.u_operating, plant.input_range);
  targets.outputs = channels(plant.output_names, plant.y_operating, plant.output_range);
  for (const Fault& fault : plant.faults) {
    if (fault.kind == FaultKind::kComponent) targets.components.push_back({fault.name, 0.0});
  }
  return targets;
}

FaultSchedule::FaultSchedule() = default;
FaultSchedule::~FaultSchedule() = default;

FaultSchedule::FaultSchedule(const PlantModel& plant, std::vector<Injection> injections)
    : FaultSchedule(fault_targets(plant), std::move(injections), 1) {}

FaultSchedule::FaultSchedule(FaultTargets targets, std::vector<Injection> injections,
                             std::int64_t seed)
    : targets_(std::move(targets)),
      seed_(mix(0, static_cast<std::uint64_t>(seed))),
      entries_(std::make_unique<Entry[]>(kMostEntries)) {
  for (Injection& injection : injections) add(std::move(injection));
}

FaultSchedule::FaultSchedule(const FaultSchedule& other) { *this = other; }

FaultSchedule& FaultSchedule::operator=(const FaultSchedule& other) {
  if (this == &other) return *this;
  targets_ = other.targets_;
  seed_ = other.seed_;
  entries_ = other.entries_ ? std::make_unique<Entry[]>(kMostEntries) : nullptr;
  std::copy_n(other.entries_.get(), other.size(), entries_.get());
  size_ = other.size();
  return *this;
}

FaultSchedule::FaultSchedule(FaultSchedule&& other) noexcept { *this = std::move(other); }

FaultSchedule& FaultSchedule::operator=(FaultSchedule&& other) noexcept {
  targets_ = std::move(other.targets_);
  seed_ = other.seed_;
  entries_ = std::move(other.entries_);
  size_ = other.size_.exchange(0);
  return *this;
}

std::size_t FaultSchedule::size() const noexcept { return size_.load(std::memory_order_acquire); }

const Injection& FaultSchedule::injection(std::size_t entry) const noexcept {
  return entries_[entry].injection;
}

const FaultTarget& FaultSchedule::target(std::size_t entry) const noexcept {
  return entries_[entry].target;
}

double FaultSchedule::onset_s(std::size_t entry) const noexcept {
  return entries_[entry].injection.at_s + entries_[entry].shift_s;
}

std::uint64_t FaultSchedule::draw(std::size_t entry, double t_s, std::uint64_t n) const noexcept {
  // A cycle's time is the same number for all who ask, but for the last bits.
  const auto t_ns = static_cast<std::uint64_t>(std::llround(t_s * 1e9));
  return mix(mix(mix(seed_, entry), t_ns), n);
}

double FaultSchedule::activity(std::size_t entry, double t_s) const noexcept {
  const Entry& scheduled = entries_[entry];
  if (is_between(t_s, scheduled.cleared_at_s.load(std::memory_order_relaxed), std::nullopt)) {
    return 0.0;
  }
  const double a = faultline::activity(scheduled.injection, t_s - scheduled.shift_s);
  const double probability = scheduled.injection.probability;
  if (a == 0.0 || probability >= 1.0) return a;
  return fraction(draw(entry, t_s, kProbabilityDraw)) < probability ? a : 0.0;
}

double FaultSchedule::value(std::size_t entry, double t_s) const noexcept {
  const Entry& scheduled = entries_[entry];
  return injected_value(scheduled.injection, activity(entry, t_s), t_s - scheduled.shift_s);
}

FaultTarget FaultSchedule::resolve(std::size_t entry, const Injection& injection) const {
  if (const auto input = index_of(targets_.inputs, injection.target)) {
    return {FaultTargetKind::kInput, *input};
  }
  if (const auto output = index_of(targets_.outputs, injection.target)) {
    return {FaultTargetKind::kOutput, *output};
  }
  if (const auto component = index_of(targets_.components, injection.target)) {
    if (injection.kind == InjectionKind::kGain && targets_.components[*component].nominal == 0.0) {
      throw ScheduleError(
          entry, "kind",
          fmt::format("found \"{}\", expected \"bias\" or \"sinusoid\": \"{}\" is a fault of the "
                      "plant file, not a channel",
                      injection_kind_name(injection.kind), injection.target));
    }
    return {FaultTargetKind::kComponent, *component};
  }
  if (targets_.are_components_open) return {};
  throw ScheduleError(entry, "target", unknown_target(targets_, injection.target));
}

void FaultSchedule::add(Injection injection) {
  const std::size_t entry = size();
  if (entry == kMostEntries) {
    throw ScheduleError(
        entry, "target",
        fmt::format("found more than {} faults, expected at most so many in a run", kMostEntries));
  }
  Entry& scheduled = entries_[entry];
  scheduled.target = resolve(entry, injection);
  scheduled.shift_s = injection.spread_s * fraction(mix(mix(seed_, entry), kSpreadDraw));
  scheduled.injection = std::move(injection);
  size_.store(entry + 1, std::memory_order_release);
}

std::size_t FaultSchedule::clear(std::string_view target, double t_s) noexcept {
  std::size_t ended = 0;
  for (std::size_t i = 0; i < size(); ++i) {
    Entry& entry = entries_[i];
    if (!target.empty() && entry.injection.target != target) continue;
    if (entry.cleared_at_s.load() <= t_s) continue;
    entry.cleared_at_s = t_s;
    ++ended;
  }
  return ended;
}

std::vector<std::string> FaultSchedule::active_names(double t_s) const {
  std::set<std::string> names;
  for (std::size_t i = 0; i < size(); ++i) {
    if (activity(i, t_s) > 0.0) names.insert(injection(i).target);
  }
  return {names.begin(), names.end()};
}

}  // namespace faultline
