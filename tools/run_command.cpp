#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <unistd.h>

#include <CLI/App.hpp>
#include <CLI/Validators.hpp>
#include <fmt/chrono.h>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <nlohmann/json.hpp>

#include "tools/allocation_count.h"
#include "tools/bench/bench.h"
#include "tools/bench/endpoints.h"
#include "tools/bench/run_summary.h"
#include "tools/bench/scenario_files.h"
#include "tools/bench/stop_signal.h"
#include "tools/can/bus_session.h"
#include "tools/cli.h"
#include "tools/error_answer.h"
#include "tools/interruptible_load.h"
#include "tools/report_command.h"
#include "tools/run_suite.h"

namespace faultline {
namespace {

const std::map<std::string, OverrunPolicy> kOverrunPolicies{{"catch-up", OverrunPolicy::kCatchUp},
                                                            {"skip", OverrunPolicy::kSkip},
                                                            {"stop", OverrunPolicy::kStop}};

struct RunArguments {
  std::vector<std::string> scenarios;
  std::string plant_library, bus, log, log_folder, json, junit, lcm_url, report;
  double log_split_MB = 0.0, log_split_s = 0.0;
  std::size_t log_keep = 0;
  bool is_realtime = false;
  std::string overrun = "catch-up";
  int priority = 80;
  std::optional<int> cpu;
  bool has_probe = false;
  bool has_no_log = false;
  bool is_quiet = false;
};

/// Live progress on stderr: one line kept up to date on a terminal, elsewhere a line per change of
/// the verdict. Nobody reading it does not stop the run.
class Progress {
 public:
  void show(double t_s, double duration_s, const std::string& verdict) {
    if (is_terminal_) {
      write(fmt::format("\r\x1b[K  {:8.2f} / {:.2f} s  {}", t_s, duration_s, verdict));
    } else if (verdict != last_verdict_) {
      write(fmt::format("  {:8.2f} / {:.2f} s  {}\n", t_s, duration_s, verdict));
    }
    last_verdict_ = verdict;
  }
  void clear() const {
    if (is_terminal_) write("\r\x1b[K");
  }

 private:
  static void write(const std::string& text) { std::fputs(text.c_str(), stderr); }

  bool is_terminal_ = ::isatty(STDERR_FILENO) == 1;
  std::string last_verdict_;
};

/// `name` with everything that a file name had better not contain replaced.
std::string as_file_name(std::string name) {
  constexpr std::string_view kPlain =
      "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-.";
  for (char& character : name) {
    if (kPlain.find(character) == std::string_view::npos) character = '_';
  }
  constexpr std::size_t kMaxLength = 100;  // leaves room for date and number: names end at 255
  name.resize(std::min(name.size(), kMaxLength));
  return name;
}

/// ./faultline-logs/NAME-20261122T140112.lcm: a new file for each run.
std::filesystem::path default_log(const std::string& scenario_name) {
  const std::filesystem::path folder = "faultline-logs";
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) {
    throw OutputError(fmt::format("cannot make folder {} for the log: {} (--log FILE or --no-log)",
                                  folder.string(), error.message()));
  }
  const std::string stem = fmt::format("{}-{:%Y%m%dT%H%M%S}", as_file_name(scenario_name),
                                       fmt::localtime(std::time(nullptr)));
  std::filesystem::path file = folder / (stem + ".lcm");
  for (int i = 2; std::filesystem::exists(file); ++i) {
    file = folder / fmt::format("{}-{}.lcm", stem, i);
  }
  return file;
}

/// FOLDER/NAME.lcm, or FOLDER/NAME-2.lcm if another scenario of this suite has the name too.
std::filesystem::path log_in(const std::filesystem::path& folder, const std::string& scenario_name,
                             std::set<std::string>& taken) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) {
    throw OutputError(
        fmt::format("cannot make folder {} for the logs: {}", folder.string(), error.message()));
  }
  const std::string stem = as_file_name(scenario_name);
  std::string name = stem;
  for (int i = 2; !taken.insert(name).second; ++i) name = fmt::format("{}-{}", stem, i);
  return folder / (name + ".lcm");
}

LogSplit log_split(const RunArguments& arguments) {
  LogSplit split;
  split.bytes = static_cast<std::uint64_t>(arguments.log_split_MB * 1e6);
  split.time_us = std::llround(arguments.log_split_s * 1e6);
  split.keep = arguments.log_keep;
  if (split.keep > 0 && !split.is_wanted()) {
    throw std::invalid_argument(
        "--log-keep: found neither --log-split-size nor --log-split-time, expected one");
  }
  return split;
}

