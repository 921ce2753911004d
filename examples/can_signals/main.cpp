// Prints the signals of every frame on a bus: can_signals FILE.dbc can:vcan0|udp:GROUP:PORT
#include <array>
#include <chrono>
#include <cstdio>
#include <vector>

#include "drivers/can/open_bus.h"
#include "drivers/dbc/dbc_parser.h"
#include "drivers/dbc/message_codec.h"

int main(int argc, char** argv) try {
  if (argc != 3) throw std::runtime_error("usage: can_signals FILE.dbc BUS");
  const faultline::DbcDatabase dbc = faultline::read_dbc(argv[1]);
  const auto bus = faultline::open_bus(argv[2]);
  const std::vector<faultline::MessageCodec> codecs(dbc.messages.begin(), dbc.messages.end());
  std::array<faultline::CanFrame, 64> frames;
  for (;;) {
    const auto [status, count] = bus->receive(frames, std::chrono::seconds(1));
    for (const auto& frame : std::span(frames).first(count)) {
      const auto* message = dbc.find_message(frame.id, frame.is_extended);
      if (message == nullptr) continue;
      std::vector<double> values(message->signals.size());
      std::vector<faultline::SignalPresence> presence(values.size());
      codecs[message - dbc.messages.data()].decode(frame.payload(), values, presence);
      for (std::size_t i = 0; i < values.size(); ++i) {
        if (presence[i] != faultline::SignalPresence::kPresent) continue;
        std::printf("%s.%s = %g\n", message->name.c_str(), message->signals[i].name.c_str(), values[i]);
      }
    }
    std::fflush(stdout);
  }
} catch (const std::exception& error) {
  return std::fprintf(stderr, "%s\n", error.what()), 1;
}
