#include <charconv>
#include <cstdio>
#include <iostream>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <unistd.h>

#include <CLI/App.hpp>
#include <CLI/Validators.hpp>
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "drivers/can/open_bus.h"
#include "drivers/dbc/dbc_parser.h"
#include "tools/bench/latency_table.h"
#include "tools/can/bus_session.h"
#include "tools/can/problem_report.h"
#include "tools/cli.h"
#include "tools/lcm/lcm_url.h"
#include "tools/replay/playback.h"

namespace faultline {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::string_view kLcmPrefix = "lcm:";
/// A silence that is worth a remark.
constexpr double kLongSilence_s = 10.0;

struct PlayArguments {
  std::string bus, dbc, json;
  PlaybackSelection selection;
  PlaybackOptions options;
  bool is_stepped = false;
  bool is_quiet = false;
};

/// Progress on stderr: on a terminal one line kept up to date, elsewhere long silences only.
class PlaybackView {
 public:
  explicit PlaybackView(const PlaybackLog& log) : log_(&log) {}

  void show(const PlaybackProgress& progress) {
    const double length_s = static_cast<double>(log_->outline().last_ns) * 1e-9;
    const std::string pass =
        progress.pass > 1 ? fmt::format(", pass {}", progress.pass) : std::string();
    const std::string silence = progress.silence_s > kLongSilence_s
                                    ? fmt::format(", the next in {:.0f} s", progress.silence_s)
                                    : std::string();
    if (is_terminal_) {
      fmt::print(stderr, "\r\x1b[K  {:8.2f} / {:.2f} s  {} sent{}{}", progress.at_s, length_s,
                 progress.sent, pass, silence);
    } else if (!silence.empty() && !was_silent_) {
      fmt::print(stderr, "  {:8.2f} / {:.2f} s{}{}\n", progress.at_s, length_s, pass, silence);
    }
    was_silent_ = !silence.empty();
  }
  void clear() const {
    if (is_terminal_) fmt::print(stderr, "\r\x1b[K");
  }

 private:
  const PlaybackLog* log_;
  bool is_terminal_ = ::isatty(STDERR_FILENO) == 1;
  bool was_silent_ = false;
};

const char* unit_of(const PlayArguments& arguments) {
  return arguments.selection.is_as_messages ? "messages" : "frames";
}

/// Asks on stdin how many steps to take.
class StepQuestion {
 public:
  /// @return 0: no more. @throws std::invalid_argument there is nobody to ask.
  std::uint64_t ask() {
    for (;;) {
      if (::isatty(STDIN_FILENO) == 1) {
        fmt::print(stderr, "Enter: the next; a number: so many; q: quit > ");
      }
      std::string line;
      if (!std::getline(std::cin, line)) {
        if (is_first_) {
          throw std::invalid_argument(
              "--step: found the end of stdin, expected Enter, a number or q on it");
        }
        return 0;
      }
      is_first_ = false;
      if (line.ends_with('\r')) line.pop_back();
      if (line.empty()) return 1;
      if (line == "q") return 0;
      std::uint64_t count = 0;
      const auto [end, error] = std::from_chars(line.data(), line.data() + line.size(), count);
      if (error == std::errc() && end == line.data() + line.size() && count > 0) return count;
      fmt::print(stderr, "faultline: stdin: found \"{}\", expected Enter, a number or q\n", line);
    }
  }

