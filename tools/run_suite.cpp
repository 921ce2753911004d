#include "tools/run_suite.h"

#include <chrono>
#include <cstdlib>
#include <optional>
#include <utility>

#include <unistd.h>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "tools/bench/junit_report.h"
#include "tools/bench/run_summary.h"
#include "tools/bench/stop_signal.h"
#include "tools/bench/suite_table.h"
#include "tools/cli.h"
#include "tools/error_answer.h"
#include "tools/interruptible_load.h"

namespace faultline {
namespace {

using Json = nlohmann::ordered_json;
using std::chrono::steady_clock;

double seconds_since(steady_clock::time_point start) {
  return std::chrono::duration<double>(steady_clock::now() - start).count();
}

/// Progress on stderr: on a terminal a line that is kept up to date, elsewhere one per scenario.
class SuiteProgress {
 public:
  SuiteProgress(std::size_t count, bool is_quiet) : count_(count), is_quiet_(is_quiet) {}

  void begin(const std::string& name) {
    name_ = name;
    ++number_;
    show("designing");
  }
  void show(const std::string& text) const {
    if (is_terminal_) write(fmt::format("\r\x1b[K  [{}/{}] {}  {}", number_, count_, name_, text));
  }
  void end(const ScenarioOutcome& outcome) const {
    if (is_terminal_) {
      clear();
    } else {
      write(fmt::format("  [{}/{}] {}  {}\n", number_, count_, outcome.name,
                        status_name(outcome.status())));
    }
  }
  void clear() const {
    if (is_terminal_) write("\r\x1b[K");
  }

 private:
  void write(const std::string& text) const {
    if (!is_quiet_) std::fputs(text.c_str(), stderr);
  }

  std::size_t count_;
  bool is_quiet_;
  bool is_terminal_ = ::isatty(STDERR_FILENO) == 1;
  std::size_t number_ = 0;
  std::string name_;
};

/// The runs of a suite, one after the other.
class Suite {
 public:
  Suite(std::size_t count, const SuiteOptions& options)
      : options_(&options), progress_(count, options.is_quiet) {}

  void run(const std::filesystem::path& file) {
    ScenarioOutcome outcome{.file = file, .name = file.stem().string()};
    Json summary;
    const auto start = steady_clock::now();
    progress_.begin(outcome.name);
    try {
      auto inputs = load_until_signal(file, stop_);
      if (!inputs) {
        is_loading_ = true;
        progress_.clear();
        return;
      }
      run_loaded(*inputs, outcome, summary);
    } catch (...) {
      const ErrorAnswer answer = answer_current_exception();
      outcome.error = answer.text;
      outcome.exit_code = answer.exit_code;
    }
    outcome.wall_s = seconds_since(start);
    progress_.end(outcome);
    add_json(outcome, std::move(summary));
    outcomes_.push_back(std::move(outcome));
  }

  [[nodiscard]] int signal() { return stop_.poll(); }
  /// A signal came while a scenario was read or its bank designed, on a thread that still runs.
  [[nodiscard]] bool is_loading() const noexcept { return is_loading_; }
  [[nodiscard]] const std::vector<ScenarioOutcome>& outcomes() const noexcept { return outcomes_; }
  [[nodiscard]] const Json& json() const noexcept { return json_; }

 private:
  void run_loaded(BenchInputs& inputs, ScenarioOutcome& outcome, Json& summary) {
    outcome.name = inputs.scenario.name;
    BenchOptions bench = options_->bench_options(inputs);
    bench.on_progress = [&](double t_s, double duration_s, const std::string& verdict) {
      progress_.show(fmt::format("{:.2f} / {:.2f} s  {}", t_s, duration_s, verdict));
    };
    bench.on_warning = [&](const std::string& text) {
      progress_.clear();
      fmt::print(stderr, "faultline: warning: {}: {}\n", outcome.name, text);
    };
    outcome.result = run_bench(inputs, bench);
    outcome.error = early_end_text(*outcome.result);
    outcome.exit_code = exit_code_of(*outcome.result);
    summary = summary_json(inputs, bench, *outcome.result);
  }

