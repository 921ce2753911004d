#include <array>
#include <chrono>
#include <cstdio>
#include <iterator>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <unistd.h>

#include <CLI/App.hpp>
#include <CLI/Validators.hpp>
#include <fmt/format.h>
#include <sys/ioctl.h>

#include "drivers/can/candump_log.h"
#include "drivers/can/error_frame.h"
#include "drivers/dbc/dbc_parser.h"
#include "drivers/signal/traffic_monitor.h"
#include "tools/can/bus_session.h"
#include "tools/can/can_command.h"
#include "tools/can/frame_decoder.h"
#include "tools/can/frame_filter.h"
#include "tools/can/frame_text.h"
#include "tools/can/output.h"
#include "tools/can/problem_report.h"
#include "tools/cli.h"

namespace faultline {
namespace {

struct DumpArguments {
  std::vector<std::string> buses, filters;
  std::string dbc, format = "text";
  SessionLimits limits;
};

void append(fmt::memory_buffer& out, std::string_view text) {
  out.append(text.data(), text.data() + text.size());
}

/// One frame per line, in the form asked for.
class LineDump {
 public:
  LineDump(const std::string& format, const BusSession& session, FrameDecoder& decoder)
      : is_json_(format == "json"),
        is_log_(format == "log"),
        session_(&session),
        decoder_(&decoder) {}

  void add(const CanFrame& frame) {
    fmt::memory_buffer& out = output_.buffer();
    const std::string_view bus = session_->name_of(frame);
    if (is_json_) {
      append_json(out, frame, bus, decoder_->decode(frame));
    } else if (is_log_) {
      std::array<char, kLongestCandumpLine> line;
      append(out, {line.data(), format_candump_line(frame, bus, line)});
    } else {
      add_text(out, frame, bus);
    }
    output_.flush_if_large();
  }
  void pause() { output_.flush(); }

 private:
  void add_text(fmt::memory_buffer& out, const CanFrame& frame, std::string_view bus) {
    append(out, "(");
    append_time(out, frame.stamp);
    append(out, ")  ");
    append_frame(out, frame, bus);
    append(out, "  ");
    if (frame.is_error) {
      append(out, describe(read_error_frame(frame)));
    } else {
      append_signals(out, frame, decoder_->decode(frame));
    }
    append(out, "\n");
  }

  bool is_json_, is_log_;
  const BusSession* session_;
  FrameDecoder* decoder_;
  Output output_;
};

/// Every identifier in a line of its own, kept up to date in place.
class TableDump {
 public:
  TableDump(const DbcDatabase& dbc, const BusSession& session, FrameDecoder& decoder)
      : session_(&session), decoder_(&decoder), monitor_(dbc) {}

  void add(const CanFrame& frame) { monitor_.on_frame(frame); }

  void pause() {
    using Clock = std::chrono::steady_clock;
    constexpr std::chrono::milliseconds kRefresh{200};
    if (Clock::now() < next_refresh_) return;
    next_refresh_ = Clock::now() + kRefresh;
    draw();
  }
  void draw();

 private:
  [[nodiscard]] std::string row(const IdentifierTraffic& traffic, Timestamp now);

