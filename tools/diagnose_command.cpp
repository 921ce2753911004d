#include <chrono>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>

#include <CLI/App.hpp>
#include <CLI/Validators.hpp>
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "drivers/can/open_bus.h"
#include "tools/bench/bench_inputs.h"
#include "tools/bench/endpoints.h"
#include "tools/bench/lcm_diagnosis.h"
#include "tools/bench/live_diagnosis.h"
#include "tools/bench/message_silence.h"
#include "tools/bench/run_summary.h"
#include "tools/bench/stop_signal.h"
#include "tools/bench/verdict_report.h"
#include "tools/can/bus_session.h"
#include "tools/cli.h"
#include "tools/lcm/lcm_url.h"

namespace faultline {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::string_view kLcmPrefix = "lcm:";
constexpr char kListenedChannels[] = "FAULTLINE_(RUN|CAN|STATS)";
/// Longest wait for a message: a signal, or the end, is noticed that late.
constexpr std::chrono::milliseconds kWait{50};

struct DiagnoseArguments {
  std::string scenario, from, bank, dbc, log, lcm_url, json;
  SessionLimits limits;
  bool is_quiet = false;
};

/// What a person and --json get to know of the diagnoses as they go on and end.
class Report {
 public:
  explicit Report(const DiagnoseArguments& arguments)
      : arguments_(&arguments), out_(human_output(arguments.json)) {}

  /// Sinks and log of the next diagnosis: the n-th one's log is NAME-n.lcm.
  LiveDiagnosisOutput open_output() {
    ++opened_;
    LiveDiagnosisOutput output;
    if (!arguments_->lcm_url.empty()) output.live = open_live(arguments_->lcm_url);
    if (!arguments_->log.empty()) {
      log_ = arguments_->log;
      if (opened_ > 1) {
        log_.replace_filename(
            fmt::format("{}-{}{}", log_.stem().string(), opened_, log_.extension().string()));
      }
      output.log = open_log(log_);
    }
    if (!arguments_->is_quiet) {
      output.on_verdict = [this](const VerdictEntry& entry) { show(entry); };
    }
    return output;
  }

  void on_end(const LiveDiagnosis& diagnosis) {
    const RunCounters& counters = diagnosis.counters();
    samples_ += counters.samples;
    fmt::print(out_, "{} from {}: {} samples, {} bad; {} frames, {} missing\n",
               diagnosis.inputs().name, arguments_->from, counters.samples, counters.bad_samples,
               counters.frames_received, counters.frames_dropped);
    if (!diagnosis.history().verdicts().empty()) {
      const VerdictEntry& last = diagnosis.history().verdicts().back();
      const std::string detail = verdict_detail(last);
      fmt::print(out_, "  at last  {}{}\n", verdict_text(last),
                 detail.empty() ? "" : "; " + detail);
    }
    print_integrity(out_, diagnosis.inputs().map, diagnosis.messages());
    print_dbc_warnings(out_, diagnosis.inputs().dbc_warnings);
    if (!log_.empty()) fmt::print(out_, "  log      {}\n", log_.string());
    std::fflush(out_);
    if (!arguments_->json.empty()) runs_.push_back(run_json(diagnosis));
  }

  /// What is missed, or back.
  void show(const std::string& text) const {
    if (arguments_->is_quiet) return;
    fmt::print(out_, "  {:>8}    {}\n", "", text);
    std::fflush(out_);
  }

  static void tell(const std::string& text) { fmt::print(stderr, "faultline: {}\n", text); }

  [[nodiscard]] std::uint64_t samples() const noexcept { return samples_; }
  [[nodiscard]] const Json& runs() const noexcept { return runs_; }

 private:
  void show(VerdictEntry entry) const {
    entry.no_estimate.clear();  // there is one in a moment, or the summary says why not
    const std::string detail = verdict_detail(entry);
    fmt::print(out_, "  {:8.2f} s  {}{}\n", entry.t_s, verdict_text(entry),
               detail.empty() ? "" : "; " + detail);
    std::fflush(out_);
  }

