#include <algorithm>
#include <numbers>
#include <stdexcept>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "diagnosis/model/riccati.h"
#include "diagnosis/model/toml_reader.h"
#include "sim/observer_feedback.h"
#include "sim/pid.h"
#include "sim/recorded_commands.h"
#include "sim/static_feedback.h"
#include "tools/bench/bench_parts.h"
#include "tools/bench/controller_plan.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// A reference is held if the equations of rest are met to this share of it: rounding of the
/// pseudo-inverse leaves 1e-12 or so times its condition.
constexpr double kReferenceTolerance = 1e-6;
/// The largest pole of a loop at rest is known to rounding only.
constexpr double kPoleTolerance = 1e-9;

/// What the laws are made of.
struct Subject {
  const Scenario& scenario;
  const PlantModel& plant;
  double sample_time_s;
  const std::optional<NamedText>& commands;
  [[nodiscard]] const ControllerSpec& spec() const { return scenario.controller; }
};

void check_shape(const Scenario& scenario, const char* key, const MatrixXd& matrix, Index rows,
                 Index cols) {
  if (matrix.rows() == rows && matrix.cols() == cols) return;
  throw scenario_error(scenario, "controller", key,
                       fmt::format("controller.{}: found {}×{}, expected {}×{}", key, matrix.rows(),
                                   matrix.cols(), rows, cols));
}

/// `given`, of that shape; the identity if absent.
MatrixXd weight(const Subject& subject, const char* key, const std::optional<MatrixXd>& given,
                Index size) {
  if (!given) return MatrixXd::Identity(size, size);
  check_shape(subject.scenario, key, *given, size, size);
  return *given;
}

/// Place of a channel among `names`. `what`: "output", "input".
Index find_channel(const Subject& subject, const std::string& found, const char* what,
                   const std::vector<std::string>& names, const char* table, const char* key,
                   std::optional<std::size_t> entry = std::nullopt) {
  const auto at = std::find(names.begin(), names.end(), found);
  if (at != names.end()) return at - names.begin();
  const auto near = nearest_name(found, names);
  throw scenario_error(
      subject.scenario, table, key,
      fmt::format("{}{}{}: found \"{}\", expected an {} of plant \"{}\" ({}){}", table,
                  *key != '\0' ? "." : "", key, found, what, subject.plant.name,
                  fmt::join(names, ", "), near ? fmt::format("; did you mean \"{}\"?", *near) : ""),
      entry);
}

CommandBase make_base(const Subject& subject) {
  const ControllerSpec& spec = subject.spec();
  const Index m = subject.plant.m();
  const VectorXd feedforward = spec.feedforward.value_or(VectorXd::Zero(m));
  check_shape(subject.scenario, "feedforward", feedforward, m, 1);
  CommandBase base(subject.plant.u_operating + feedforward);
  if (spec.amplitude) {
    check_shape(subject.scenario, "amplitude", *spec.amplitude, m, 1);
    base.amplitude = *spec.amplitude;
    base.omega_rad = 2.0 * std::numbers::pi * subject.sample_time_s * *spec.frequency_Hz;
  }
  for (const auto& [input, range] : spec.limits) {
    const Index i =
        find_channel(subject, input, "input", subject.plant.input_names, "controller", "limits");
    base.lower[i] = range[0];
    base.upper[i] = range[1];
  }
  return base;
}

Reference make_reference(const Subject& subject) {
  const std::vector<std::string>& outputs = subject.plant.output_names;
  VectorXd start = subject.plant.y_operating;
  for (const auto& [output, value] : subject.spec().reference) {
    start[find_channel(subject, output, "output", outputs, "controller", "reference")] = value;
  }
  std::vector<ReferenceStep> steps;
  const auto& specs = subject.spec().reference_steps;
  for (std::size_t i = 0; i < specs.size(); ++i) {
    steps.push_back(specs[i].step);
    steps.back().output =
        find_channel(subject, specs[i].output, "output", outputs, "reference", "output", i);
    for (std::size_t other = 0; other < i; ++other) {
      if (steps[other].output != steps[i].output || steps[other].at_s < steps[i].at_s) continue;
      throw scenario_error(subject.scenario, "reference", "at_s",
                           fmt::format("reference.at_s: found {} s for \"{}\" after {} s, expected "
                                       "later: steps of one output stand in order of time",
                                       steps[i].at_s, specs[i].output, steps[other].at_s),
                           i);
    }
  }
  return Reference(std::move(start), std::move(steps), subject.sample_time_s);
}

/// The outputs that have a reference.
std::vector<Index> referenced_outputs(const Subject& subject) {
  std::vector<Index> outputs;
  const ControllerSpec& spec = subject.spec();
  for (Index i = 0; i < subject.plant.q(); ++i) {
    const std::string& name = subject.plant.output_names[static_cast<std::size_t>(i)];
    const bool has_steps =
        std::any_of(spec.reference_steps.begin(), spec.reference_steps.end(),
                    [&](const ReferenceStepSpec& step) { return step.output == name; });
    if (has_steps || spec.reference.contains(name)) outputs.push_back(i);
  }
  return outputs;
}

