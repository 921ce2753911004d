#include <array>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "tools/bench/scenario_tables.h"

namespace faultline {
namespace {

constexpr std::array<std::pair<ControllerKind, std::string_view>, 7> kKinds{
    {{ControllerKind::kLqr, "lqr"},
     {ControllerKind::kGain, "gain"},
     {ControllerKind::kObserver, "observer"},
     {ControllerKind::kPid, "pid"},
     {ControllerKind::kRecorded, "recorded"},
     {ControllerKind::kExternal, "external"},
     {ControllerKind::kNone, "none"}}};

ControllerKind read_kind(TomlTable& table) {
  const std::string name =
      table.choice("kind", {"lqr", "gain", "observer", "pid", "recorded", "external", "none"});
  for (const auto& [kind, known] : kKinds) {
    if (known == name) return kind;
  }
  return ControllerKind::kNone;
}

bool follows_reference(ControllerKind kind) {
  return kind == ControllerKind::kLqr || kind == ControllerKind::kGain ||
         kind == ControllerKind::kObserver || kind == ControllerKind::kPid;
}

/// Two ways to one gain: given, or from weights.
void refuse_both(const TomlTable& table, std::string_view gain, std::string_view first_weight,
                 std::string_view second_weight) {
  if (!table.has(gain)) return;
  for (const std::string_view weight : {first_weight, second_weight}) {
    if (!table.has(weight)) continue;
    throw table.error(weight, fmt::format("found {} beside {}, expected either the gain {} or the "
                                          "weights {} and {} it follows from",
                                          weight, gain, gain, first_weight, second_weight));
  }
}

void read_observer(TomlTable& table, ControllerSpec& spec) {
  refuse_both(table, "K", "Q", "R");
  refuse_both(table, "L", "Q_w", "R_v");
  spec.K = table.optional_matrix("K", -1, -1);
  spec.L = table.optional_matrix("L", -1, -1);
  if (!spec.K) {
    spec.Q = table.optional_matrix("Q", -1, -1);
    spec.R = table.optional_matrix("R", -1, -1);
  }
  if (!spec.L) {
    spec.Q_w = table.optional_matrix("Q_w", -1, -1);
    spec.R_v = table.optional_matrix("R_v", -1, -1);
  }
}

PidLoopSpec read_loop(TomlTable table) {
  PidLoopSpec spec{table.string("output"), table.string("input"), {}};
  PidLoop& loop = spec.loop;
  loop.K_p = table.number("K_p");
  if (loop.K_p == 0.0) throw table.error("K_p", "found 0, expected a gain that acts");
  if (table.has("T_i_s")) loop.T_i_s = read_positive(table, "T_i_s");
  if (table.has("T_d_s")) {
    loop.T_d_s = read_positive(table, "T_d_s");
    if (table.has("N")) loop.N = read_positive(table, "N");
  }
  if (!loop.T_i_s) return spec;
  if (table.has("anti_windup") &&
      table.choice("anti_windup", {"back_calculation", "clamping"}) == "clamping") {
    loop.anti_windup = AntiWindup::kClamping;
  } else if (table.has("T_t_s")) {
    loop.T_t_s = read_positive(table, "T_t_s");
  }
  return spec;
}

void read_loops(TomlTable& table, ControllerSpec& spec) {
  for (const TomlTable& loop : table.tables("loop")) spec.loops.push_back(read_loop(loop));
  if (spec.loops.empty()) {
    throw table.error("", "found kind \"pid\" without a loop, expected [[controller.loop]]");
  }
}

void read_limits(TomlTable limits, ControllerSpec& spec) {
  for (const std::string& input : limits.keys()) {
    const Eigen::Vector2d range = limits.vector(input, 2);
    if (!(range[0] < range[1])) {
      throw limits.error(
          input, fmt::format("found [{}, {}], expected [smallest, largest]", range[0], range[1]));
    }
    spec.limits.emplace(input, range);
  }
}

void read_reference(TomlTable reference, ControllerSpec& spec) {
  for (const std::string& output : reference.keys()) {
    spec.reference.emplace(output, reference.number(output));
  }
}

void read_law(TomlTable& table, const std::filesystem::path& folder, ControllerSpec& spec) {
  switch (spec.kind) {
    case ControllerKind::kLqr:
      spec.Q = table.optional_matrix("Q", -1, -1);
      spec.R = table.optional_matrix("R", -1, -1);
      return;
    case ControllerKind::kGain:
      spec.K = table.matrix("K", -1, -1);
      return;
    case ControllerKind::kObserver:
      return read_observer(table, spec);
    case ControllerKind::kPid:
      return read_loops(table, spec);
    case ControllerKind::kRecorded:
      spec.commands = folder / table.string("file");
      return;
    case ControllerKind::kExternal:
    case ControllerKind::kNone:
      return;
  }
}

}  // namespace

std::string_view controller_kind_name(ControllerKind kind) noexcept {
  for (const auto& [known, name] : kKinds) {
    if (known == kind) return name;
  }
  return "";
}

ControllerSpec read_controller(TomlTable table, const std::filesystem::path& folder) {
  ControllerSpec spec;
  spec.kind = read_kind(table);
  read_law(table, folder, spec);
  if (spec.kind == ControllerKind::kExternal) return spec;
  spec.feedforward = table.optional_vector("feedforward", -1);
  spec.amplitude = table.optional_vector("amplitude", -1);
  if (spec.amplitude) spec.frequency_Hz = table.vector("frequency_Hz", spec.amplitude->size());
  if (auto limits = table.optional_table("limits")) read_limits(*limits, spec);
  if (!follows_reference(spec.kind)) return spec;
  if (auto reference = table.optional_table("reference")) read_reference(*reference, spec);
  return spec;
}

ReferenceStepSpec read_reference_step(TomlTable table, const ControllerSpec& controller) {
  if (!follows_reference(controller.kind)) {
    throw table.error("", fmt::format("found [[reference]] for a controller of kind \"{}\", "
                                      "expected one of kind lqr, gain, observer or pid",
                                      controller_kind_name(controller.kind)));
  }
  ReferenceStepSpec spec;
  spec.output = table.string("output");
  spec.step.at_s = require_time(table, "at_s", table.number("at_s"));
  spec.step.value = table.number("value");
  spec.step.ramp_s = require_time(table, "ramp_s", table.optional_number("ramp_s").value_or(0.0));
  return spec;
}

}  // namespace faultline