/// The files of the log that a run wrote.
std::vector<std::string> log_files(const BenchOptions& options) {
  if (!options.log_split.is_wanted()) return {options.log->string()};
  std::vector<std::string> files;
  const std::string stem = options.log->stem().string() + "-";
  const std::filesystem::path folder =
      options.log->has_parent_path() ? options.log->parent_path() : std::filesystem::path(".");
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    const std::string name = entry.path().filename().string();
    const bool is_of_run = name.rfind(stem, 0) == 0 &&
                           entry.path().extension() == options.log->extension() &&
                           name.find_first_not_of("0123456789", stem.size()) ==
                               name.size() - options.log->extension().string().size();
    if (is_of_run) files.push_back(entry.path().string());
  }
  std::sort(files.begin(), files.end());
  return files;
}

/// All but where the log goes and who is told. Adds to the parts what the run alone knows.
BenchOptions bench_options(const RunArguments& arguments, BenchInputs& inputs) {
  BenchOptions options;
  options.bus = arguments.bus.empty() ? inputs.scenario.bus : arguments.bus;
  options.is_realtime = arguments.is_realtime;
  options.overrun = kOverrunPolicies.at(arguments.overrun);
  options.priority = arguments.priority;
  options.cpu = arguments.cpu;
  options.has_probe = arguments.has_probe;
  options.thread_allocations = &thread_allocations;
  const std::vector<std::string> buses = short_bus_names(options.bus);
  if (buses.size() > 1) {
    inputs.parts.push_back({"buses", "buses", fmt::format("{}\n", fmt::join(buses, "\n"))});
  }
  if (!arguments.lcm_url.empty()) options.lcm_url = arguments.lcm_url;
  options.log_split = log_split(arguments);
  return options;
}

int run_one(const RunArguments& arguments, ScenarioOutcome& outcome) {
  StopSignal stop;
  std::optional<BenchInputs> loaded =
      load_until_signal(arguments.scenarios.front(), stop, arguments.plant_library);
  if (!loaded || stop.poll() != 0) {
    fmt::print(stderr,
               "faultline: {}: stopped by signal {} while its files were read and its bank "
               "designed: nothing was run, no report is written\n",
               arguments.scenarios.front(), stop.poll());
    std::fflush(nullptr);
    std::_Exit(kExitSignal + stop.poll());  // the design has no end that could be waited for
  }
  BenchInputs& inputs = *loaded;
  BenchOptions options = bench_options(arguments, inputs);
  std::set<std::string> taken;
  if (!arguments.log.empty()) {
    options.log = arguments.log;
  } else if (!arguments.log_folder.empty()) {
    options.log = log_in(arguments.log_folder, inputs.scenario.name, taken);
  } else if (!arguments.has_no_log) {
    options.log = default_log(inputs.scenario.name);
  }
  Progress progress;
  if (!arguments.is_quiet) {
    options.on_progress = [&progress](double t_s, double duration_s, const std::string& verdict) {
      progress.show(t_s, duration_s, verdict);
    };
  }
  options.on_warning = [&progress](const std::string& text) {
    progress.clear();
    fmt::print(stderr, "faultline: warning: {}\n", text);
  };
  BenchResult result = run_bench(inputs, options);
  if (!arguments.is_quiet) progress.clear();
  print_summary(human_output(arguments.json == "-" ? arguments.json : arguments.junit), inputs,
                options, result);
  if (!arguments.json.empty()) write_json(summary_json(inputs, options, result), arguments.json);
  if (!arguments.report.empty()) write_report({log_files(options)}, arguments.report);
  outcome.name = inputs.scenario.name;
  outcome.error = early_end_text(result);
  outcome.exit_code = exit_code_of(result);
  outcome.wall_s = result.wall_s;
  outcome.result = std::move(result);
  if (!arguments.junit.empty()) write_junit({outcome}, arguments.junit);
  return outcome.exit_code;
}

/// A scenario alone. One that cannot be run is in the JUnit report too.
int run_one(const RunArguments& arguments) {
  ScenarioOutcome outcome{.file = arguments.scenarios.front()};
  outcome.name = outcome.file.stem().string();
  try {
    return run_one(arguments, outcome);
  } catch (const OutputError&) {
    throw;  // of a report, perhaps of this one
  } catch (...) {
    const ErrorAnswer answer = answer_current_exception();
    outcome.error = answer.text;
    outcome.exit_code = answer.exit_code;
    if (!arguments.junit.empty()) write_junit({outcome}, arguments.junit);
    throw;
  }
}

/// Several scenarios: logs are written only where they are asked for.
int run_several(const RunArguments& arguments) {
  const auto files = find_scenarios(arguments.scenarios);
  if (!arguments.log.empty()) {
    throw std::invalid_argument(
        "--log: found it with several scenarios, expected --log-dir, a folder for their logs");
  }
  if (!arguments.report.empty()) {
    throw std::invalid_argument("--report: found it with several scenarios, expected one");
  }
  std::set<std::string> taken;
  SuiteOptions options;
  options.bench_options = [&](BenchInputs& inputs) {
    BenchOptions bench = bench_options(arguments, inputs);
    if (!arguments.log_folder.empty()) {
      bench.log = log_in(arguments.log_folder, inputs.scenario.name, taken);
    }
    return bench;
  };
  options.is_quiet = arguments.is_quiet;
  options.json = arguments.json;
  options.junit = arguments.junit;
  return run_suite(files, options);
}