/// All that is ever asked for must be a state of rest.
void check_reference(const Subject& subject, const ObserverLaw& law,
                     const std::vector<Index>& outputs) {
  std::vector<ReferenceStep> steps = law.reference.steps();
  std::stable_sort(steps.begin(), steps.end(),
                   [](const auto& a, const auto& b) { return a.at_s < b.at_s; });
  VectorXd r = law.reference.start() - law.y_operating;
  const auto check = [&](double t_s) {
    const double miss = law.target.miss(law.plant, outputs, r);
    if (miss <= kReferenceTolerance) return;
    const bool is_start = subject.spec().reference.empty();
    throw scenario_error(
        subject.scenario, is_start ? "reference" : "controller", is_start ? "" : "reference",
        fmt::format("reference: found values at {:g} s which the plant cannot hold (missed by "
                    "{:.2g} of them), expected a state of rest: give fewer outputs a reference",
                    t_s, miss),
        is_start ? std::optional<std::size_t>(0) : std::nullopt);
  };
  check(0.0);
  for (const ReferenceStep& step : steps) {
    r[step.output] = step.value - law.y_operating[step.output];
    check(step.at_s);
  }
}

template <class Law>
ControllerMaker maker_of(Law law) {
  if constexpr (std::is_same_v<Law, ControlLaw>) {
    return [law = std::move(law)] { return std::make_unique<StaticFeedback>(law); };
  } else if constexpr (std::is_same_v<Law, ObserverLaw>) {
    return [law = std::move(law)] { return std::make_unique<ObserverFeedback>(law); };
  } else {
    return [law = std::move(law)] { return std::make_unique<Pid>(law); };
  }
}

void plan_open_loop(const Subject& subject, ControllerPlan& plan) {
  ControlLaw law = open_loop(subject.plant, VectorXd::Zero(subject.plant.m()));
  law.base = make_base(subject);
  plan.make = maker_of(std::move(law));
}

void plan_state_feedback(const Subject& subject, ControllerPlan& plan) {
  const Index n = subject.plant.n(), m = subject.plant.m();
  const ControllerSpec& spec = subject.spec();
  if (spec.kind == ControllerKind::kGain) {
    check_shape(subject.scenario, "K", *spec.K, m, n);
    plan.K = *spec.K;
  } else {
    const MatrixXd Q = weight(subject, "Q", spec.Q, n);
    const MatrixXd R = weight(subject, "R", spec.R, m);
    plan.K = lqr_gain(subject.plant, subject.sample_time_s, Q, R);
  }
  ControlLaw law = state_feedback(subject.plant, plan.K, VectorXd::Zero(m));
  law.base = make_base(subject);
  law.reference = make_reference(subject);
  plan.linear = static_controller(-law.gain);
  plan.make = maker_of(std::move(law));
}

MatrixXd observer_K(const Subject& subject, const DiscretePlant& sampled) {
  const Index n = subject.plant.n(), m = subject.plant.m();
  const ControllerSpec& spec = subject.spec();
  if (spec.K) {
    check_shape(subject.scenario, "K", *spec.K, m, n);
    return *spec.K;
  }
  const MatrixXd Q = weight(subject, "Q", spec.Q, n);
  const MatrixXd R = weight(subject, "R", spec.R, m);
  check_stabilisable(sampled, subject.plant.state_names);
  return lqr_gain(sampled.A, sampled.B, Q, R);
}

MatrixXd observer_L(const Subject& subject, const DiscretePlant& sampled) {
  const Index n = subject.plant.n(), q = subject.plant.q();
  const ControllerSpec& spec = subject.spec();
  if (spec.L) {
    check_shape(subject.scenario, "L", *spec.L, n, q);
    check_detectable(sampled, subject.plant.state_names);
    return *spec.L;
  }
  NoiseCovariances covariances = noise_covariances(subject.plant, subject.sample_time_s);
  if (spec.Q_w) covariances.Q_w = weight(subject, "Q_w", spec.Q_w, n);
  if (spec.R_v) covariances.R_v = weight(subject, "R_v", spec.R_v, q);
  return kalman_gain(sampled, covariances, subject.plant.state_names);
}

void plan_observer(const Subject& subject, ControllerPlan& plan) {
  ObserverLaw law;
  law.plant = sample_plant(subject.plant, subject.sample_time_s);
  law.L = plan.L = observer_L(subject, law.plant);
  law.K = plan.K = observer_K(subject, law.plant);
  law.base = make_base(subject);
  law.reference = make_reference(subject);
  law.u_operating = subject.plant.u_operating;
  law.y_operating = subject.plant.y_operating;
  const std::vector<Index> outputs = referenced_outputs(subject);
  law.target = steady_state(law.plant, outputs);
  check_reference(subject, law, outputs);
  plan.observer_poles = poles_of(law.plant.A - law.L * law.plant.C);
  plan.linear = linear_form(law);
  plan.make = maker_of(std::move(law));
}

