#include <cerrno>
#include <chrono>
#include <cstdio>
#include <memory>
#include <string>
#include <string_view>

#include <unistd.h>

#include <CLI/App.hpp>
#include <fmt/format.h>
#include <sys/ioctl.h>

#include "tools/bench/stop_signal.h"
#include "tools/cli.h"
#include "tools/dashboard/live_view.h"
#include "tools/dashboard/terminal_picture.h"
#include "tools/lcm/lcm_source.h"
#include "tools/lcm/lcm_url.h"

namespace faultline {
namespace {

using Clock = std::chrono::steady_clock;

constexpr char kDefaultUrl[] = "udpm://239.255.76.67:7667?ttl=0";
constexpr std::chrono::milliseconds kRedraw{100};
/// Plain lines: at a change of the verdict, and so often beside.
constexpr std::chrono::seconds kLinePeriod{1};

struct WatchArguments {
  std::string lcm_url = kDefaultUrl;
};

void write_all(std::string_view text) {
  while (!text.empty()) {
    const ssize_t written = ::write(STDOUT_FILENO, text.data(), text.size());
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) throw OutputError("cannot write to stdout");
    text.remove_prefix(static_cast<std::size_t>(written));
  }
}

/// The alternate screen with the cursor hidden; what was there before comes back at the end.
class Screen {
 public:
  Screen() { write_all("\x1b[?1049h\x1b[?25l"); }
  ~Screen() {
    constexpr std::string_view kRestore = "\x1b[0m\x1b[?25h\x1b[?1049l";
    static_cast<void>(!::write(STDOUT_FILENO, kRestore.data(), kRestore.size()));
  }
  Screen(const Screen&) = delete;
  Screen& operator=(const Screen&) = delete;
};

/// Asked anew for each picture: a terminal that changes its size gets a picture of the new one.
TerminalSize terminal_size() {
  winsize size{};
  if (::ioctl(STDOUT_FILENO, TIOCGWINSZ, &size) != 0 || size.ws_col == 0 || size.ws_row == 0) {
    return {};
  }
  return {.columns = size.ws_col, .rows = size.ws_row};
}

int watch(const WatchArguments& arguments) {
  check_live_lcm_url(arguments.lcm_url);
  StopSignal stop;
  LcmSource source(arguments.lcm_url, "FAULTLINE_.*");
  LiveView view;
  const bool is_terminal = ::isatty(STDOUT_FILENO) == 1;
  std::unique_ptr<Screen> screen;
  if (is_terminal) screen = std::make_unique<Screen>();
  Clock::time_point next{};
  std::string last_line;
  for (;;) {
    if (const int signal = stop.poll(); signal != 0) return kExitSignal + signal;
    source.receive(kRedraw, [&](const LiveMessage& message) { view.take(message); });
    const Clock::time_point now = Clock::now();
    if (is_terminal) {
      if (now < next) continue;
      write_all(terminal_picture(view, terminal_size(), arguments.lcm_url, now));
      view.reset_peaks();
      next = now + kRedraw;
    } else {
      const std::string verdict = view.is_running(now) ? view.verdict_text() : "waiting";
      if (verdict == last_line && now < next) continue;
      write_all(terminal_line(view, arguments.lcm_url, now) + "\n");
      view.reset_peaks();
      last_line = verdict;
      next = now + kLinePeriod;
    }
  }
}

}  // namespace

void add_watch_command(CLI::App& program, int& exit_code) {
  CLI::App* command = program.add_subcommand(
      "watch", "Watch a running bench in the terminal: verdict, residuals, drops");
  auto arguments = std::make_shared<WatchArguments>();
  command->add_option("--lcm", arguments->lcm_url, "LCM URL of the run")->capture_default_str();
  command->footer(
      "Ends with ctrl-C. Where stdout is no terminal, a line per second and per change of the "
      "verdict.\n\n" +
      std::string(kExitCodesHelp));
  command->callback([arguments, &exit_code] { exit_code = watch(*arguments); });
}

}  // namespace faultline