  [[nodiscard]] Json run_json(const LiveDiagnosis& diagnosis) const {
    const RunCounters& counters = diagnosis.counters();
    const DiagnosisInputs& inputs = diagnosis.inputs();
    Json json{
        {"name", inputs.name},
        {"samples", counters.samples},
        {"bad_samples", counters.bad_samples},
        {"resets", counters.resets},
        {"frames", {{"received", counters.frames_received}, {"missing", counters.frames_dropped}}}};
    json["verdicts"] = Json::array();
    for (const VerdictEntry& entry : diagnosis.history().verdicts()) {
      json["verdicts"].push_back(verdict_json(entry));
    }
    json["residuals"] = Json::object();
    for (std::size_t i = 0; i < inputs.bank.filters.size(); ++i) {
      json["residuals"][inputs.bank.filters[i].name] = {
          {"first_fired_s", seconds_or_null(diagnosis.history().first_fired_s()[i])}};
    }
    json["messages"] = Json::array();
    const std::vector<MessageCounters> messages = diagnosis.messages();
    for (std::size_t i = 0; i < messages.size(); ++i) {
      json["messages"].push_back(message_json(inputs.map.message_name(i), messages[i]));
    }
    json["log"] = log_.empty() ? Json(nullptr) : Json(log_.string());
    return json;
  }

  const DiagnoseArguments* arguments_;
  std::FILE* out_;
  std::filesystem::path log_;
  int opened_ = 0;
  std::uint64_t samples_ = 0;
  Json runs_ = Json::array();
};

Json sequence_json(const LcmDiagnosis& diagnosis) {
  const FrameSequenceCounters& counters = diagnosis.sequence();
  return {{"messages", counters.messages},
          {"lost_messages", counters.lost_messages},
          {"missing_frames", counters.missing_frames},
          {"malformed_frames", counters.malformed_frames},
          {"malformed_messages", counters.malformed_messages},
          {"late_messages", counters.late_messages},
          {"repeated_messages", counters.repeated_messages},
          {"restarts", counters.restarts},
          {"undecodable", diagnosis.undecodable()},
          {"forgotten_frames", diagnosis.forgotten_frames()}};
}

void tell_losses(const LcmDiagnosis& diagnosis) {
  const Json counters = sequence_json(diagnosis);
  std::string text;
  for (const auto& [name, count] : counters.items()) {
    if (name != "messages" && count != 0) text += fmt::format(" {}={}", name, count.dump());
  }
  if (!text.empty()) Report::tell(fmt::format("not all that was sent could be used:{}", text));
}

/// When a session over LCM ends.
class Deadline {
 public:
  explicit Deadline(const SessionLimits& limits) : limits_(limits) {}
  void on_activity() { last_activity_ = Clock::now(); }
  [[nodiscard]] bool is_over() const {
    const auto now = Clock::now();
    using Seconds = std::chrono::duration<double>;
    return (limits_.seconds && now - begin_ >= Seconds(*limits_.seconds)) ||
           (limits_.idle_s && now - last_activity_ >= Seconds(*limits_.idle_s));
  }

