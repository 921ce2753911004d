#include "tools/bench/live_injection.h"

#include <algorithm>
#include <cmath>
#include <exception>
#include <limits>
#include <string_view>
#include <utility>
#include <vector>

#include <faultline/inject_t.hpp>
#include <fmt/format.h>

#include "diagnosis/model/toml_reader.h"
#include "sim/injection_rule.h"
#include "tools/lcm/channels.h"
#include "tools/lcm/lcm_url.h"
#include "tools/lcm/log_event.h"

namespace faultline {
namespace {

constexpr auto kLookPeriod = std::chrono::milliseconds(2);
/// Requests that wait for a look at most; what comes beside them is lost, as LCM may lose it.
constexpr int kQueue = 256;
/// Names in requests: DBC and TOML names are far shorter.
constexpr std::size_t kLongestName = 128;

/// The request asks for what cannot be had.
class Refusal : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// For messages: what is no printable ASCII is '?', and the rest of a long name is left out.
std::string printable(std::string_view name) {
  std::string text(name.substr(0, kLongestName));
  for (char& character : text) {
    if (character < ' ' || character > '~') character = '?';
  }
  return text;
}

void check_names(const inject_t& request) {
  const auto check = [](const char* field, const std::string& name) {
    if (name.size() <= kLongestName && name == printable(name)) return;
    throw Refusal(fmt::format("{}: found \"{}\" ({} bytes), expected up to {} printable characters",
                              field, printable(name), name.size(), kLongestName));
  };
  check("request", request.request);
  check("target", request.target);
  check("kind", request.kind);
  check("with", request.with);
}

void check_numbers(const inject_t& request) {
  const auto check = [](const char* field, double number, double least) {
    if (std::isfinite(number) && number >= least) return;
    throw Refusal(fmt::format("{}: found {}, expected a finite number{}", field, number,
                              least == 0.0 ? ", not negative" : ""));
  };
  constexpr double kAny = std::numeric_limits<double>::lowest();
  if (request.has_value != 0) check("value", request.value, kAny);
  check("duration_s", request.duration_s, 0.0);
  check("ramp_s", request.ramp_s, 0.0);
  check("period_s", request.period_s, 0.0);
  check("probability", request.probability, 0.0);
  check("frequency_Hz", request.frequency_Hz, 0.0);
  check("phase_rad", request.phase_rad, kAny);
}

InjectionKind kind_of(const inject_t& request) {
  if (const auto kind = find_injection_kind(request.kind)) return *kind;
  std::vector<std::string> names;
  for (const InjectionKind kind : all_injection_kinds()) {
    names.emplace_back(injection_kind_name(kind));
  }
  const auto near = nearest_name(request.kind, names);
  throw Refusal(fmt::format("kind: found \"{}\", expected one of {}{}", request.kind,
                            fmt::join(names, ", "),
                            near ? fmt::format("; did you mean \"{}\"?", *near) : ""));
}

void refuse_foreign_numbers(const inject_t& request, InjectionKind kind) {
  const auto check = [kind](const char* key, bool has) {
    if (!has || takes_key(kind, key)) return;
    throw Refusal(fmt::format("{}: found it with kind \"{}\", which does not use it", key,
                              injection_kind_name(kind)));
  };
  check("value", request.has_value != 0);
  check("ramp_s", request.ramp_s != 0.0);
  check("frequency_Hz", request.frequency_Hz != 0.0);
  check("phase_rad", request.phase_rad != 0.0);
  check("with", !request.with.empty());
}

/// `span_s` as whole cycles, one at least.
double snapped(double span_s, double sample_time_s) {
  return std::max(std::round(span_s / sample_time_s), 1.0) * sample_time_s;
}

Injection injection_of(const inject_t& request, double at_s, double sample_time_s) {
  Injection injection;
  injection.kind = kind_of(request);
  refuse_foreign_numbers(request, injection.kind);
  injection.target = request.target;
  if (request.has_value != 0) injection.value = request.value;
  injection.at_s = at_s;
  if (request.duration_s > 0.0) {
    injection.until_s = at_s + snapped(request.duration_s, sample_time_s);
  }
  injection.ramp_s = request.ramp_s;
  if (request.period_s > 0.0) injection.period_s = request.period_s;
  injection.probability = request.probability;
  injection.frequency_Hz = request.frequency_Hz;
  injection.phase_rad = request.phase_rad;
  injection.with = request.with;
  return injection;
}

/// Which node has what `injection` sits on; nothing where that is not known before it is resolved.
std::optional<BenchNode> node_of(const FaultTargets& targets, const Injection& injection) {
  const auto has = [&](const std::vector<ChannelTarget>& channels) {
    return std::any_of(channels.begin(), channels.end(), [&](const ChannelTarget& channel) {
      return channel.name == injection.target;
    });
  };
  switch (level_of(injection.kind)) {
    case FaultLevel::kPlant:
      return BenchNode::kPlant;
    case FaultLevel::kSignal:
      if (has(targets.inputs)) return BenchNode::kController;
      return has(targets.outputs) ? std::optional(BenchNode::kPlant) : std::nullopt;
    case FaultLevel::kFrame:
      break;
  }
  if (injection.target == "plant") return BenchNode::kPlant;
  if (injection.target == "controller") return BenchNode::kController;
  for (const MessageTarget& message : targets.messages) {
    if (message.name != injection.target) continue;
    return message.is_command ? BenchNode::kController : BenchNode::kPlant;
  }
  return std::nullopt;
}

void check_node(const FaultTargets& targets, const Injection& injection,
                std::optional<BenchNode> own) {
  const auto found = node_of(targets, injection);
  if (!own || !found || *found == *own) return;
  const bool is_plant = *own == BenchNode::kPlant;
  throw Refusal(fmt::format(
      "target: found \"{}\" with kind \"{}\", which is for the {}, expected "
      "what the {} has: the {} is another process",
      injection.target, injection_kind_name(injection.kind), is_plant ? "controller" : "plant",
      is_plant ? "plant" : "controller", is_plant ? "controller" : "plant"));
}

std::string cycle_text(std::uint32_t cycle, double at_s) {
  return fmt::format("from cycle {} ({:.6g} s)", cycle, at_s);
}

/// Targets that the timeline has, each once.
std::vector<std::string> scheduled_targets(const FaultSchedule& schedule) {
  std::vector<std::string> names;
  for (std::size_t i = 0; i < schedule.size(); ++i) names.push_back(schedule.injection(i).target);
  std::sort(names.begin(), names.end());
  names.erase(std::unique(names.begin(), names.end()), names.end());
  return names;
}

std::string clear(const inject_t& request, FaultSchedule& schedule, std::uint32_t cycle,
                  double at_s) {
  const std::size_t ended = schedule.clear(request.target, at_s);
  if (ended == 0 && !request.target.empty()) {
    const std::vector<std::string> names = scheduled_targets(schedule);
    const auto near = nearest_name(request.target, names);
    throw Refusal(fmt::format(
        "target: found \"{}\", on which no fault acts or is to come{}", request.target,
        near && *near != request.target ? fmt::format("; did you mean \"{}\"?", *near) : ""));
  }
  return fmt::format(
      "accepted: {} fault{} end{}{} {}", ended, ended == 1 ? "" : "s", ended == 1 ? "s" : "",
      request.target.empty() ? "" : fmt::format(" on {}", request.target), cycle_text(cycle, at_s));
}

std::string inject(const inject_t& request, FaultSchedule& schedule, std::uint32_t cycle,
                   double at_s, double sample_time_s, std::optional<BenchNode> node) {
  Injection injection = injection_of(request, at_s, sample_time_s);
  check_node(schedule.targets(), injection, node);
  const std::string text =
      fmt::format("accepted: {}{} on {} {}{}", request.kind,
                  injection.value ? fmt::format(" {:.6g}", *injection.value) : "", injection.target,
                  cycle_text(cycle, at_s),
                  injection.until_s ? fmt::format(" until {:.6g} s", *injection.until_s) : "");
  schedule.add(std::move(injection));
  return text;
}

}  // namespace

InjectAnswer answer_request(std::span<const std::uint8_t> message, FaultSchedule& schedule,
                            std::uint32_t cycle, double sample_time_s,
                            std::optional<BenchNode> node) {
  inject_t request;
  if (!decode_message(message, layout::kInject, request)) {
    return {false, "?: refused: found a damaged message, or one of another version"};
  }
  const std::string name = printable(request.request);
  const double at_s = cycle * sample_time_s;
  try {
    check_names(request);
    check_numbers(request);
    const std::string text = request.clear != 0
                                 ? clear(request, schedule, cycle, at_s)
                                 : inject(request, schedule, cycle, at_s, sample_time_s, node);
    return {true, fmt::format("{}: {}", name, text)};
  } catch (const Refusal& refusal) {
    return {false, fmt::format("{}: refused: {}", name, refusal.what())};
  } catch (const ScheduleError& error) {
    return {false, fmt::format("{}: refused: {}", name, error.what())};
  }
}

LiveInjection::LiveInjection(const std::string& url, FaultSchedule& schedule, double sample_time_s,
                             std::optional<BenchNode> node)
    : source_(url, kInjectChannel, kQueue),
      schedule_(schedule),
      sample_time_s_(sample_time_s),
      node_(node) {}

void LiveInjection::attend(std::uint32_t free_cycle, const Tell& tell) {
  const auto now = Clock::now();
  if (now < next_look_) return;
  next_look_ = now + kLookPeriod;
  if (now >= next_second_) {
    if (passed_over_ > 0) {
      tell("warning", fmt::format("{} requests were not looked at: more than {} in a second",
                                  passed_over_, kMostPerSecond));
    }
    next_second_ = now + std::chrono::seconds(1);
    taken_ = 0;
    passed_over_ = 0;
  }
  source_.receive(std::chrono::milliseconds(0), [&](const LiveMessage& message) {
    if (++taken_ > kMostPerSecond) {
      ++passed_over_;
      return;
    }
    const InjectAnswer answer =
        answer_request(message.data, schedule_, free_cycle, sample_time_s_, node_);
    tell(answer.is_accepted ? "info" : "warning", answer.text);
  });
}

bool can_listen_to(const std::string& url) noexcept {
  try {
    check_live_lcm_url(url);
    return true;
  } catch (...) {
    return false;
  }
}

}  // namespace faultline
