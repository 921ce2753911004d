// A bus as lines of text, for the tests of interoperability:
//   bus_lines dump SPEC COUNT   prints COUNT frames of the bus as candump -L does, then its
//   counters
//                               on stderr; "ready" on stderr before; exit 1 if 10 s pass without
//                               any
//   bus_lines send SPEC         sends the candump lines of stdin, all that are there at a time
#include <array>
#include <chrono>
#include <cstdio>
#include <exception>
#include <string>
#include <vector>

#include <unistd.h>

#include "drivers/can/candump_log.h"
#include "drivers/can/open_bus.h"

namespace faultline {
namespace {

void print_counters(const CanBus& bus) {
  const BusCounters c = bus.counters();
  std::fprintf(stderr, "sent %lu send_errors %lu received %lu dropped %lu malformed %lu\n", c.sent,
               c.send_errors, c.received, c.dropped, c.malformed);
}

int dump(CanBus& bus, std::size_t count) {
  std::fputs("ready\n", stderr);
  const std::string name = bus.name().starts_with("can:") ? bus.name().substr(4) : "udp";
  std::array<CanFrame, 64> frames;
  std::array<char, kLongestCandumpLine> line;
  std::size_t printed = 0;
  while (printed < count) {
    const ReceiveResult result = bus.receive(frames, std::chrono::seconds(10));
    if (result.status != ReceiveStatus::kOk) break;
    for (std::size_t n = 0; n < result.count; ++n, ++printed) {
      const std::size_t size = format_candump_line(frames[n], name, line);
      std::fwrite(line.data(), 1, size, stdout);
    }
    std::fflush(stdout);
  }
  print_counters(bus);
  return printed == count ? 0 : 1;
}

int send(CanBus& bus) {
  CandumpReader reader(STDIN_FILENO);
  CandumpRecord record;
  CandumpProblem problem;
  std::vector<CanFrame> frames;
  for (;;) {
    const CandumpReader::Status status = reader.next(record, problem);
    if (status == CandumpReader::Status::kRecord) {
      frames.push_back(record.frame);
      continue;
    }
    if (status == CandumpReader::Status::kEnd) break;
    std::fprintf(stderr, "line %lu, column %zu: expected %s\n", reader.line_number(),
                 problem.column, problem.expected);
    return 2;
  }
  const bool has_sent_all = bus.send_batch(frames) == frames.size();
  print_counters(bus);
  return has_sent_all ? 0 : 1;
}

}  // namespace
}  // namespace faultline

int main(int argc, char** argv) {
  const std::vector<std::string> arguments(argv + 1, argv + argc);
  try {
    if (arguments.size() == 3 && arguments[0] == "dump") {
      return faultline::dump(*faultline::open_bus(arguments[1]), std::stoul(arguments[2]));
    }
    if (arguments.size() == 2 && arguments[0] == "send") {
      return faultline::send(*faultline::open_bus(arguments[1]));
    }
    std::fputs("usage: bus_lines dump SPEC COUNT | send SPEC\n", stderr);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "bus_lines: %s\n", error.what());
  }
  return 2;
}
