#include "drivers/can/error_frame.h"

#include <string_view>

#include <linux/can/error.h>

namespace faultline {
namespace {

// Bytes of an error frame.
constexpr std::size_t kControllerByte = 1;
constexpr std::size_t kProtocolByte = 2;
constexpr std::size_t kTransmitErrorsByte = 6;
constexpr std::size_t kReceiveErrorsByte = 7;
/// In an error frame's class since Linux 6.0 (CAN_ERR_CNT, which older headers lack).
constexpr std::uint32_t kCountersAreTold = 0x200;

/// The gravest state that the frame announces.
std::optional<ControllerState> read_state(std::uint32_t id, std::uint8_t controller) noexcept {
  if ((id & CAN_ERR_BUSOFF) != 0) return ControllerState::kBusOff;
  if ((id & CAN_ERR_CRTL) != 0) {
    if ((controller & (CAN_ERR_CRTL_RX_PASSIVE | CAN_ERR_CRTL_TX_PASSIVE)) != 0) {
      return ControllerState::kErrorPassive;
    }
    if ((controller & (CAN_ERR_CRTL_RX_WARNING | CAN_ERR_CRTL_TX_WARNING)) != 0) {
      return ControllerState::kErrorWarning;
    }
    if ((controller & CAN_ERR_CRTL_ACTIVE) != 0) return ControllerState::kErrorActive;
  }
  // A controller that restarts begins error-active.
  if ((id & CAN_ERR_RESTARTED) != 0) return ControllerState::kErrorActive;
  return std::nullopt;
}

std::string_view state_text(ControllerState state) noexcept {
  switch (state) {
    case ControllerState::kErrorActive:
      return "error-active";
    case ControllerState::kErrorWarning:
      return "error-warning";
    case ControllerState::kErrorPassive:
      return "error-passive";
    case ControllerState::kBusOff:
      return "bus-off";
  }
  return "";
}

std::string protocol_text(std::uint8_t bits) {
  constexpr struct {
    std::uint8_t bit;
    std::string_view text;
  } kKinds[] = {{CAN_ERR_PROT_BIT, "bit error"},
                {CAN_ERR_PROT_FORM, "form error"},
                {CAN_ERR_PROT_STUFF, "stuff error"},
                {CAN_ERR_PROT_BIT0, "dominant bit error"},
                {CAN_ERR_PROT_BIT1, "recessive bit error"},
                {CAN_ERR_PROT_OVERLOAD, "overload"}};
  std::string text;
  for (const auto& kind : kKinds) {
    if ((bits & kind.bit) == 0) continue;
    if (!text.empty()) text += ", ";
    text += kind.text;
  }
  return text.empty() ? "protocol error" : text;
}

std::string counters_text(const ErrorReport& report) {
  std::string text;
  if (report.transmit_errors) text += "tx " + std::to_string(*report.transmit_errors);
  if (report.receive_errors) {
    if (!text.empty()) text += ", ";
    text += "rx " + std::to_string(*report.receive_errors);
  }
  return text.empty() ? text : " (" + text + ")";
}

}  // namespace

ErrorReport read_error_frame(const CanFrame& frame) noexcept {
  ErrorReport report;
  if (!frame.is_error) return report;
  const std::uint32_t id = frame.id;
  const std::uint8_t controller = (id & CAN_ERR_CRTL) != 0 ? frame.data[kControllerByte] : 0;
  report.state = read_state(id, controller);
  report.is_restarted = (id & CAN_ERR_RESTARTED) != 0;
  report.is_unacknowledged = (id & CAN_ERR_ACK) != 0;
  report.is_arbitration_lost = (id & CAN_ERR_LOSTARB) != 0;
  report.is_protocol_violated = (id & CAN_ERR_PROT) != 0;
  report.is_transceiver_faulty = (id & CAN_ERR_TRX) != 0;
  report.is_transmit_timed_out = (id & CAN_ERR_TX_TIMEOUT) != 0;
  report.is_bus_error = (id & CAN_ERR_BUSERROR) != 0;
  report.is_receive_overflow = (controller & CAN_ERR_CRTL_RX_OVERFLOW) != 0;
  report.is_transmit_overflow = (controller & CAN_ERR_CRTL_TX_OVERFLOW) != 0;
  if (report.is_protocol_violated) report.protocol_bits = frame.data[kProtocolByte];
  const std::uint8_t transmit_errors = frame.data[kTransmitErrorsByte];
  const std::uint8_t receive_errors = frame.data[kReceiveErrorsByte];
  const bool is_about_state = (id & (CAN_ERR_CRTL | CAN_ERR_BUSOFF)) != 0;
  if ((id & kCountersAreTold) != 0 ||
      (is_about_state && (transmit_errors != 0 || receive_errors != 0))) {
    report.transmit_errors = transmit_errors;
    report.receive_errors = receive_errors;
  }
  return report;
}

std::string describe(const ErrorReport& report) {
  std::string text;
  const auto add = [&text](std::string_view part) {
    if (!text.empty()) text += ", ";
    text += part;
  };
  if (report.is_restarted) add("restarted");
  if (report.state) add(state_text(*report.state));
  if (report.is_receive_overflow) add("receive overflow in the controller");
  if (report.is_transmit_overflow) add("transmit overflow in the controller");
  if (report.is_unacknowledged) add("no acknowledgement");
  if (report.is_arbitration_lost) add("arbitration lost");
  if (report.is_protocol_violated) add(protocol_text(report.protocol_bits));
  if (report.is_transceiver_faulty) add("transceiver fault");
  if (report.is_transmit_timed_out) add("transmit timeout");
  if (report.is_bus_error) add("bus error");
  if (text.empty()) text = "unspecified error";
  return text + counters_text(report);
}

}  // namespace faultline