 private:
  using Clock = std::chrono::steady_clock;
  SessionLimits limits_;
  Clock::time_point begin_ = Clock::now(), last_activity_ = begin_;
};

Json listen_to_lcm(const DiagnoseArguments& arguments, std::optional<DiagnosisInputs> inputs,
                   Report& report) {
  const std::string url = arguments.from.substr(kLcmPrefix.size());
  LcmSource source(url, kListenedChannels);
  LcmDiagnosis diagnosis({.source = arguments.from,
                          .given = std::move(inputs),
                          .open_output = [&report] { return report.open_output(); },
                          .on_end = [&report](const LiveDiagnosis& run) { report.on_end(run); },
                          .tell = Report::tell});
  if (diagnosis.is_waiting_for_run()) {
    Report::tell(fmt::format(
        "waiting for FAULTLINE_RUN on {}; a live run repeats it every 5 s; or give SCENARIO", url));
  }
  StopSignal stop;
  Deadline deadline(arguments.limits);
  std::uint64_t messages = 0;
  while (stop.poll() == 0 && !deadline.is_over()) {
    source.receive(kWait,
                   [&diagnosis](const LiveMessage& message) { diagnosis.on_message(message); });
    diagnosis.attend();
    if (diagnosis.sequence().messages != messages) deadline.on_activity();
    messages = diagnosis.sequence().messages;
  }
  diagnosis.finish();
  tell_losses(diagnosis);
  if (diagnosis.is_waiting_for_run()) {
    Report::tell(
        fmt::format("no diagnosis: found {} messages with frames on {} and no whole "
                    "FAULTLINE_RUN, expected both, or SCENARIO",
                    messages, url));
  }
  return sequence_json(diagnosis);
}

Json listen_to_bus(const DiagnoseArguments& arguments, DiagnosisInputs inputs, Report& report) {
  BusSession session(split_bus_names(arguments.from));
  session.set_filters(inputs.map.filters());
  // Nobody says when the unit on the bus began.
  inputs.is_initial_state_known = false;
  LiveDiagnosis diagnosis(std::move(inputs), report.open_output(), 0);
  std::uint64_t count = 0, outages = 0;
  MessageSilence silence(diagnosis.inputs().map, all_messages(diagnosis.inputs().map),
                         std::chrono::duration_cast<std::chrono::nanoseconds>(
                             std::chrono::duration<double>(diagnosis.inputs().bank.sample_time_s)));
  session.listen(
      arguments.limits,
      [&](const CanFrame& frame) {
        silence.count(frame);
        // A frame that the socket dropped has a number, too.
        diagnosis.on_frame(frame, count++ + session.counters().dropped);
      },
      [&] {
        const std::uint64_t outages_now = session.counters().outages;
        if (count > 0 && outages_now != outages) {
          diagnosis.tell("error", "bus",
                         fmt::format("{} was down, {} times so far", arguments.from, outages_now));
        }
        outages = outages_now;
        for (const MessageSilence::Report& missed :
             silence.look(std::chrono::steady_clock::now())) {
          diagnosis.tell_now(missed.is_back ? "info" : "warning", "watchdog", missed.text);
          report.show(missed.text);
        }
        diagnosis.attend();
      });
  diagnosis.finish();
  report.on_end(diagnosis);
  const BusCounters counters = session.counters();
  Report::tell(counters_text(counters));
  return {{"received", counters.received},   {"dropped", counters.dropped},
          {"malformed", counters.malformed}, {"error_frames", counters.error_frames},
          {"bus_offs", counters.bus_offs},   {"restarts", counters.restarts},
          {"outages", counters.outages},     {"backlog_drops", session.backlog_drops()},
          {"silences", silence.silences()}};
}

std::optional<DiagnosisInputs> given_inputs(const DiagnoseArguments& arguments) {
  if (!arguments.scenario.empty()) {
    BenchInputs inputs = load_bench_inputs(arguments.scenario);
    return std::move(static_cast<DiagnosisInputs&>(inputs));
  }
  if (arguments.bank.empty()) return std::nullopt;
  return make_diagnosis_inputs(load_bank_file(arguments.bank), read_part("dbc", arguments.dbc),
                               arguments.dbc);
}

int diagnose(const DiagnoseArguments& arguments) {
  const bool is_lcm = arguments.from.starts_with(kLcmPrefix);
  if (is_lcm) {
    const std::string_view url = std::string_view(arguments.from).substr(kLcmPrefix.size());
    check_live_lcm_url(url);
    if (!arguments.lcm_url.empty()) {
      check_lcm_url(arguments.lcm_url);
      if (is_same_lcm_place(url, arguments.lcm_url)) {
        throw std::invalid_argument(fmt::format(
            "--lcm: found {}, the place that --from listens to, expected another: its messages "
            "and ours would mix",
            arguments.lcm_url));
      }
    }
  } else if (!is_bus_name(arguments.from)) {
    throw std::invalid_argument(
        fmt::format("--from: found \"{}\", expected lcm:URL, can:IFACE, udp:GROUP:PORT or several "
                    "buses with commas between them",
                    arguments.from));
  }
  std::optional<DiagnosisInputs> inputs = given_inputs(arguments);
  if (!is_lcm && !inputs) {
    throw std::invalid_argument(
        "--from a bus: found neither SCENARIO nor --bank and --dbc, expected one of them: frames "
        "alone do not say what they mean");
  }
  Report report(arguments);
  const Json counters = is_lcm ? listen_to_lcm(arguments, std::move(inputs), report)
                               : listen_to_bus(arguments, std::move(*inputs), report);
  if (!arguments.json.empty()) {
    write_json(Json{{"from", arguments.from},
                    {"samples", report.samples()},
                    {"runs", report.runs()},
                    {is_lcm ? "lcm" : "bus", counters}},
               arguments.json);
  }
  return report.samples() > 0 ? kExitYes : kExitNo;
}

}  // namespace

