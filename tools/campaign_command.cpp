#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include <unistd.h>

#include <CLI/App.hpp>
#include <CLI/Validators.hpp>
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "diagnosis/model/input_error.h"
#include "tools/bench/bench.h"
#include "tools/bench/run_summary.h"
#include "tools/bench/scenario_outcome.h"
#include "tools/campaign/campaign.h"
#include "tools/campaign/campaign_run.h"
#include "tools/cli.h"
#include "tools/report_command.h"
#include "tools/run_suite.h"

namespace faultline {
namespace {

using Json = nlohmann::ordered_json;

/// More than this is mostly a slip of the pen: a day and a half of two cores.
constexpr std::uint64_t kMostRuns = 10'000'000;

struct CampaignArguments {
  std::string sweep, database, bank, csv, json, shard, log, report;
  std::optional<std::uint64_t> run;
  std::uint64_t max_runs = kMostRuns;
  unsigned threads = 0;
  bool is_quiet = false;
};

Shard parse_shard(const std::string& text) {
  Shard shard;
  if (text.empty()) return shard;
  int end = 0;
  const int read = std::sscanf(text.c_str(), "%9lu/%9lu%n", &shard.index, &shard.count, &end);
  if (read == 2 && static_cast<std::size_t>(end) == text.size() && shard.index >= 1 &&
      shard.index <= shard.count) {
    return shard;
  }
  throw std::invalid_argument(
      fmt::format("--shard: found \"{}\", expected I/N with I from 1 to N, e.g. 1/8", text));
}

std::string duration_text(double seconds) {
  constexpr double kYear_s = 365.25 * 86400.0;
  if (seconds >= kYear_s) return fmt::format("{:.3g} years", seconds / kYear_s);
  if (seconds >= 2 * 86400.0) return fmt::format("{:.1f} days", seconds / 86400.0);
  const auto s = static_cast<std::int64_t>(std::ceil(seconds));
  if (s >= 3600) return fmt::format("{}:{:02}:{:02} h", s / 3600, s / 60 % 60, s % 60);
  return fmt::format("{}:{:02} min", s / 60, s % 60);
}

/// What a slip of the pen would cost, said before it does.
void check_size(const CampaignInputs& inputs, const CampaignArguments& arguments,
                unsigned threads) {
  const Sweep& sweep = inputs.sweep();
  if (sweep.run_count <= arguments.max_runs) return;
  const auto start = std::chrono::steady_clock::now();
  static_cast<void>(run_point(inputs, 0));
  const double run_s =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  std::string count = fmt::format("{}", sweep.run_count);
  if (sweep.run_count == std::numeric_limits<std::uint64_t>::max()) {
    count = "more than " + count;
  }
  throw InputError(sweep.file.string(), {},
                   fmt::format("found {} runs, about {} on {} threads, expected at most {}: choose "
                               "fewer steps, or sampling = \"latin_hypercube\", or say --max-runs",
                               count,
                               duration_text(run_s * static_cast<double>(sweep.run_count) /
                                             static_cast<double>(threads)),
                               threads, arguments.max_runs));
}

/// One line kept up to date on a terminal; elsewhere a line now and then.
class CampaignBar {
 public:
  void show(const CampaignProgress& progress) {
    const double share = progress.total == 0 ? 1.0
                                             : static_cast<double>(progress.done) /
                                                   static_cast<double>(progress.total);
    if (!is_terminal_ && progress.wall_s < next_s_ && progress.done < progress.total) return;
    next_s_ = progress.wall_s + std::max(10.0, progress.wall_s / 5.0);
    const double left = static_cast<double>(progress.total - progress.done);
    std::string text =
        fmt::format("  {}/{} runs, {:.0f} %, {:.0f} runs/s", progress.done, progress.total,
                    std::floor(100.0 * share), progress.rate_per_s());
    if (progress.rate_per_s() > 0.0 && left > 0.0) {
      text += fmt::format(", {} left", duration_text(left / progress.rate_per_s()));
    }
    std::fputs(
        is_terminal_ ? fmt::format("\r\x1b[K{}", text).c_str() : fmt::format("{}\n", text).c_str(),
        stderr);
  }
  void clear() const {
    if (is_terminal_) std::fputs("\r\x1b[K", stderr);
  }