void plan_pid(const Subject& subject, ControllerPlan& plan) {
  PidLaw law;
  law.sample_time_s = subject.sample_time_s;
  law.base = make_base(subject);
  law.reference = make_reference(subject);
  for (const PidLoopSpec& spec : subject.spec().loops) {
    PidLoop loop = spec.loop;
    loop.output = find_channel(subject, spec.output, "output", subject.plant.output_names,
                               "controller", "loop");
    loop.input =
        find_channel(subject, spec.input, "input", subject.plant.input_names, "controller", "loop");
    for (const PidLoop& other : law.loops) {
      if (other.input != loop.input) continue;
      throw scenario_error(subject.scenario, "controller", "loop",
                           fmt::format("controller.loop: found two loops that move input \"{}\", "
                                       "expected one for each input at most",
                                       spec.input));
    }
    law.loops.push_back(loop);
  }
  plan.linear = linear_form(law);
  plan.make = maker_of(std::move(law));
}

/// What the inputs' signals in the record are; every signal must be an input's.
std::vector<std::optional<std::size_t>> record_columns(const Subject& subject,
                                                       const RecordedSignal& record) {
  const std::vector<std::string>& inputs = subject.plant.input_names;
  std::vector<std::optional<std::size_t>> columns(inputs.size());
  for (const std::string& name : record.names()) {
    const auto at = std::find(inputs.begin(), inputs.end(), name);
    if (at == inputs.end()) {
      const auto near = nearest_name(name, inputs);
      throw InputError(record.source(), {1, 1},
                       fmt::format("found column \"{}\", expected an input of plant \"{}\" ({}){}",
                                   name, subject.plant.name, fmt::join(inputs, ", "),
                                   near ? fmt::format("; did you mean \"{}\"?", *near) : ""));
    }
    columns[static_cast<std::size_t>(at - inputs.begin())] = record.index_of(name);
  }
  return columns;
}

void plan_record(const Subject& subject, ControllerPlan& plan) {
  auto record = std::make_shared<const RecordedSignal>(subject.commands.value().text,
                                                       subject.commands->source);
  auto columns = record_columns(subject, *record);
  if (record->length_s() + subject.sample_time_s < subject.scenario.duration_s) {
    plan.warnings.push_back(
        fmt::format("controller: {} ends after {:g} s, expected {:g} s: the last commands hold",
                    record->source(), record->length_s(), subject.scenario.duration_s));
  }
  plan.make = [record = std::move(record), columns = std::move(columns), base = make_base(subject),
               sample_time_s = subject.sample_time_s] {
    return std::make_unique<RecordedCommands>(record, columns, base, sample_time_s);
  };
}

void plan_kind(const Subject& subject, ControllerPlan& plan) {
  switch (subject.spec().kind) {
    case ControllerKind::kLqr:
    case ControllerKind::kGain:
      return plan_state_feedback(subject, plan);
    case ControllerKind::kObserver:
      return plan_observer(subject, plan);
    case ControllerKind::kPid:
      return plan_pid(subject, plan);
    case ControllerKind::kRecorded:
      return plan_record(subject, plan);
    case ControllerKind::kExternal:
      plan.make = [] { return nullptr; };
      return;
    case ControllerKind::kNone:
      return plan_open_loop(subject, plan);
  }
}

void judge_closed_loop(const Subject& subject, ControllerPlan& plan) {
  if (!plan.linear) return;
  plan.closed_loop_poles =
      closed_loop_poles(sample_plant(subject.plant, subject.sample_time_s), *plan.linear);
  const double radius = std::abs(plan.closed_loop_poles.front());
  if (radius < 1.0 - kPoleTolerance) return;
  plan.warnings.push_back(
      fmt::format("controller: the closed loop has a pole of size {:.6g} per sample about the "
                  "operating point, expected less than 1: it does not come to rest",
                  radius));
}

}  // namespace

std::optional<RunPart> read_commands(const Scenario& scenario) {
  if (scenario.controller.kind != ControllerKind::kRecorded) return std::nullopt;
  const std::filesystem::path& file = scenario.controller.commands;
  std::error_code error;
  if (!std::filesystem::is_regular_file(file, error)) {
    throw scenario_error(
        scenario, "controller", "file",
        fmt::format("controller.file: found no file {}, expected one", file.string()));
  }
  return read_part("commands", file);
}

ControllerPlan plan_controller(const Scenario& scenario, const PlantModel& plant,
                               double sample_time_s, const std::optional<NamedText>& commands) {
  ControllerPlan plan;
  try {
    const Subject subject{scenario, plant, sample_time_s, commands};
    plan_kind(subject, plan);
    judge_closed_loop(subject, plan);
  } catch (const std::invalid_argument& error) {
    throw scenario_error(scenario, "controller", "", fmt::format("controller: {}", error.what()));
  }
  return plan;
}

}  // namespace faultline
