// Prints the signals of every frame on a bus: can_signals FILE.dbc can:vcan0|udp:GROUP:PORT
#include <cstdio>
#include <vector>

#include "drivers/can/open_bus.h"
#include "drivers/dbc/dbc_parser.h"
#include "drivers/dbc/message_codec.h"

int main(int argc, char** argv) try {
  if (argc != 3) throw std::runtime_error("usage: can_signals FILE.dbc BUS");
  const faultline::DbcDatabase dbc = faultline::read_dbc(argv[1]);
  const std::vector<faultline::MessageCodec> codecs(dbc.messages.begin(), dbc.messages.end());
  const auto bus = faultline::open_bus(argv[2]);
  for (std::vector<faultline::CanFrame> frames(64);; std::fflush(stdout)) {
    const auto [status, count] = bus->receive(frames, std::chrono::seconds(1));
    for (std::size_t n = 0; n < count; ++n) {
      const auto* message = dbc.find_message(frames[n].id, frames[n].is_extended);
      if (message == nullptr) continue;
      std::vector<double> values(message->signals.size());
      std::vector<faultline::SignalPresence> presence(values.size());
      codecs[message - dbc.messages.data()].decode(frames[n].payload(), values, presence);
      for (std::size_t i = 0; i < values.size(); ++i) {
        if (presence[i] != faultline::SignalPresence::kPresent) continue;
        std::printf("%s.%s = %g\n", message->name.c_str(), message->signals[i].name.c_str(), values[i]);
      }
    }
  }
} catch (const std::exception& error) {
  return std::fprintf(stderr, "%s\n", error.what()), 1;
}