 private:
  bool is_terminal_ = ::isatty(STDERR_FILENO) == 1;
  double next_s_ = 0.0;
};

std::string csv_cell(const Cell& cell) {
  if (const auto* integer = std::get_if<std::int64_t>(&cell)) return fmt::format("{}", *integer);
  if (const auto* number = std::get_if<double>(&cell)) return fmt::format("{}", *number);
  const auto* text = std::get_if<std::string>(&cell);
  if (text == nullptr) return "";
  if (text->find_first_of(",\"\r\n") == std::string::npos) return *text;
  std::string quoted = "\"";
  for (const char c : *text) quoted += c == '"' ? "\"\"" : std::string(1, c);
  return quoted + '"';
}

void write_csv(const CampaignDatabase& database, const std::string& target) {
  write_to(target, [&](std::FILE* out) {
    std::string line;
    for (const RunColumn& column : kRunColumns) {
      line += fmt::format("{}{}", line.empty() ? "" : ",", column.name);
    }
    fmt::print(out, "{}\n", line);
    constexpr std::uint64_t kBatch = 4096;
    for (std::uint64_t from = 0;;) {
      const auto rows = database.rows(from, kBatch);
      for (const CampaignRow& row : rows) {
        line.clear();
        for (std::size_t i = 0; i < row.size(); ++i) line += (i > 0 ? "," : "") + csv_cell(row[i]);
        fmt::print(out, "{}\n", line);
      }
      if (rows.size() < kBatch) return;
      from = static_cast<std::uint64_t>(std::get<std::int64_t>(rows.back().front())) + 1;
    }
  });
}

std::string percent(std::uint64_t part, std::uint64_t whole) {
  return whole == 0 ? "-"
                    : fmt::format("{:.1f} %",
                                  100.0 * static_cast<double>(part) / static_cast<double>(whole));
}

void print_tally(std::FILE* out, const CampaignTally& tally, const std::string& sweep) {
  fmt::print(out, "  faults      {} runs with one: detected {}, isolated {}\n", tally.faulty,
             percent(tally.detected, tally.faulty), percent(tally.isolated, tally.faulty));
  fmt::print(out, "  no fault    {} false alarm{} in {:.3g} h\n", tally.false_alarms,
             tally.false_alarms == 1 ? "" : "s", tally.faultless_h);
  if (tally.not_met > 0) {
    fmt::print(out, "  NOT MET     expectations of {} runs, the first is run {}\n", tally.not_met,
               tally.first_not_met);
  }
  if (tally.failed > 0) {
    fmt::print(out, "  FAILED      {} runs, the first is run {}: {}\n", tally.failed,
               tally.first_failed, tally.first_error);
  }
  const std::int64_t first = tally.failed > 0 ? tally.first_failed : tally.first_not_met;
  if (first >= 0) {
    fmt::print(out, "              alone, with its log: faultline campaign {} --run {}\n", sweep,
               first);
  }
}

Json tally_json(const CampaignTally& tally) {
  return {{"runs", tally.runs},
          {"failed", tally.failed},
          {"not_met", tally.not_met},
          {"faulty", tally.faulty},
          {"detected", tally.detected},
          {"isolated", tally.isolated},
          {"false_alarms", tally.false_alarms},
          {"faultless_h", tally.faultless_h}};
}

/// One run of a campaign as `faultline run` does it, with its log.
int run_alone(const CampaignArguments& arguments, const CampaignInputs& campaign) {
  const Sweep& sweep = campaign.sweep();
  if (*arguments.run >= sweep.run_count) {
    throw std::invalid_argument(fmt::format("--run: found {}, expected a run of {}: 0 to {}",
                                            *arguments.run, sweep.file.string(),
                                            sweep.run_count - 1));
  }
  const BenchInputs inputs = campaign.inputs(sweep.point(*arguments.run));
  BenchOptions options;
  options.bus = "loop";
  options.log = arguments.log.empty() ? fmt::format("{}-run{}.lcm", sweep.name, *arguments.run)
                                      : arguments.log;
  const BenchResult result = run_bench(inputs, options);
  print_summary(human_output(arguments.json), inputs, options, result);
  if (!arguments.json.empty()) write_json(summary_json(inputs, options, result), arguments.json);
  if (!arguments.report.empty()) write_report({{options.log->string()}}, arguments.report);
  return exit_code_of(result);
}

int finish(const CampaignArguments& arguments, const CampaignInputs& inputs,
           const CampaignDatabase& database, const std::string& file,
           const CampaignResult& result) {
  const CampaignTally tally = database.tally();
  std::FILE* const out = human_output(arguments.json == "-" ? arguments.json : arguments.csv);
  const CampaignProgress& progress = result.progress;
  fmt::print(out, "{}: {} of {} runs in {}\n", inputs.sweep().name, tally.runs,
             inputs.sweep().run_count, file);
  fmt::print(out, "  now         {} runs in {:.1f} s, {:.0f} runs/s\n", progress.done_here,
             progress.wall_s, progress.rate_per_s());
  print_tally(out, tally, arguments.sweep);
  if (!arguments.csv.empty()) write_csv(database, arguments.csv);
  if (!arguments.json.empty()) {
    Json json = tally_json(tally);
    json["campaign"] = inputs.sweep().name;
    json["digest"] = inputs.digest();
    json["run_count"] = inputs.sweep().run_count;
    json["runs_now"] = progress.done_here;
    json["wall_s"] = progress.wall_s;
    write_json(json, arguments.json);
  }
  if (result.signal != 0) {
    fmt::print(stderr, "faultline: stopped by a signal; the same command goes on from here\n");
    return kExitSignal + result.signal;
  }
  return tally.failed > 0 || tally.not_met > 0 ? kExitNo : kExitYes;
}

int run_as_rank_0(const CampaignArguments& arguments, unsigned threads, RankLink* link) {
  const CampaignInputs inputs(Sweep::read(arguments.sweep), arguments.bank);
  if (arguments.run) return run_alone(arguments, inputs);
  const unsigned all = threads * static_cast<unsigned>(link == nullptr ? 1 : link->size());
  check_size(inputs, arguments, all);
  CampaignOptions options;
  options.threads = threads;
  options.shard = parse_shard(arguments.shard);
  std::string file = arguments.database;
  if (file.empty()) {
    file = std::filesystem::path(arguments.sweep).stem().string();
    if (options.shard.count > 1) {
      file += fmt::format("-{}of{}", options.shard.index, options.shard.count);
    }
    file += ".db";
  }
  CampaignDatabase database(file, inputs);
  CampaignBar bar;
  if (!arguments.is_quiet) {
    options.on_progress = [&bar](const CampaignProgress& progress) { bar.show(progress); };
  }
  const CampaignResult result = run_campaign(inputs, database, options, link);
  bar.clear();
  return finish(arguments, inputs, database, file, result);
}

int run_as_other_rank(const CampaignArguments& arguments, unsigned threads, RankLink& link) {
  try {
    const CampaignInputs inputs(Sweep::read(arguments.sweep), arguments.bank);
    serve_campaign(inputs, threads, link);
    return kExitYes;
  } catch (const InputError&) {
    // Rank 0 has the same files and says what is wrong; then MPI ends this rank.
    std::this_thread::sleep_for(std::chrono::seconds(5));
    throw;
  }
}

int run(const CampaignArguments& arguments) {
  if (arguments.sweep.empty()) {
    throw std::invalid_argument("SWEEP: found none, expected a sweep file (.toml), or `merge`");
  }
  static_cast<void>(parse_shard(arguments.shard));
  const std::unique_ptr<RankLink> link = RankLink::open();
  unsigned threads = arguments.threads;
  if (threads == 0) threads = link ? 1 : std::max(1U, std::thread::hardware_concurrency());
  const int exit_code = link && link->rank() > 0 ? run_as_other_rank(arguments, threads, *link)
                                                 : run_as_rank_0(arguments, threads, link.get());
  if (link) link->close();
  return exit_code;
}

int merge(const std::vector<std::string>& files) {
  std::vector<CampaignDatabase> parts;
  for (std::size_t i = 1; i < files.size(); ++i) {
    parts.emplace_back(files[i]);
    if (parts.back().identity().digest == parts.front().identity().digest) continue;
    throw InputError(
        files[i], {},
        fmt::format("found campaign \"{}\" with digest {}, expected \"{}\" with {}, "
                    "that of {}",
                    parts.back().identity().name, parts.back().identity().digest,
                    parts.front().identity().name, parts.front().identity().digest, files[1]));
  }
  CampaignDatabase merged(files.front(), parts.front());
  constexpr std::uint64_t kBatch = 10'000;
  try {
    for (const CampaignDatabase& part : parts) {
      for (std::uint64_t from = 0;;) {
        const auto rows = part.rows(from, kBatch);
        merged.insert(rows);
        if (rows.size() < kBatch) break;
        from = static_cast<std::uint64_t>(std::get<std::int64_t>(rows.back().front())) + 1;
      }
    }
  } catch (...) {
    std::error_code error;
    std::filesystem::remove(files.front(), error);
    throw;
  }
  const CampaignTally tally = merged.tally();
  fmt::print("{}: {} of {} runs in {}\n", merged.identity().name, tally.runs,
             merged.identity().run_count, files.front());
  print_tally(stdout, tally, "SWEEP");
  return kExitYes;
}

}  // namespace

void add_campaign_command(CLI::App& program, int& exit_code) {
  CLI::App* command = program.add_subcommand(
      "campaign",
      "Run a scenario with ranges: thousands of runs, a row each in an SQLite database");
  auto arguments = std::make_shared<CampaignArguments>();
  command->add_option("SWEEP", arguments->sweep, "Sweep file (.toml): docs/campaigns.md");
  command
      ->add_option("-o,--output", arguments->database,
                   "Database; default: the sweep's name with .db, here. One that is there is "
                   "completed: only what is missing is run")
      ->type_name("F.db");
  command->add_option("--bank", arguments->bank,
                      "This bank (.toml or .bank.json) instead of the scenario's, to compare them");
  command
      ->add_option("-j,--threads", arguments->threads,
                   "Threads; default: one per core, under mpirun one per rank")
      ->check(CLI::Range(1, 1024));
  auto* shard = command->add_option(
      "--shard", arguments->shard,
      "Only part I of N: for machines without MPI, e.g. --shard "
      "$SLURM_ARRAY_TASK_ID/$SLURM_ARRAY_TASK_COUNT; then `faultline campaign merge`");
  shard->type_name("I/N");
  auto* run_option = command->add_option(
      "--run", arguments->run, "Run this one alone, with its log, as `faultline run` does");
  run_option->excludes(shard);
  command->add_option("--log", arguments->log, "Log of --run; default: NAME-runN.lcm")
      ->needs(run_option);
  command->add_option("--report", arguments->report, "Page of --run (`faultline report`)")
      ->needs(run_option)
      ->type_name("F.html");
  command
      ->add_option("--csv", arguments->csv, "Also write all rows as CSV, to file F or - (stdout)")
      ->type_name("F|-");
  command->add_option("--max-runs", arguments->max_runs, "Refuse a sweep of more runs")
      ->check(CLI::Range(std::uint64_t{1}, std::uint64_t{1'000'000'000}))
      ->capture_default_str();
  command->add_flag("-q,--quiet", arguments->is_quiet, "No progress on stderr");
  add_json_option(*command, arguments->json);
  command->footer(kExitCodesHelp);

  auto files = std::make_shared<std::vector<std::string>>();
  CLI::App* merging = command->add_subcommand(
      "merge",
      "Put the databases of shards together: faultline campaign merge OUT.db A.db B.db ..");
  merging->add_option("FILES", *files, "The database to make, then those of the shards")
      ->required()
      ->expected(2, -1);
  merging->footer(kExitCodesHelp);
  merging->callback([files, &exit_code] { exit_code = merge(*files); });
  command->callback([command, arguments, &exit_code] {
    if (command->get_subcommands().empty()) exit_code = run(*arguments);
  });
}

}  // namespace faultline