int run(const RunArguments& arguments) {
  if (arguments.json == "-" && arguments.junit == "-") {
    throw std::invalid_argument("--junit: found - with --json -, expected a file for one of them");
  }
  static_cast<void>(log_split(arguments));
  const bool is_one = arguments.scenarios.size() == 1 &&
                      !std::filesystem::is_directory(arguments.scenarios.front());
  if (!is_one && !arguments.plant_library.empty()) {
    throw std::invalid_argument(
        "--plant-lib: found it with several scenarios, expected one: each has a plant of its own");
  }
  return is_one ? run_one(arguments) : run_several(arguments);
}

}  // namespace

void add_run_command(CLI::App& program, int& exit_code) {
  CLI::App* command = program.add_subcommand(
      "run", "Run scenarios: plant, controller and diagnosis on one bus; write an LCM log");
  auto arguments = std::make_shared<RunArguments>();
  command
      ->add_option("SCENARIO", arguments->scenarios,
                   "Scenario files (.toml), or folders: all scenarios in them and below. Several "
                   "run one after the other and give one table")
      ->required()
      ->check(CLI::ExistingPath);
  command->add_option(
      "--plant-lib", arguments->plant_library,
      "Simulate the plant in this shared library (my.so), whatever the scenario says");
  command->add_option("--bus", arguments->bus,
                      fmt::format("{}; default: the scenario's, else loop", kBusNamesHelp));
  auto* realtime = command->add_flag(
      "--realtime", arguments->is_realtime,
      "Cycles at absolute deadlines; default: lock-step, as fast as the machine can");
  command
      ->add_option("--overrun", arguments->overrun,
                   "A cycle a whole period late: catch-up (it and the next follow at once), skip "
                   "(simulated but not sent), stop (the run ends, exit code 3)")
      ->check(CLI::IsMember({"catch-up", "skip", "stop"}))
      ->capture_default_str()
      ->needs(realtime);
  command
      ->add_option("--priority", arguments->priority,
                   "SCHED_FIFO priority of the diagnosis thread; 0: ordinary scheduling")
      ->check(CLI::Range(0, 99))
      ->capture_default_str()
      ->needs(realtime);
  command->add_option("--cpu", arguments->cpu, "CPU of the diagnosis thread; default: any")
      ->check(CLI::Range(0, 1023))
      ->needs(realtime);
  command
      ->add_flag("--probe", arguments->has_probe,
                 "Also time a thread that only reads the bus, to compare the diagnosis with")
      ->needs(realtime);
  auto* log = command->add_option(
      "--log", arguments->log,
      "LCM log to write; default: a new file in ./faultline-logs. An existing log is replaced");
  auto* split_size = command->add_option(
      "--log-split-size", arguments->log_split_MB,
      "Go on in a new file before one gets longer than so many MB: NAME-0001.lcm, NAME-0002.lcm, "
      "..; each can be read alone, `faultline log` takes them all");
  auto* split_time =
      command->add_option("--log-split-time", arguments->log_split_s,
                          "Go on in a new file once one spans so many seconds of bench time");
  auto* keep = command->add_option("--log-keep", arguments->log_keep,
                                   "Keep the newest N of these files, delete older ones; default: "
                                   "keep all");
  keep->type_name("N")->check(CLI::PositiveNumber);
  split_size->type_name("MB")->check(CLI::Range(1e-3, 1e9));
  split_time->type_name("S")->check(CLI::Range(1e-3, 1e9));
  auto* folder = command->add_option(
      "--log-dir", arguments->log_folder,
      "Folder for logs, each called as its scenario; of several scenarios none is written without");
  folder->excludes(log);
  auto* no_log = command->add_flag("--no-log", arguments->has_no_log, "Write no log");
  auto* report = command->add_option("--report", arguments->report,
                                     "Also make a page of the run, from its log (`faultline "
                                     "report`)");
  report->type_name("F.html");
  for (CLI::Option* option : {log, folder, split_size, split_time, keep, report}) {
    no_log->excludes(option);
  }
  command->add_option("--lcm", arguments->lcm_url,
                      "Also publish live, e.g. udpm://239.255.76.67:7667?ttl=0");
  command->add_flag("-q,--quiet", arguments->is_quiet, "No progress on stderr");
  add_json_option(*command, arguments->json);
  command
      ->add_option("--junit", arguments->junit,
                   "Also give the expectations as test cases in JUnit XML: to file F, or - for "
                   "stdout")
      ->type_name("F|-");
  command->footer(kExitCodesHelp);
  command->callback([arguments, &exit_code] { exit_code = run(*arguments); });
}

}  // namespace faultline