void add_diagnose_command(CLI::App& program, int& exit_code) {
  CLI::App* command = program.add_subcommand(
      "diagnose", "Listen to a bus, or to a run over live LCM, and diagnose what it shows");
  auto arguments = std::make_shared<DiagnoseArguments>();
  auto* scenario =
      command
          ->add_option(
              "SCENARIO", arguments->scenario,
              "Scenario file (.toml) with bank and DBC; default: what FAULTLINE_RUN carries")
          ->check(CLI::ExistingFile);
  command
      ->add_option(
          "--from", arguments->from,
          "lcm:URL (FAULTLINE_RUN and FAULTLINE_CAN), can:IFACE, udp:GROUP:PORT or several "
          "buses with commas between them")
      ->required();
  auto* bank = command
                   ->add_option("--bank", arguments->bank,
                                "Bank (.bank.json, or .toml to design); channels bear the names of "
                                "the DBC's signals")
                   ->check(CLI::ExistingFile)
                   ->excludes(scenario);
  auto* dbc = command->add_option("--dbc", arguments->dbc, "DBC file, with --bank")
                  ->check(CLI::ExistingFile)
                  ->excludes(scenario);
  bank->needs(dbc);
  dbc->needs(bank);
  command->add_option("--log", arguments->log,
                      "LCM log to write; default: none. A second run's goes to NAME-2.lcm");
  command->add_option(
      "--lcm", arguments->lcm_url,
      "Also publish live, elsewhere than --from, e.g. udpm://239.255.76.68:7667?ttl=0");
  command->add_option("--for", arguments->limits.seconds, "End after so many seconds")
      ->check(CLI::PositiveNumber)
      ->check(check_finite);
  command
      ->add_option("--idle", arguments->limits.idle_s,
                   "End when no frame came for so many seconds; default: never")
      ->check(CLI::PositiveNumber)
      ->check(check_finite);
  command->add_flag("-q,--quiet", arguments->is_quiet, "No line for each change of the verdict");
  add_json_option(*command, arguments->json);
  command->footer(
      std::string("Ends by --for, --idle, SIGINT or SIGTERM; each closes what is open and the log. "
                  "One thread, at normal priority: the real-time path is `faultline run "
                  "--realtime`.\nExit codes: 0 something was diagnosed, whatever ended it; 1 there "
                  "was nothing to diagnose; 2 bad input or usage; 3 a bus, a file or LCM failed."));
  command->callback([arguments, &exit_code] { exit_code = diagnose(*arguments); });
}

}  // namespace faultline
