#pragma once

#include <string>

#include "tools/doctor/finding.h"

namespace faultline {

// Buses and LCM (bus_checks.cpp).
[[nodiscard]] Finding check_can_in_kernel();
[[nodiscard]] Finding check_can_interfaces();
[[nodiscard]] Finding check_multicast();
[[nodiscard]] Finding check_lcm();
[[nodiscard]] Finding check_lcm_logger();
[[nodiscard]] Finding check_receive_buffer();
[[nodiscard]] Finding check_input_backlog();

// Scheduling, memory and clocks (realtime_checks.cpp).
[[nodiscard]] Finding check_cpus();
[[nodiscard]] Finding check_priority();
[[nodiscard]] Finding check_locked_memory();
[[nodiscard]] Finding check_cpu_latency();
[[nodiscard]] Finding check_realtime_share();
[[nodiscard]] Finding check_governor();
[[nodiscard]] Finding check_clock();
[[nodiscard]] Finding check_timer();

/// First line of a small file such as those in /proc; empty if it cannot be read.
[[nodiscard]] std::string first_line(const char* path);

}  // namespace faultline
