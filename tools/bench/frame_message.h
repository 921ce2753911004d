#pragma once

#include <optional>

#include <faultline/can_frame_t.hpp>

#include "drivers/can/can_frame.h"

namespace faultline {

/// A frame as FAULTLINE_CAN carries it; its bus stands in the batch.
[[nodiscard]] can_frame_t to_message(const CanFrame& frame);

/// Back again; nothing if `message` is no frame that a bus could have carried.
[[nodiscard]] std::optional<CanFrame> to_frame(const can_frame_t& message);

}  // namespace faultline
