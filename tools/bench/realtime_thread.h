#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace faultline {

/// What a process or thread asks the system for.
enum class RealtimeNeed { kPriority, kCpu, kMemory, kCpuLatency };

/// What keeps a process or thread from running in real time as it should. The run goes on.
struct RealtimeProblem {
  RealtimeNeed need;
  std::string what;    ///< a sentence without its full stop
  std::string remedy;  ///< the exact command to type; empty: there is nothing to do about it
};

/// "what; type: remedy".
[[nodiscard]] std::string to_text(const RealtimeProblem& problem);

/// While it lives, the process's memory stays in RAM (mlockall) and the CPUs in their shallowest
/// idle state (/dev/cpu_dma_latency held at 0), as far as the system permits. Memory is locked only
/// where no limit could then make a later allocation fail: with CAP_IPC_LOCK, or an unlimited
/// RLIMIT_MEMLOCK. Never throws for lack of permission; `problems()` tells.
class RealtimeProcess {
 public:
  RealtimeProcess();
  ~RealtimeProcess();
  RealtimeProcess(const RealtimeProcess&) = delete;
  RealtimeProcess& operator=(const RealtimeProcess&) = delete;

  [[nodiscard]] const std::vector<RealtimeProblem>& problems() const noexcept { return problems_; }

 private:
  void lock_memory();
  void hold_cpu_latency();

  bool is_memory_locked_ = false;
  int cpu_latency_fd_ = -1;
  std::vector<RealtimeProblem> problems_;
};

/// Names the calling thread, gives it SCHED_FIFO at `priority` (1 .. 99; 0: scheduling stays as it
/// is), binds it to `cpu` if there is one, and sets its timers' slack to 1 ns.
/// @return what could not be had.
[[nodiscard]] std::vector<RealtimeProblem> make_thread_realtime(std::string_view name, int priority,
                                                                std::optional<int> cpu);

/// Sleeps until `deadline` on CLOCK_MONOTONIC, absolutely: what came before it cannot add up.
/// Signals do not end it early. Does not allocate.
void sleep_until(std::chrono::steady_clock::time_point deadline) noexcept;

/// Touches the stack that the calling thread may come to use, so that no page of it is missing
/// later.
void prefault_stack() noexcept;

/// Page faults of the calling thread so far, minor and major.
[[nodiscard]] std::uint64_t thread_page_faults() noexcept;

}  // namespace faultline
