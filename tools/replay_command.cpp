#include <algorithm>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include <unistd.h>

#include <CLI/App.hpp>
#include <CLI/Validators.hpp>
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "tools/bench/verdict_report.h"
#include "tools/cli.h"
#include "tools/replay/log_replay.h"

namespace faultline {
namespace {

using Json = nlohmann::ordered_json;

struct ReplayArguments {
  std::vector<std::string> logs;
  std::string scenario, bank, dbc, output, json;
  bool must_verify = false;
  bool is_quiet = false;
};

/// Problems told in full; of a log that is broken all over, the first ones are enough.
constexpr std::uint64_t kShownProblems = 20;

ReplayOptions options_of(const ReplayArguments& arguments) {
  ReplayOptions options;
  options.logs = arguments.logs;
  if (!arguments.scenario.empty()) options.scenario = arguments.scenario;
  if (!arguments.bank.empty()) options.bank = arguments.bank;
  if (!arguments.dbc.empty()) options.dbc = arguments.dbc;
  if (!arguments.output.empty()) options.output = arguments.output;
  const bool is_terminal = ::isatty(STDERR_FILENO) == 1;
  options.on_problem = [is_terminal, count = std::uint64_t{0}](const std::string& text) mutable {
    if (++count > kShownProblems) return;
    fmt::print(stderr, "{}faultline: {}\n", is_terminal ? "\r\x1b[K" : "", text);
    if (count == kShownProblems) fmt::print(stderr, "faultline: more like these are not shown\n");
  };
  options.is_quiet = arguments.is_quiet;
  return options;
}

void print_verification(std::FILE* out, const Verification& verification) {
  const ResultComparison& comparison = verification.comparison;
  fmt::print(out, "\n  {:<20} {:>10} {:>10} {:>10} {:>15}\n", "results", "recorded", "identical",
             "different", "not verifiable");
  for (std::size_t i = 0; i < kResultChannels; ++i) {
    const auto channel = static_cast<ResultChannel>(i);
    const ResultComparison::Counts& counts = comparison.counts(channel);
    fmt::print(out, "  {:<20} {:>10} {:>10} {:>10} {:>15}\n", result_channel_name(channel),
               counts.recorded, counts.identical, counts.different, counts.unverifiable);
  }
  for (const ResultComparison::CycleRange& range : comparison.unverifiable()) {
    fmt::print(out, "  not verifiable from cycle {} to {}: frames before them are missing\n",
               range.from, range.to);
  }
  const ResultComparison::Counts total = comparison.total();
  if (total.behind_end > 0) {
    fmt::print(out, "  {} results at the end, whose frames had not reached the log yet\n",
               total.behind_end);
  }
  if (total.unrecorded > 0) {
    fmt::print(out, "  {} results of the replay are not in the log\n", total.unrecorded);
  }
  if (!verification.difference.empty()) fmt::print(out, "\n  first difference\n");
  for (const std::string& line : verification.difference) fmt::print(out, "  {}\n", line);
  fmt::print(out, "  {}\n",
             verification.is_verified() ? "VERIFIED: reproduced to the bit"
             : total.different > 0      ? "DIFFERENT"
             : total.identical == 0     ? "NOT VERIFIED: nothing could be compared"
                                        : "NOT VERIFIED as a whole: the log lacks frames");
}

void print_expectations(std::FILE* out, const BankAnswer& answer) {
  if (answer.expectations.empty()) return;
  fmt::print(out, "\n  expectations, bank \"{}\"\n", answer.bank);
  for (const ExpectationOutcome& outcome : answer.expectations) {
    fmt::print(out, "  {}\n", expectation_text(outcome));
  }
}

void print_verdicts(std::FILE* out, const BankAnswer& answer) {
  fmt::print(out, "\n  {:>10}   bank \"{}\" of {}\n", "time, s", answer.bank, answer.source);
  for (const VerdictEntry& entry : answer.verdicts) {
    const std::string detail = verdict_detail(entry);
    fmt::print(out, "  {:>10.3f}   {}{}\n", entry.t_s, verdict_text(entry),
               detail.empty() ? "" : "  (" + detail + ")");
  }
}

/// What was the verdict at t_s; nothing before the first.
std::string verdict_at(const BankAnswer& answer, double t_s) {
  const auto after = std::find_if(answer.verdicts.begin(), answer.verdicts.end(),
                                  [&](const VerdictEntry& entry) { return entry.t_s > t_s; });
  return after == answer.verdicts.begin() ? "" : verdict_text(*std::prev(after));
}

/// A line for each time at which one of them changed its verdict.
void print_side_by_side(std::FILE* out, const BankAnswer& own, const BankAnswer& other) {
  std::vector<double> times_s;
  for (const BankAnswer* answer : {&own, &other}) {
    for (const VerdictEntry& entry : answer->verdicts) times_s.push_back(entry.t_s);
  }
  std::sort(times_s.begin(), times_s.end());
  times_s.erase(std::unique(times_s.begin(), times_s.end()), times_s.end());
  constexpr int kColumn = 36;
  fmt::print(out, "\n  {:>10}   {:<{}} {}\n", "time, s",
             fmt::format("bank \"{}\" of {}", own.bank, own.source), kColumn,
             fmt::format("bank \"{}\" of {}", other.bank, other.source));
  for (const double t_s : times_s) {
    fmt::print(out, "  {:>10.3f}   {:<{}} {}\n", t_s, verdict_at(own, t_s), kColumn,
               verdict_at(other, t_s));
  }
}

/// What TRUTH says that acted, injected live or by the timeline.
void print_faults(std::FILE* out, const RunReplay& run) {
  constexpr std::size_t kMostLines = 20;  // an intermittent fault has hundreds of stretches
  if (!run.faults.empty()) fmt::print(out, "\n  {:>21}   injected\n", "cycles");
  for (std::size_t i = 0; i < std::min(run.faults.size(), kMostLines); ++i) {
    const RecordedFault& fault = run.faults[i];
    const std::string until = fault.until_cycle ? fmt::format("{}", *fault.until_cycle - 1) : "end";
    fmt::print(out, "  {:>10} .. {:>7}   {} {:.6g} on {}\n", fault.from_cycle, until, fault.kind,
               fault.value, fault.target);
  }
  if (run.faults.size() > kMostLines) {
    fmt::print(out, "  and {} more stretches\n", run.faults.size() - kMostLines);
  }
}

void print_run(std::FILE* out, const RunReplay& run, const std::string& log) {
  const BankAnswer& first = run.answers.front();
  fmt::print(out, "{}: {}{} cycles, {} frames{}{}\n", log, run.name.empty() ? "" : run.name + ", ",
             first.samples, run.frames,
             run.missing_frames > 0 ? fmt::format(", {} MISSING", run.missing_frames) : "",
             run.has_ended ? "" : "; the log ends before the run did");
  if (run.answers.size() == 2) {
    print_side_by_side(out, run.answers[0], run.answers[1]);
  } else {
    print_verdicts(out, first);
  }
  print_faults(out, run);
  for (const BankAnswer& answer : run.answers) print_expectations(out, answer);
  if (run.verification) print_verification(out, *run.verification);
}

Json verification_json(const Verification& verification) {
  const ResultComparison& comparison = verification.comparison;
  Json json{{"verified", verification.is_verified()}, {"channels", Json::object()}};
  for (std::size_t i = 0; i < kResultChannels; ++i) {
    const auto channel = static_cast<ResultChannel>(i);
    const ResultComparison::Counts& counts = comparison.counts(channel);
    json["channels"][result_channel_name(channel)] = {
        {"recorded", counts.recorded},      {"identical", counts.identical},
        {"different", counts.different},    {"not_verifiable", counts.unverifiable},
        {"repeated", counts.repeated},      {"behind_end", counts.behind_end},
        {"not_recorded", counts.unrecorded}};
  }
  json["not_verifiable"] = Json::array();
  for (const ResultComparison::CycleRange& range : comparison.unverifiable()) {
    json["not_verifiable"].push_back({{"from_cycle", range.from}, {"to_cycle", range.to}});
  }
  json["first_difference"] = nullptr;
  if (const auto& difference = comparison.first_difference()) {
    json["first_difference"] = {{"channel", result_channel_name(difference->channel)},
                                {"cycle", difference->cycle},
                                {"text", verification.difference}};
  }
  return json;
}

Json answer_json(const BankAnswer& answer) {
  Json json{{"bank", answer.bank},
            {"source", answer.source},
            {"samples", answer.samples},
            {"bad_samples", answer.bad_samples},
            {"resets", answer.resets},
            {"verdicts", Json::array()},
            {"residuals", Json::object()},
            {"expect", {{"met", answer.are_expectations_met()}, {"items", Json::array()}}}};
  for (const VerdictEntry& entry : answer.verdicts) json["verdicts"].push_back(verdict_json(entry));
  for (std::size_t i = 0; i < answer.residuals.size(); ++i) {
    json["residuals"][answer.residuals[i]] = {
        {"first_fired_s", seconds_or_null(answer.first_fired_s[i])}};
  }
  for (const ExpectationOutcome& outcome : answer.expectations) {
    json["expect"]["items"].push_back(expectation_json(outcome));
  }
  return json;
}

Json faults_json(const RunReplay& run) {
  Json faults = Json::array();
  for (const RecordedFault& fault : run.faults) {
    faults.push_back(
        {{"target", fault.target},
         {"kind", fault.kind},
         {"value", fault.value},
         {"from_cycle", fault.from_cycle},
         {"until_cycle", fault.until_cycle ? Json(*fault.until_cycle) : Json(nullptr)}});
  }
  return faults;
}

Json result_json(const ReplayArguments& arguments, const ReplayResult& result) {
  Json json{{"logs", arguments.logs},
            {"wall_s", result.wall_s},
            {"damages", result.damages},
            {"runs", Json::array()}};
  for (const RunReplay& run : result.runs) {
    Json answers = Json::array();
    for (const BankAnswer& answer : run.answers) answers.push_back(answer_json(answer));
    json["runs"].push_back(
        {{"run_id", run.run_id},
         {"scenario", run.name},
         {"frames", run.frames},
         {"missing_frames", run.missing_frames},
         {"ended", run.has_ended},
         {"faults", faults_json(run)},
         {"verification", run.verification ? verification_json(*run.verification) : Json(nullptr)},
         {"answers", std::move(answers)}});
  }
  return json;
}

int answer_of(const ReplayArguments& arguments, const ReplayResult& result) {
  const auto is_yes = [&](const RunReplay& run) {
    if (arguments.must_verify) return run.verification && run.verification->is_verified();
    return run.answers.back().are_expectations_met();
  };
  return std::all_of(result.runs.begin(), result.runs.end(), is_yes) ? kExitYes : kExitNo;
}

int run(const ReplayArguments& arguments) {
  const ReplayOptions options = options_of(arguments);
  const ReplayResult result = replay(options);
  std::FILE* const out = human_output(arguments.json);
  std::uint64_t cycles = 0;
  for (const RunReplay& replayed : result.runs) {
    print_run(out, replayed, arguments.logs.front());
    cycles += replayed.answers.front().samples;
    if (arguments.must_verify && !replayed.verification) {
      fmt::print(out, "  NOT VERIFIED: there are no recorded results of a bank to compare with\n");
    }
  }
  fmt::print(out, "\n  {} cycles in {:.2f} s ({:.0f} per second)\n", cycles, result.wall_s,
             static_cast<double>(cycles) / result.wall_s);
  if (!arguments.json.empty()) write_json(result_json(arguments, result), arguments.json);
  return answer_of(arguments, result);
}

}  // namespace

void add_replay_command(CLI::App& program, int& exit_code) {
  CLI::App* command = program.add_subcommand(
      "replay",
      "Diagnose recorded frames again, as fast as the machine can: with the bank of the log, which "
      "must give the same to the bit, and with another one");
  auto arguments = std::make_shared<ReplayArguments>();
  command
      ->add_option("LOG", arguments->logs,
                   "LCM log of `faultline run` or lcm-logger (of a rotated run all files, in their "
                   "order), or candump log (-: stdin)")
      ->required();
  command->add_flag("--verify", arguments->must_verify,
                    "Fail unless every recorded result is reproduced to the bit");
  command
      ->add_option("--bank", arguments->bank,
                   "What would this bank have said? *.bank.json, or bank.toml to design first")
      ->check(CLI::ExistingFile);
  command
      ->add_option("--scenario", arguments->scenario,
                   "Scenario to read the frames by, for logs that do not carry theirs")
      ->check(CLI::ExistingFile);
  command->add_option("--dbc", arguments->dbc, "DBC to read the frames by; with --bank")
      ->check(CLI::ExistingFile)
      ->needs("--bank");
  command->add_option("--log", arguments->output,
                      "LCM log to write: the frames and what the replay found (with --bank: what "
                      "that bank did). An existing log is replaced");
  command->add_flag("-q,--quiet", arguments->is_quiet, "No progress on stderr");
  add_json_option(*command, arguments->json);
  command->footer(std::string("With --verify the answer is whether everything was reproduced, else "
                              "whether the scenario's expectations are met.\n") +
                  kExitCodesHelp);
  command->callback([arguments, &exit_code] { exit_code = run(*arguments); });
}

}  // namespace faultline