  const BusSession* session_;
  FrameDecoder* decoder_;
  TrafficMonitor monitor_;
  Output output_;
  std::chrono::steady_clock::time_point next_refresh_{};
};

std::string TableDump::row(const IdentifierTraffic& traffic, Timestamp now) {
  fmt::memory_buffer text;
  const CanFrame& frame = traffic.last_frame;
  const auto seen_for = age(traffic, now);
  fmt::format_to(
      std::back_inserter(text), "{:<8} {:>8} {:>9} {:>9} {:>8}  {:<13} ", session_->name_of(frame),
      fmt::format("{:0{}X}", traffic.id, traffic.is_extended ? 8 : 3), traffic.frames,
      traffic.period.intervals() > 0 ? fmt::format("{:.1f}", 1e3 * traffic.period.mean_s())
                                     : std::string("-"),
      seen_for ? fmt::format("{:.1f}", std::chrono::duration<double>(*seen_for).count())
               : std::string("-"),
      signal_state_name(state(traffic, now)));
  if (frame.length > 0 || traffic.data_frames() > 0) {
    const DecodedFrame decoded = decoder_->decode(frame);
    if (decoded.message != nullptr) {
      append_signals(text, frame, decoded);
    } else {
      for (const std::uint8_t byte : frame.payload()) {
        fmt::format_to(std::back_inserter(text), "{:02X} ", byte);
      }
    }
  }
  return fmt::to_string(text);
}

void TableDump::draw() {
  struct winsize size {};
  const bool has_size = ::ioctl(STDOUT_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_row > 3;
  const std::size_t rows = has_size ? size.ws_row - 3u : 1000;
  const std::size_t columns = has_size && size.ws_col > 0 ? size.ws_col : 1000;
  const Timestamp now =
      std::chrono::time_point_cast<std::chrono::nanoseconds>(std::chrono::system_clock::now());
  fmt::memory_buffer& out = output_.buffer();
  append(out, has_size ? "\x1b[H\x1b[2J" : "");
  append(out, fmt::format("{:<8} {:>8} {:>9} {:>9} {:>8}  {:<13} {}\n", "bus", "id", "frames",
                          "period ms", "age s", "state", "message, signals")
                  .substr(0, columns));
  std::size_t shown = 0, seen = 0;
  for (const IdentifierTraffic& traffic : monitor_.identifiers()) {
    if (traffic.frames == 0 && traffic.message == IdentifierTraffic::kNoMessage) continue;
    ++seen;
    if (shown >= rows) continue;
    ++shown;
    append(out, std::string_view(row(traffic, now)).substr(0, columns));
    append(out, "\n");
  }
  const BusCounters counters = session_->counters();
  append(out, fmt::format("{} frames, {} dropped{}", monitor_.frames(), counters.dropped,
                          seen > shown ? fmt::format(", {} more identifiers", seen - shown) : ""));
  append(out, "\n");
  output_.flush();
}

int dump(const DumpArguments& arguments) {
  DbcDatabase dbc;
  if (!arguments.dbc.empty()) {
    dbc = read_dbc(arguments.dbc);
    report_dbc_errors(dbc);
  }
  const FrameFilter filter(arguments.filters, arguments.dbc.empty() ? nullptr : &dbc);
  FrameDecoder decoder(dbc);
  BusSession session(arguments.buses);
  const auto listen = [&](auto& view) {
    session.listen(
        arguments.limits,
        [&](const CanFrame& frame) {
          if (filter.passes(frame)) view.add(frame);
        },
        [&] { view.pause(); });
  };
  if (arguments.format == "table") {
    TableDump table(dbc, session, decoder);
    listen(table);
    table.draw();
  } else {
    LineDump lines(arguments.format, session, decoder);
    listen(lines);
  }
  fmt::print(stderr, "{}\n", counters_text(session.counters()));
  return kExitYes;
}

}  // namespace

void add_dump_command(CLI::App& parent, int& exit_code) {
  CLI::App* command =
      parent.add_subcommand("dump", "Show the frames on one or more buses, decoded by a DBC");
  auto arguments = std::make_shared<DumpArguments>();
  command
      ->add_option("BUS", arguments->buses,
                   "can:IFACE, udp:GROUP:PORT (python-can's udp_multicast); several may be given")
      ->required()
      ->type_name("BUS");
  add_limit_options(*command, arguments->limits);
  command->add_option("--dbc", arguments->dbc, "DBC file")->check(CLI::ExistingFile);
  add_filter_option(*command, arguments->filters);
  command
      ->add_option(
          "--format", arguments->format,
          "text; table: a line per identifier kept up to date, with period, age and state; "
          "log: as candump -L; json: as `faultline decode`")
      ->check(CLI::IsMember({"text", "table", "log", "json"}))
      ->capture_default_str();
  command->footer("Ends at Ctrl-C, with exit code 0. What was lost is told on stderr.\n" +
                  std::string(kExitCodesHelp));
  command->callback([arguments, &exit_code] { exit_code = dump(*arguments); });
}

}  // namespace faultline
