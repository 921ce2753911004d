// Virtual time, log off: cycles per second of a scenario's bench end to end on one thread, and what
// share of a cycle each part has: plant, controller, codec, sampler, bank, decision; the rest is
// the bus and the wiring. And what the log would add. Every part is timed alone, over the frames
// and samples of the same run, in rounds by turns with the others: the median of the rounds counts.
//
//   cycle_share_benchmark [SCENARIO..]     default: Hou's plant and the three tanks
#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include <fmt/format.h>

#include "diagnosis/runtime/decision.h"
#include "diagnosis/runtime/evaluator.h"
#include "diagnosis/runtime/onset.h"
#include "diagnosis/runtime/residual_bank.h"
#include "drivers/signal/sampler.h"
#include "sim/controller_node.h"
#include "sim/plant_faults.h"
#include "sim/plant_node.h"
#include "tools/bench/bench.h"
#include "tools/bench/endpoints.h"

namespace faultline {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::uint32_t kMostCycles = 20'000;
constexpr int kRounds = 15;

/// What was said on the bus, and the samples made of it.
struct RecordedRun : FrameSink {
  bool send(const CanFrame& frame) noexcept override {
    frames.push_back(frame);
    return true;
  }
  std::vector<CanFrame> frames;
  std::vector<std::size_t> first_of_cycle;
  std::vector<std::vector<double>> y, u, evaluation, thresholds;
};

RecordedRun record(const BenchInputs& inputs, std::uint32_t cycles) {
  RecordedRun run;
  PlantNode plant(inputs.make_plant(), inputs.map, inputs.schedule, inputs.bank.sample_time_s,
                  inputs.x_initial, inputs.perturbations);
  ControllerNode controller(inputs.map, inputs.make_controller());
  Sampler sampler(inputs.map);
  ResidualBank bank(inputs.bank);
  for (std::uint32_t k = 0; k < cycles; ++k) {
    run.first_of_cycle.push_back(run.frames.size());
    plant.on_cycle(k, run);
    for (std::size_t i = run.first_of_cycle.back(), end = run.frames.size(); i < end; ++i) {
      const CanFrame frame = run.frames[i];
      controller.on_frame(frame, run);
    }
    for (std::size_t i = run.first_of_cycle.back(); i < run.frames.size(); ++i) {
      plant.on_frame(run.frames[i]);
      sampler.push(run.frames[i]);
      while (const Sample* sample = sampler.take()) {
        run.y.emplace_back(sample->y.begin(), sample->y.end());
        run.u.emplace_back(sample->u.begin(), sample->u.end());
        bank.step(sample->y, sample->u);
        run.evaluation.emplace_back(bank.evaluation().begin(), bank.evaluation().end());
        run.thresholds.emplace_back(bank.thresholds().begin(), bank.thresholds().end());
      }
    }
  }
  return run;
}

struct Part {
  const char* name;
  std::function<void()> once;  ///< all cycles of the run
  std::vector<double> ns_per_cycle{};

