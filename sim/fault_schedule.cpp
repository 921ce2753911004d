#include "sim/fault_schedule.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <charconv>
#include <cmath>
#include <limits>
#include <set>
#include <utility>

#include <fmt/format.h>

#include "diagnosis/model/toml_reader.h"
#include "sim/injection_rule.h"
#include "sim/random_draw.h"

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

/// Which numbers of an entry's stream are spoken for.
constexpr std::uint64_t kSpreadDraw = 0xffff'0000;
constexpr std::uint64_t kProbabilityDraw = 0xffff'0001;

constexpr std::array<std::string_view, 2> kNodeNames{"plant", "controller"};
/// Identifiers of CAN have 29 bits at most.
constexpr unsigned long kLargestId = 0x1FFFFFFF;

template <class List>
std::optional<std::size_t> index_of(const List& list, std::string_view name) {
  for (std::size_t i = 0; i < list.size(); ++i) {
    if constexpr (requires { list[i].name; }) {
      if (list[i].name == name) return i;
    } else {
      if (list[i] == name) return i;
    }
  }
  return std::nullopt;
}

/// Whether a message has what such a fault breaks.
bool can_have(const MessageTarget& message, InjectionKind kind) {
  if (kind == InjectionKind::kWrongCrc) return message.has_crc;
  return kind != InjectionKind::kFrozenCounter || message.has_counter;
}

/// Names that an entry of `kind` can have.
std::vector<std::string> possible_targets(const FaultTargets& targets, InjectionKind kind) {
  const InjectionRule& rule = rule_of(kind);
  std::vector<std::string> names;
  const auto append = [&](FaultTargetKind target, const auto& list) {
    if (!rule.allows(target)) return;
    for (const auto& one : list) names.push_back(one.name);
  };
  append(FaultTargetKind::kInput, targets.inputs);
  append(FaultTargetKind::kOutput, targets.outputs);
  append(FaultTargetKind::kComponent, targets.components);
  for (const MessageTarget& message : targets.messages) {
    if (rule.allows(FaultTargetKind::kMessage) && can_have(message, kind)) {
      names.push_back(message.name);
    }
  }
  if (rule.allows(FaultTargetKind::kNode)) {
    names.insert(names.end(), kNodeNames.begin(), kNodeNames.end());
  }
  return names;
}

std::string unknown_target(const FaultTargets& targets, const Injection& injection) {
  const std::vector<std::string> known = possible_targets(targets, injection.kind);
  std::string text = fmt::format(
      "found \"{}\", expected {} of plant \"{}\"{} with kind = \"{}\"", injection.target,
      target_kinds_text(rule_of(injection.kind)), targets.plant_name,
      known.empty() ? ", which has none," : fmt::format(" ({})", fmt::join(known, ", ")),
      injection_kind_name(injection.kind));
  if (const auto near = nearest_name(injection.target, known)) {
    text += fmt::format("; did you mean \"{}\"?", *near);
  }
  return text;
}

/// An identifier as in "0x1A5" or "421".
std::optional<std::size_t> identifier(const std::string& name) {
  if (name.empty() || std::isdigit(static_cast<unsigned char>(name.front())) == 0) {
    return std::nullopt;
  }
  const bool is_hex = name.starts_with("0x") || name.starts_with("0X");
  const char* begin = name.data() + (is_hex ? 2 : 0);
  const char* end = name.data() + name.size();
  unsigned long id = 0;
  const auto [stop, error] = std::from_chars(begin, end, id, is_hex ? 16 : 10);
  if (error != std::errc() || stop != end || id > kLargestId) return std::nullopt;
  return id;
}

/// Payload sizes of CAN FD.
bool is_frame_length(double bytes) {
  constexpr std::array kLong{12.0, 16.0, 20.0, 24.0, 32.0, 48.0, 64.0};
  return bytes <= 8.0 || std::find(kLong.begin(), kLong.end(), bytes) != kLong.end();
}