 private:
  bool is_first_ = true;
};

std::unique_ptr<PlaybackTarget> open_target(const PlayArguments& arguments) {
  return arguments.selection.is_as_messages
             ? open_lcm_target(arguments.bus.substr(kLcmPrefix.size()))
             : open_bus_target(arguments.bus);
}

void print_result(const PlayArguments& arguments, const PlaybackLog& log,
                  const PlaybackTarget& target, const PlaybackResult& result) {
  std::FILE* const out = human_output(arguments.json);
  const PlaybackOutline& outline = log.outline();
  fmt::print(out, "{} to {}: {} {} sent in {:.2f} s, {} refused", arguments.selection.log,
             arguments.bus, result.sent, unit_of(arguments), result.wall_s, result.refused);
  if (arguments.options.passes != 1) fmt::print(out, "; {} passes", result.passes);
  fmt::print(out, "\n{}",
             latency_table({{.stage = "sent - deadline", .histogram = result.lateness}}));
  if (result.lateness.count() > 0) {
    fmt::print(out, "  {} of {} sends later than 1 ms\n", result.late, result.lateness.count());
  }
  if (outline.backwards > 0) {
    fmt::print(out, "  {} {} with a stamp before the one before: sent at once\n", outline.backwards,
               unit_of(arguments));
  }
  if (outline.error_frames > 0) {
    fmt::print(out, "  {} error frames are the controller's own and were not sent\n",
               outline.error_frames);
  }
  if (result.refused > 0) fmt::print(out, "  REFUSED  {}\n", target.refusal());
  for (const std::string& problem : result.realtime_problems) {
    fmt::print(out, "  WARNING  {}\n", problem);
  }
  if (result.signal != 0) fmt::print(out, "  STOPPED by signal {}\n", result.signal);
}

Json result_json(const PlayArguments& arguments, const PlaybackLog& log,
                 const PlaybackResult& result) {
  const PlaybackSelection& selection = arguments.selection;
  return {
      {"log", selection.log},
      {"bus", arguments.bus},
      {"unit", unit_of(arguments)},
      {"speed", arguments.options.speed},
      {"from_s", selection.from_s},
      {"to_s", selection.to_s ? Json(*selection.to_s) : Json(nullptr)},
      {"sent", result.sent},
      {"refused", result.refused},
      {"passes", result.passes},
      {"backwards", log.outline().backwards},
      {"error_frames", log.outline().error_frames},
      {"late", result.late},
      {"timing_error",
       result.lateness.count() == 0
           ? Json(nullptr)
           : latency_json({{.stage = "sent - deadline", .histogram = result.lateness}}).front()},
      {"wall_s", result.wall_s},
      {"realtime_problems", result.realtime_problems},
      {"interrupted", result.signal != 0}};
}

int run_play(PlayArguments arguments) {
  PlaybackSelection& selection = arguments.selection;
  selection.is_as_messages = arguments.bus.starts_with(kLcmPrefix);
  if (selection.is_as_messages) {
    check_lcm_url(std::string_view(arguments.bus).substr(kLcmPrefix.size()));
  } else {
    check_bus_names(arguments.bus);
    selection.buses = short_bus_names(arguments.bus);
    if (!selection.channels.empty()) {
      throw std::invalid_argument(
          fmt::format("--channel: found it with --bus {}, expected --bus lcm:URL: a bus takes "
                      "frames, of FAULTLINE_CAN alone",
                      arguments.bus));
    }
  }
  if (!arguments.dbc.empty()) {
    selection.dbc = std::make_shared<const DbcDatabase>(read_dbc(arguments.dbc));
  }
  ProblemReport problems;
  const PlaybackLog log(selection, [&problems](const std::string& text) { problems.add(text); });
  static_cast<void>(problems.exit_code());  // says how many more there are: no reason not to play
  if (arguments.options.passes != 1 && log.period_ns() == 0) {
    throw std::invalid_argument(fmt::format(
        "--loop: found only one time in {}, expected two, or --to for the length of a pass",
        selection.log));
  }
  const std::unique_ptr<PlaybackTarget> target = open_target(arguments);
  PlaybackView view(log);
  const auto show = [&](const PlaybackProgress& progress) {
    if (!arguments.is_quiet) view.show(progress);
  };
  PlaybackResult result;
  if (arguments.is_stepped) {
    StepQuestion question;
    result = play_stepwise(
        log, *target, arguments.options, [&question] { return question.ask(); },
        [&](const PlaybackProgress& progress) {
          fmt::print(stderr, "  {:12.6f} s  {} {} sent\n", progress.at_s, progress.sent,
                     unit_of(arguments));
        });
  } else {
    result = play(log, *target, arguments.options, show);
    if (!arguments.is_quiet) view.clear();
  }
  print_result(arguments, log, *target, result);
  if (!arguments.json.empty()) write_json(result_json(arguments, log, result), arguments.json);
  if (result.signal != 0) return kExitSignal + result.signal;
  return result.refused > 0 ? kExitFailure : kExitYes;
}

}  // namespace

void add_play_command(CLI::App& program, int& exit_code) {
  CLI::App* command = program.add_subcommand(
      "play", "Send what a log holds again, each at its own time, and say how well it was kept");
  auto arguments = std::make_shared<PlayArguments>();
  PlaybackSelection& selection = arguments->selection;
  command->add_option("LOG", selection.log, "LCM log, candump log, or CSV of signals (with --dbc)")
      ->required()
      ->check(CLI::ExistingFile);
  command
      ->add_option("--bus", arguments->bus,
                   "can:IFACE, udp:GROUP:PORT (the log's CAN frames; several with commas: bus i of "
                   "the log to the i-th, or by name), or lcm:URL (its messages)")
      ->required();
  command
      ->add_option("--speed", arguments->options.speed,
                   "So many times as fast; 0: as fast as the bus takes it")
      ->check(CLI::NonNegativeNumber)
      ->check(check_finite)
      ->capture_default_str();
  command
      ->add_option("--from", selection.from_s,
                   "Begin so many seconds behind the log's begin; FAULTLINE_RUN comes all the same")
      ->check(CLI::NonNegativeNumber)
      ->check(check_finite)
      ->capture_default_str();
  command->add_option("--to", selection.to_s, "End there; default: the log's end")
      ->check(CLI::PositiveNumber)
      ->check(check_finite);
  command
      ->add_option("--loop", arguments->options.passes,
                   "Play it so many times over; without a number until SIGINT")
      ->expected(0, 1)
      ->check(CLI::PositiveNumber);
  command->add_option("--channel", selection.channels, "lcm: only this channel; repeat for more")
      ->allow_extra_args(false);
  command->add_flag("--step", arguments->is_stepped,
                    "Send one time's frames or messages at each Enter on stdin; a number: so many; "
                    "q: quit");
  command->add_option("--dbc", arguments->dbc, "DBC file, to read a CSV of signals by")
      ->check(CLI::ExistingFile);
  command->add_flag("-q,--quiet", arguments->is_quiet, "No progress on stderr");
  add_json_option(*command, arguments->json);
  command->footer(
      "Silences of the log are kept; a stamp before the one before is sent at once.\n"
      "Exit codes: 0 all was sent; 2 bad input or usage; 3 the bus refused some of it, or a bus, a "
      "file or LCM failed; 130 interrupted.");
  command->callback([arguments, command, &exit_code] {
    // `--loop` without a number: no value came.
    const CLI::Option* const loop = command->get_option("--loop");
    if (loop->count() > 0 && loop->results().front().empty()) arguments->options.passes = 0;
    exit_code = run_play(*arguments);
  });
}

}  // namespace faultline