  [[nodiscard]] double median() const {
    std::vector<double> sorted = ns_per_cycle;
    std::nth_element(sorted.begin(), sorted.begin() + kRounds / 2, sorted.end());
    return sorted[kRounds / 2];
  }
};

volatile double g_sink = 0.0;

void run_plant(const BenchInputs& inputs, const RecordedRun& run) {
  const auto plant = inputs.make_plant();
  PerturbationSchedule perturbations = inputs.perturbations;
  ActivePerturbations active = perturbations.none();
  PlantFaults faults(inputs.schedule, inputs.bank.sample_time_s);
  std::vector<double> y(inputs.map.output_names.size()), u(inputs.map.input_names.size());
  plant->reset(inputs.x_initial);
  for (std::size_t k = 0; k < run.u.size(); ++k) {
    const double t_s = static_cast<double>(k) * inputs.bank.sample_time_s;
    faults.advance(t_s);
    perturbations.advance(t_s, active);
    faults.actuate(run.u[k], u);
    const PlantDrive drive{u, faults.components(), active};
    plant->measure(drive, y);
    faults.sense(y);
    plant->step(drive);
  }
  g_sink = y[0];
}

void run_controller(const BenchInputs& inputs, const RecordedRun& run) {
  const auto controller = inputs.make_controller();
  std::vector<double> u(inputs.map.input_names.size());
  for (std::size_t k = 0; k < run.y.size(); ++k) {
    controller->command(static_cast<std::uint32_t>(k), run.y[k], u);
  }
  g_sink = u[0];
}

/// Encoding and protecting every frame once, decoding it once at the node that needs it.
void run_codec(const BenchInputs& inputs, const RecordedRun& run) {
  std::vector<double> y(inputs.map.output_names.size()), u(inputs.map.input_names.size());
  std::vector<MessageProtector> sensors = protectors(inputs.map.sensor_messages);
  std::vector<MessageProtector> commands = protectors(inputs.map.command_messages);
  MessageAssembler measured(inputs.map.sensor_messages, y.size());
  MessageAssembler commanded(inputs.map.command_messages, u.size());
  CanFrame frame;
  for (std::size_t k = 0; k < run.y.size(); ++k) {
    const auto cycle = static_cast<std::uint32_t>(k);
    if (inputs.map.sync) inputs.map.sync->encode(cycle, cycle, frame);
    for (std::size_t i = 0; i < sensors.size(); ++i) {
      inputs.map.sensor_messages[i].encode(run.y[k], cycle, frame);
      sensors[i].protect(frame);
      static_cast<void>(measured.push(frame, cycle));
    }
    for (std::size_t i = 0; i < commands.size(); ++i) {
      inputs.map.command_messages[i].encode(run.u[k], cycle, frame);
      commands[i].protect(frame);
      static_cast<void>(commanded.push(frame, cycle));
    }
  }
  g_sink = static_cast<double>(frame.data[0]);
}

void run_sampler(const BenchInputs& inputs, const RecordedRun& run) {
  Sampler sampler(inputs.map);
  for (const CanFrame& frame : run.frames) {
    sampler.push(frame);
    while (const Sample* sample = sampler.take()) g_sink = sample->y[0];
  }
}

void run_bank(const BenchInputs& inputs, const RecordedRun& run) {
  ResidualBank bank(inputs.bank);
  for (std::size_t k = 0; k < run.y.size(); ++k) bank.step(run.y[k], run.u[k]);
  g_sink = bank.residual()[0];
}

void run_decision(const BenchInputs& inputs, const RecordedRun& run) {
  Evaluator evaluator(inputs.bank);
  const DecisionTable table(inputs.bank);
  Settling settling(inputs.bank.decision, evaluator.signature().size());
  OnsetTracker onset(evaluator.signature().size());
  for (std::size_t k = 0; k < run.y.size(); ++k) {
    evaluator.step(run.evaluation[k], run.thresholds[k]);
    settling.step(table.decide(evaluator.signature(), evaluator.persistent()),
                  evaluator.signature());
    g_sink =
        static_cast<double>(onset.step(settling, evaluator, static_cast<std::uint32_t>(k)).cycle);
  }
}

/// The loop bus alone: every frame sent by its node and read by those who need it, cycle by cycle.
void run_bus(const BenchInputs& inputs, const RecordedRun& run) {
  const Endpoints buses = open_endpoints("loop", inputs.map);
  std::array<CanFrame, 64> batch;
  std::size_t next = 0;
  for (std::size_t k = 0; k < run.first_of_cycle.size(); ++k) {
    const bool is_last = k + 1 == run.first_of_cycle.size();
    const std::size_t end = is_last ? run.frames.size() : run.first_of_cycle[k + 1];
    const std::size_t measured = 1 + inputs.map.sensor_messages.size();
    for (std::size_t i = 0; next < end; ++next, ++i) {
      (i < measured ? buses.plant : buses.controller)->send(run.frames[next]);
    }
    for (CanBus* bus : {buses.plant.get(), buses.controller.get(), buses.diagnosis.get()}) {
      g_sink = static_cast<double>(bus->receive(batch, std::chrono::nanoseconds(0)).count);
    }
  }
}

/// What keeps the summary: verdicts, delays, expectations.
void run_history(const BenchInputs& inputs, const RecordedRun& run) {
  const DecisionTable table(inputs.bank);
  RunHistory history(inputs.bank, table.sets(), inputs.scenario, inputs.schedule);
  DiagnosisRecord record(inputs.bank);
  record.decision.verdict = Verdict::kHealthy;
  for (std::size_t k = 0; k < run.y.size(); ++k) {
    record.cycle = static_cast<std::uint32_t>(k);
    history.on_record(record);
  }
  g_sink = static_cast<double>(history.samples());
}

void run_whole(const BenchInputs& inputs, bool has_log) {
  BenchOptions options;
  options.bus = "loop";
  const std::filesystem::path log =
      std::filesystem::temp_directory_path() / "faultline-cycle-share.lcm";
  if (has_log) options.log = log;
  g_sink = static_cast<double>(run_bench(inputs, options).counters.cycles);
  if (has_log) std::filesystem::remove(log);
}

void measure(const std::filesystem::path& scenario) {
  BenchInputs inputs = load_bench_inputs(scenario);
  const double cycles_wanted = inputs.scenario.duration_s / inputs.bank.sample_time_s;
  const auto cycles = static_cast<std::uint32_t>(std::min<double>(kMostCycles, cycles_wanted)) + 1;
  inputs.scenario.duration_s = (cycles - 1) * inputs.bank.sample_time_s;
  const RecordedRun run = record(inputs, cycles);
  std::vector<Part> parts{{"whole, no log", [&] { run_whole(inputs, false); }},
                          {"whole, log", [&] { run_whole(inputs, true); }},
                          {"plant", [&] { run_plant(inputs, run); }},
                          {"controller", [&] { run_controller(inputs, run); }},
                          {"codec", [&] { run_codec(inputs, run); }},
                          {"sampler", [&] { run_sampler(inputs, run); }},
                          {"bank", [&] { run_bank(inputs, run); }},
                          {"decision", [&] { run_decision(inputs, run); }},
                          {"loop bus", [&] { run_bus(inputs, run); }},
                          {"history", [&] { run_history(inputs, run); }}};
  for (Part& part : parts) part.once();  // warm
  for (int round = 0; round < kRounds; ++round) {
    for (Part& part : parts) {
      const auto begin = Clock::now();
      part.once();
      const std::chrono::duration<double, std::nano> took = Clock::now() - begin;
      part.ns_per_cycle.push_back(took.count() / cycles);
    }
  }
  const double whole = parts[0].median();
  fmt::print("{} ({} cycles): {:.0f} cycles/s without a log, {:.0f} with\n", scenario.string(),
             cycles, 1e9 / whole, 1e9 / parts[1].median());
  double known = 0.0;
  for (std::size_t i = 2; i < parts.size(); ++i) {
    const double ns = parts[i].median();
    known += ns;
    fmt::print("  {:<12}{:8.0f} ns {:5.1f} %\n", parts[i].name, ns, 100.0 * ns / whole);
  }
  fmt::print("  {:<12}{:8.0f} ns {:5.1f} %   wiring, records\n", "rest", whole - known,
             100.0 * (whole - known) / whole);
  fmt::print("  {:<12}{:8.0f} ns {:+5.1f} %   on top\n", "log", parts[1].median() - whole,
             100.0 * (parts[1].median() - whole) / whole);
}

}  // namespace
}  // namespace faultline

int main(int argc, char** argv) {
  const std::filesystem::path examples = FAULTLINE_EXAMPLES_DIR;
  std::vector<std::filesystem::path> scenarios(argv + 1, argv + argc);
  if (scenarios.empty()) {
    scenarios = {examples / "hou2015" / "fig13.toml", examples / "three_tank" / "healthy.toml"};
  }
  try {
    for (const std::filesystem::path& scenario : scenarios) faultline::measure(scenario);
  } catch (const std::exception& error) {
    fmt::print(stderr, "cycle_share_benchmark: {}\n", error.what());
    return 1;
  }
  return 0;
}