  void add_json(const ScenarioOutcome& outcome, Json summary) {
    Json entry{{"file", outcome.file.string()},
               {"name", outcome.name},
               {"status", status_name(outcome.status())},
               {"exit_code", outcome.exit_code},
               {"wall_s", outcome.wall_s},
               {"error", outcome.error.empty() ? Json(nullptr) : Json(outcome.error)},
               {"summary", std::move(summary)}};
    json_.push_back(std::move(entry));
  }

  const SuiteOptions* options_;
  StopSignal stop_;
  SuiteProgress progress_;
  std::vector<ScenarioOutcome> outcomes_;
  Json json_ = Json::array();
  bool is_loading_ = false;
};

/// Bad input first: it is for the user to mend. Then what failed, then what was not met.
int exit_code_of_all(const std::vector<ScenarioOutcome>& outcomes) {
  int exit_code = kExitYes;
  for (const int worse : {kExitNo, kExitFailure, kExitBadInput}) {
    for (const ScenarioOutcome& outcome : outcomes) {
      if (outcome.exit_code == worse) exit_code = worse;
    }
  }
  return exit_code;
}

Json tally_json(const std::vector<ScenarioOutcome>& outcomes) {
  const SuiteTally tally = tally_of(outcomes);
  return {{"scenarios", outcomes.size()},       {"met", tally.met},
          {"not_met", tally.not_met},           {"stopped", tally.stopped},
          {"interrupted", tally.interrupted},   {"not_run", tally.not_run},
          {"expectations", tally.expectations}, {"expectations_met", tally.expectations_met}};
}

}  // namespace

std::string early_end_text(const BenchResult& result) {
  if (result.is_interrupted) return fmt::format("stopped by signal {}", result.signal);
  return result.stop_reason ? "stopped: " + result.stop_reason->text : "";
}

int exit_code_of(const BenchResult& result) {
  if (result.is_interrupted) return kExitSignal + result.signal;
  if (result.stop_reason) {
    return result.stop_reason->kind == StopReason::Kind::kPlant ? kExitNo : kExitFailure;
  }
  return result.history.are_expectations_met() ? kExitYes : kExitNo;
}

void write_junit(const std::vector<ScenarioOutcome>& outcomes, const std::string& target) {
  const std::string xml = junit_xml(outcomes);
  write_to(target, [&](std::FILE* file) { std::fwrite(xml.data(), 1, xml.size(), file); });
}

int run_suite(const std::vector<std::filesystem::path>& files, const SuiteOptions& options) {
  Suite suite(files.size(), options);
  for (const std::filesystem::path& file : files) {
    suite.run(file);
    if (suite.signal() != 0) break;
  }
  const bool has_data_on_stdout = options.json == "-" || options.junit == "-";
  std::FILE* const out = has_data_on_stdout ? stderr : stdout;
  fmt::print(out, "{}", suite_table(suite.outcomes(), style_of(out)));
  const std::size_t left = files.size() - suite.outcomes().size();
  const int signal = suite.signal();
  if (signal != 0) fmt::print(out, "  STOPPED by signal {}, {} not begun\n", signal, left);
  if (!options.json.empty()) {
    write_json({{"scenarios", suite.json()},
                {"total", tally_json(suite.outcomes())},
                {"interrupted", signal != 0},
                {"not_begun", left}},
               options.json);
  }
  if (!options.junit.empty()) write_junit(suite.outcomes(), options.junit);
  if (signal == 0) return exit_code_of_all(suite.outcomes());
  if (suite.is_loading()) {
    std::fflush(nullptr);
    std::_Exit(kExitSignal + signal);  // the design has no end that could be waited for
  }
  return kExitSignal + signal;
}

}  // namespace faultline
