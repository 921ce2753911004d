#include <chrono>
#include <cstdio>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include <unistd.h>

#include <CLI/App.hpp>
#include <CLI/Validators.hpp>
#include <faultline/event_t.hpp>
#include <faultline/inject_t.hpp>
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "tools/cli.h"
#include "tools/lcm/channels.h"
#include "tools/lcm/lcm_source.h"
#include "tools/lcm/lcm_url.h"
#include "tools/lcm/log_event.h"
#include "tools/lcm/message_layout.h"
#include "tools/lcm/message_sink.h"
#include "tools/node_commands.h"

namespace faultline {
namespace {

using Json = nlohmann::ordered_json;
using Clock = std::chrono::steady_clock;

constexpr double kDefaultWait_s = 2.0;
/// Longest wait for one message.
constexpr std::chrono::milliseconds kSlice{50};

struct InjectArguments {
  std::string target, kind, lcm_url, json;
  std::optional<double> value;
  inject_t request{};
  double wait_s = kDefaultWait_s;
  bool must_clear = false;
};

/// Answers to other requests begin with other names.
std::string request_name() {
  const auto since_1970 = std::chrono::system_clock::now().time_since_epoch();
  return fmt::format("inject-{}-{}", ::getpid(),
                     std::chrono::duration_cast<std::chrono::microseconds>(since_1970).count());
}

/// What was asked for as a message.
inject_t request_of(const InjectArguments& arguments) {
  if (!arguments.must_clear && (arguments.target.empty() || arguments.kind.empty())) {
    throw std::invalid_argument(
        fmt::format("inject: found {}, expected TARGET and KIND, or --clear",
                    arguments.target.empty() ? "neither TARGET nor KIND" : "no KIND"));
  }
  if (arguments.must_clear && !arguments.kind.empty()) {
    throw std::invalid_argument(
        fmt::format("inject --clear: found \"{}\" behind the target, expected a TARGET at most",
                    arguments.kind));
  }
  inject_t request = arguments.request;
  const auto since_1970 = std::chrono::system_clock::now().time_since_epoch();
  request.utime = std::chrono::duration_cast<std::chrono::microseconds>(since_1970).count();
  request.request = request_name();
  request.clear = arguments.must_clear ? 1 : 0;
  request.target = arguments.target;
  request.kind = arguments.kind;
  request.has_value = arguments.value ? 1 : 0;
  request.value = arguments.value.value_or(0.0);
  return request;
}

void send(const inject_t& request, MessageSink& sink) {
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(request.getEncodedSize()));
  request.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  sink.publish(kInjectChannel, request.utime, bytes);
  sink.flush();
}

/// The EVENT that answers `request`, if it comes in time.
std::optional<event_t> await_answer(LcmSource& source, const inject_t& request, double wait_s) {
  const std::string beginning = request.request + ":";
  std::optional<event_t> answer;
  const auto end = Clock::now() + std::chrono::duration<double>(wait_s);
  while (!answer && Clock::now() < end) {
    source.receive(kSlice, [&](const LiveMessage& message) {
      event_t event;
      if (!decode_message(message.data, layout::kEvent, event)) return;
      if (event.source == "inject" && event.text.starts_with(beginning)) answer = event;
    });
  }
  return answer;
}

int inject(const InjectArguments& arguments) {
  check_live_lcm_url(arguments.lcm_url);
  const inject_t request = request_of(arguments);
  LcmSource source(arguments.lcm_url, kEventChannel);
  const std::unique_ptr<MessageSink> sink = open_live(arguments.lcm_url);
  send(request, *sink);
  const std::optional<event_t> answer = await_answer(source, request, arguments.wait_s);
  const bool is_accepted = answer && answer->severity == "info";
  const std::string text = answer ? answer->text.substr(request.request.size() + 2) : std::string();
  if (!arguments.json.empty()) {
    write_json(Json{{"request", request.request},
                    {"answered", answer.has_value()},
                    {"accepted", is_accepted},
                    {"cycle", is_accepted ? Json(answer->cycle) : Json(nullptr)},
                    {"text", text}},
               arguments.json);
  }
  if (!answer) {
    fmt::print(stderr,
               "faultline: nobody answered on {} within {} s: no bench or plant runs with --lcm "
               "there, or it is too busy\n",
               arguments.lcm_url, arguments.wait_s);
    return kExitFailure;
  }
  if (!is_accepted) {
    fmt::print(stderr, "faultline: {}\n", text);
    return kExitBadInput;
  }
  fmt::print(human_output(arguments.json), "{}\n", text);
  return kExitYes;
}

}  // namespace

void add_inject_command(CLI::App& program, int& exit_code) {
  CLI::App* command = program.add_subcommand(
      "inject", "Inject a fault into a run while it goes on, or end one, over live LCM");
  auto arguments = std::make_shared<InjectArguments>();
  inject_t& request = arguments->request;
  request.probability = 1.0;
  command->add_option("TARGET", arguments->target,
                      "What fails, as in a scenario's [[fault]]: an actuator, a sensor, a "
                      "component, a message or a node");
  command->add_option("KIND", arguments->kind, "How, as in a scenario: bias, stuck, dropped, ..");
  command->add_option("VALUE", arguments->value, "The kind's value, if it has one")
      ->check(check_finite);
  command->add_option("--lcm", arguments->lcm_url, "LCM URL of the run")->required();
  command->add_flag("--clear", arguments->must_clear,
                    "End the faults of TARGET; all faults without one");
  const auto add_number = [&](const char* name, double& target, const char* help) {
    command->add_option(name, target, help)->check(CLI::NonNegativeNumber)->check(check_finite);
  };
  add_number("--for", request.duration_s, "Ends after so many seconds; default: when cleared");
  add_number("--ramp", request.ramp_s, "Grows over so many seconds");
  add_number("--period", request.period_s, "Acts in the first half of each period, in seconds");
  add_number("--probability", request.probability, "Share of the cycles in which it acts, drawn");
  add_number("--frequency", request.frequency_Hz, "Of kind sinusoid, in Hz");
  command->add_option("--phase", request.phase_rad, "Of kind sinusoid, in rad")
      ->check(check_finite);
  command->add_option("--with", request.with, "Of kind swapped: the other signal");
  command->add_option("--wait", arguments->wait_s, "Seconds to wait for the answer")
      ->check(CLI::PositiveNumber)
      ->check(check_finite)
      ->capture_default_str();
  add_json_option(*command, arguments->json);
  command->footer(
      "A run takes faults where it has --lcm: `faultline run` and `faultline plant`. They begin, "
      "and end, in a cycle that the answer names.\nExit codes: 0 accepted; 2 refused, or bad "
      "usage; 3 nobody answered.");
  command->callback([arguments, &exit_code] { exit_code = inject(*arguments); });
}

}  // namespace faultline
