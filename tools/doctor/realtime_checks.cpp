#include <chrono>
#include <cstdlib>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include <sched.h>

#include <fmt/format.h>
#include <sys/resource.h>

#include "tools/bench/latency_histogram.h"
#include "tools/bench/realtime_thread.h"
#include "tools/bench/stage_latencies.h"
#include "tools/doctor/checks.h"

namespace faultline {
namespace {

constexpr int kPriority = 80;  // the default of `faultline run --realtime`

/// What asking for `need` came to: `found` if it was granted.
Finding from_problems(std::string check, const std::vector<RealtimeProblem>& problems,
                      RealtimeNeed need, std::string found) {
  for (const RealtimeProblem& problem : problems) {
    if (problem.need != need) continue;
    Finding finding{
        .check = std::move(check), .status = FindingStatus::kWarn, .found = problem.what};
    if (!problem.remedy.empty()) finding.remedies.push_back(problem.remedy);
    return finding;
  }
  return {.check = std::move(check), .found = std::move(found)};
}

std::string limit_text(int resource) {
  rlimit limit{};
  if (::getrlimit(static_cast<__rlimit_resource>(resource), &limit) != 0) return "not known";
  return limit.rlim_cur == RLIM_INFINITY ? "unlimited" : fmt::format("{}", limit.rlim_cur);
}

}  // namespace

Finding check_cpus() {
  cpu_set_t cpus;
  CPU_ZERO(&cpus);
  const int count = ::sched_getaffinity(0, sizeof cpus, &cpus) == 0 ? CPU_COUNT(&cpus) : 1;
  if (count > 1) return {.check = "CPUs", .found = fmt::format("{} may be used", count)};
  return {.check = "CPUs",
          .status = FindingStatus::kWarn,
          .found = "only one may be used: plant, controller, diagnosis and publisher share it"};
}

Finding check_priority() {
  std::vector<RealtimeProblem> problems;
  std::thread([&] { problems = make_thread_realtime("doctor", kPriority, std::nullopt); }).join();
  Finding finding = from_problems("real-time priority", problems, RealtimeNeed::kPriority,
                                  fmt::format("SCHED_FIFO {} is granted", kPriority));
  if (finding.status != FindingStatus::kOk) {
    finding.found += fmt::format(" (RLIMIT_RTPRIO is {})", limit_text(RLIMIT_RTPRIO));
    finding.remedies.push_back(
        fmt::format("echo \"$USER - rtprio {}\" | sudo tee /etc/security/limits.d/faultline.conf   "
                    "# or this, and log in again",
                    kPriority));
  }
  return finding;
}

Finding check_locked_memory() {
  return from_problems("locked memory", RealtimeProcess().problems(), RealtimeNeed::kMemory,
                       fmt::format("memory can be locked in RAM (RLIMIT_MEMLOCK is {})",
                                   limit_text(RLIMIT_MEMLOCK)));
}

Finding check_cpu_latency() {
  return from_problems("idle CPUs", RealtimeProcess().problems(), RealtimeNeed::kCpuLatency,
                       "/dev/cpu_dma_latency can be held at 0");
}

Finding check_realtime_share() {
  Finding finding{.check = "real-time share"};
  const std::string runtime = first_line("/proc/sys/kernel/sched_rt_runtime_us");
  const std::string period = first_line("/proc/sys/kernel/sched_rt_period_us");
  if (runtime.empty() || period.empty()) {
    finding.found = "this kernel does not limit real-time threads";
    return finding;
  }
  finding.found = runtime == "-1" ? std::string("real-time threads may use all of a CPU")
                                  : fmt::format("real-time threads may use {} of {} us of a CPU",
                                                runtime, period);
  // The kernel's default, 950000 of 1000000, is far more than the bench needs.
  if (runtime == "0") {
    finding.status = FindingStatus::kWarn;
    finding.remedies.emplace_back("sudo sysctl -w kernel.sched_rt_runtime_us=950000");
  }
  return finding;
}

Finding check_governor() {
  const std::string governor = first_line("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor");
  if (governor.empty()) {
    return {.check = "CPU frequency", .found = "not governed here (as in most virtual machines)"};
  }
  if (governor == "performance") return {.check = "CPU frequency", .found = "governor performance"};
  return {.check = "CPU frequency",
          .status = FindingStatus::kWarn,
          .found = fmt::format("governor {}: the CPU slows down between cycles", governor),
          .remedies = {"sudo cpupower frequency-set -g performance"}};
}

Finding check_clock() {
  std::string source =
      first_line("/sys/devices/system/clocksource/clocksource0/current_clocksource");
  if (source.empty()) source = "not told";
  const auto cost = steady_clock_cost();
  Finding finding{.check = "clock",
                  .found = fmt::format("source {}, reading it costs {} ns", source, cost.count())};
  // A read without a system call takes tens of ns.
  if (cost > std::chrono::microseconds(1)) {
    finding.status = FindingStatus::kWarn;
    finding.found += ": a system call; stages are timed in one cycle of several";
  }
  return finding;
}

Finding check_timer() {
  constexpr auto kPeriod = std::chrono::milliseconds(1);
  constexpr int kWakeUps = 500;
  LatencyHistogram late;
  std::thread([&] {
    // What is not granted, check_priority tells.
    static_cast<void>(make_thread_realtime("doctor", kPriority, std::nullopt));
    auto deadline = std::chrono::steady_clock::now();
    for (int i = 0; i < kWakeUps; ++i) {
      deadline += kPeriod;
      sleep_until(deadline);
      late.record(std::chrono::steady_clock::now() - deadline);
    }
  }).join();
  const auto us = [&](double percent) {
    return static_cast<double>(late.percentile(percent).count()) * 1e-3;
  };
  Finding finding{
      .check = "1 ms timer",
      .found = fmt::format("wakes late by {:.0f} us (p50), {:.0f} us (p99)", us(50.0), us(99.0))};
  if (late.percentile(99.0) >= kPeriod) {
    finding.status = FindingStatus::kWarn;
    finding.found += ": a 1 kHz bench will have overruns";
  }
  return finding;
}

}  // namespace faultline