/// Its number must fit the message's bytes.
std::optional<std::string> mistake_for(const MessageTarget& message, const Injection& injection) {
  const double length = message.length;
  if (injection.kind == InjectionKind::kCorrupted && injection.value.value_or(1) > 8 * length) {
    return fmt::format("found {} bits, expected at most the {} of message \"{}\"",
                       injection.value.value_or(1), 8 * length, message.name);
  }
  if (injection.kind != InjectionKind::kWrongDlc) return std::nullopt;
  if (length == 0 && !injection.value) {
    return fmt::format("found nothing, expected a length: message \"{}\" has no bytes to lose",
                       message.name);
  }
  if (!injection.value) return std::nullopt;
  if (*injection.value == length) {
    return fmt::format("found {}, expected another length than that of message \"{}\"", length,
                       message.name);
  }
  if (!is_frame_length(*injection.value) || (length <= 8 && *injection.value > 8)) {
    return fmt::format("found {} bytes, expected a length of a frame like message \"{}\": 0 to 8{}",
                       *injection.value, message.name,
                       length <= 8 ? "" : ", 12, 16, 20, 24, 32, 48, 64");
  }
  return std::nullopt;
}

/// From when on it may act, and until when, whatever is drawn.
struct Span {
  double begin_s, end_s;
};
Span span_of(const Injection& injection, double cleared_at_s) {
  const double end_s = injection.until_s ? *injection.until_s + injection.spread_s
                                         : std::numeric_limits<double>::infinity();
  return {injection.at_s, std::min(end_s, cleared_at_s)};
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
  return uniform_of(draw(entry, t_s, kProbabilityDraw)) < probability ? a : 0.0;
}

double FaultSchedule::value(std::size_t entry, double t_s) const noexcept {
  const Entry& scheduled = entries_[entry];
  if (scheduled.injection.kind == InjectionKind::kHardOver && !scheduled.injection.value) {
    const ChannelTarget& input = targets_.inputs[scheduled.target.index];
    return input.operating + input.range;
  }
  return injected_value(scheduled.injection, activity(entry, t_s), t_s - scheduled.shift_s);
}

FaultTarget FaultSchedule::resolve(std::size_t entry, const Injection& injection) const {
  using enum FaultTargetKind;
  const InjectionRule& rule = rule_of(injection.kind);
  const std::string& name = injection.target;
  const auto find = [&](FaultTargetKind kind, const auto& list) -> std::optional<FaultTarget> {
    const auto index = rule.allows(kind) ? index_of(list, name) : std::nullopt;
    if (!index) return std::nullopt;
    return FaultTarget{kind, *index};
  };
  if (const auto input = find(kInput, targets_.inputs)) return *input;
  if (const auto output = find(kOutput, targets_.outputs)) return *output;
  if (const auto component = find(kComponent, targets_.components)) return *component;
  if (const auto message = find(kMessage, targets_.messages)) return *message;
  if (const auto node = find(kNode, kNodeNames)) return *node;
  const auto id = rule.allows(kId) ? identifier(name) : std::nullopt;
  if (id) return {kId, *id};
  if (rule.allows(kComponent) && targets_.are_components_open) return {};
  throw ScheduleError(entry, "target", unknown_target(targets_, injection));
}

std::size_t FaultSchedule::resolve_other(std::size_t entry, const Injection& injection,
                                         const FaultTarget& target) const {
  const bool is_input = target.kind == FaultTargetKind::kInput;
  const std::vector<ChannelTarget>& channels = is_input ? targets_.inputs : targets_.outputs;
  const auto other = index_of(channels, injection.with);
  if (other && *other != target.index) return *other;
  std::vector<std::string> names;
  for (const ChannelTarget& channel : channels) {
    if (channel.name != injection.target) names.push_back(channel.name);
  }
  const auto near = nearest_name(injection.with, names);
  throw ScheduleError(
      entry, "with",
      fmt::format("found \"{}\", expected another {} of plant \"{}\" ({}){}", injection.with,
                  is_input ? "input" : "output", targets_.plant_name,
                  names.empty() ? "it has none" : fmt::format("{}", fmt::join(names, ", ")),
                  near ? fmt::format("; did you mean \"{}\"?", *near) : ""));
}

