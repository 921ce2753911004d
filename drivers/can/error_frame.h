#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "drivers/can/can_frame.h"

namespace faultline {

/// Fault confinement of a CAN controller (ISO 11898-1:2015, 12.1.4), with the step before passive
/// that controllers announce.
enum class ControllerState {
  kErrorActive,   ///< as it should be
  kErrorWarning,  ///< an error counter has reached 96
  kErrorPassive,  ///< an error counter has reached 128: it may no longer disturb others
  kBusOff,        ///< the transmit counter has reached 256: it takes no part in the bus
};

/// What an error frame of the controller says. Several things may be said at once.
struct ErrorReport {
  std::optional<ControllerState> state;  ///< the one it has come to, if it tells
  bool is_restarted = false;             ///< after bus-off
  bool is_unacknowledged = false;        ///< nobody answered what was sent
  bool is_arbitration_lost = false;
  bool is_protocol_violated = false;  ///< bit, stuff, form error and so on; `protocol_bits`
  bool is_transceiver_faulty = false;
  bool is_transmit_timed_out = false;  ///< noticed by the driver
  bool is_bus_error = false;           ///< unspecified; may come with each frame
  bool is_receive_overflow = false;  ///< the controller lost received frames: counted nowhere else
  bool is_transmit_overflow = false;
  std::uint8_t protocol_bits = 0;  ///< CAN_ERR_PROT_* of linux/can/error.h
  std::optional<std::uint8_t> transmit_errors, receive_errors;  ///< the error counters, if told
};

/// Reads an error frame of SocketCAN. Any payload length will do: bytes that are not there are
/// zero, and a frame that is no error frame says nothing. Real-time: does not allocate.
/// Source: linux/can/error.h (6.1). Before Linux 6.0 drivers told the counters without saying so;
/// they are taken where the frame is about the controller's state and one is not zero.
[[nodiscard]] ErrorReport read_error_frame(const CanFrame& frame) noexcept;

/// "bus-off", "error-passive (tx 128, rx 0)", "no acknowledgement, bus error".
[[nodiscard]] std::string describe(const ErrorReport& report);

}  // namespace faultline