void FaultSchedule::check_alone(std::size_t entry, const Injection& injection,
                                const FaultTarget& target) const {
  const auto refuse = [entry](const std::string& field, const std::string& text) {
    throw ScheduleError(entry, field, text);
  };
  if (const auto mistake = find_mistake(injection, targets_.sample_time_s)) {
    refuse(mistake->field, mistake->text);
  }
  const std::string_view kind = injection_kind_name(injection.kind);
  if (target.kind == FaultTargetKind::kComponent && injection.kind == InjectionKind::kGain &&
      targets_.components[target.index].nominal == 0.0) {
    refuse("kind",
           fmt::format("found \"gain\", expected \"bias\", \"sinusoid\" or \"drift\": \"{}\" is "
                       "nominally zero, and no factor changes that",
                       injection.target));
  }
  if (injection.kind == InjectionKind::kHardOver && !injection.value &&
      targets_.inputs[target.index].range <= 0.0) {
    refuse("value", fmt::format("found nothing, expected a number: plant \"{}\" gives no range of "
                                "\"{}\"",
                                targets_.plant_name, injection.target));
  }
  if (target.kind != FaultTargetKind::kMessage) return;
  const MessageTarget& message = targets_.messages[target.index];
  if (!can_have(message, injection.kind)) {
    const std::vector<std::string> names = possible_targets(targets_, injection.kind);
    refuse(
        "target",
        fmt::format("found message \"{}\", which has no {} in the DBC, expected one "
                    "that has ({}) with kind = \"{}\"",
                    message.name,
                    injection.kind == InjectionKind::kWrongCrc ? "checksum" : "alive counter",
                    names.empty() ? "none has" : fmt::format("{}", fmt::join(names, ", ")), kind));
  }
  if (const auto text = mistake_for(message, injection)) refuse("value", *text);
}

void FaultSchedule::check_beside_others(std::size_t entry, const Injection& injection,
                                        const FaultTarget& target) const {
  const Span span = span_of(injection, std::numeric_limits<double>::infinity());
  for (std::size_t i = 0; i < size(); ++i) {
    const Entry& other = entries_[i];
    if (!exclude_each_other(injection.kind, other.injection.kind)) continue;
    if (target.kind != other.target.kind) continue;
    const bool is_swap = injection.kind == InjectionKind::kSwapped;
    const auto touches = [&](std::size_t channel) {
      return channel == other.target.index || (is_swap && channel == other.target.with);
    };
    if (!touches(target.index) && !(is_swap && touches(target.with))) continue;
    const Span taken = span_of(other.injection, other.cleared_at_s.load());
    if (span.begin_s >= taken.end_s || taken.begin_s >= span.end_s) continue;
    throw ScheduleError(
        entry, "at_s",
        fmt::format("found \"{}\" on \"{}\" while \"{}\" of entry {} may still act there (from {} "
                    "s{}), expected one at a time",
                    injection_kind_name(injection.kind), injection.target,
                    injection_kind_name(other.injection.kind), i + 1, taken.begin_s,
                    std::isfinite(taken.end_s) ? fmt::format(" until {} s", taken.end_s) : " on"));
  }
}

void FaultSchedule::add(Injection injection) {
  const std::size_t entry = size();
  if (entry == kMostEntries) {
    throw ScheduleError(
        entry, "target",
        fmt::format("found more than {} faults, expected at most so many in a run", kMostEntries));
  }
  Entry& scheduled = entries_[entry];
  FaultTarget target = resolve(entry, injection);
  check_alone(entry, injection, target);
  if (injection.kind == InjectionKind::kSwapped)
    target.with = resolve_other(entry, injection, target);
  check_beside_others(entry, injection, target);
  scheduled.target = target;
  scheduled.shift_s = injection.spread_s * uniform_of(mix(mix(seed_, entry), kSpreadDraw));
  scheduled.injection = std::move(injection);
  size_.store(entry + 1, std::memory_order_release);
}

std::size_t FaultSchedule::clear(std::string_view target, double t_s) noexcept {
  std::size_t ended = 0;
  for (std::size_t i = 0; i < size(); ++i) {
    Entry& entry = entries_[i];
    if (!target.empty() && entry.injection.target != target) continue;
    if (span_of(entry.injection, entry.cleared_at_s.load()).end_s <= t_s) continue;
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
