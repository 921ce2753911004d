#include "tools/bench/realtime_thread.h"

#include <cerrno>
#include <cstring>
#include <fstream>
#include <system_error>

#include <fcntl.h>
#include <pthread.h>
#include <sched.h>
#include <time.h>
#include <unistd.h>

#include <fmt/format.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>

namespace faultline {
namespace {

constexpr char kCpuLatencyDevice[] = "/dev/cpu_dma_latency";

std::string system_text(int error) { return std::generic_category().message(error); }

/// The program that runs, as it must be named to setcap.
std::string program_path() {
  std::string path(4096, '\0');
  const ssize_t length = ::readlink("/proc/self/exe", path.data(), path.size());
  path.resize(length > 0 ? static_cast<std::size_t>(length) : 0);
  return path.empty() ? "faultline" : path;
}

/// Both capabilities at once: whoever lacks one of them mostly lacks the other, and setcap replaces
/// what it set before.
std::string setcap_command() {
  return fmt::format("sudo setcap cap_sys_nice,cap_ipc_lock+ep {}", program_path());
}

bool has_capability(unsigned capability) {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);) {
    constexpr std::string_view kEffective = "CapEff:";
    if (!line.starts_with(kEffective)) continue;
    const auto bits = std::strtoull(line.c_str() + kEffective.size(), nullptr, 16);
    return ((bits >> capability) & 1u) != 0;
  }
  return false;
}

bool can_lock_everything() {
  constexpr unsigned kCapIpcLock = 14;  // linux/capability.h
  if (has_capability(kCapIpcLock)) return true;
  rlimit limit{};
  return ::getrlimit(RLIMIT_MEMLOCK, &limit) == 0 && limit.rlim_cur == RLIM_INFINITY;
}

}  // namespace

std::string to_text(const RealtimeProblem& problem) {
  if (problem.remedy.empty()) return problem.what;
  return fmt::format("{}; type: {}", problem.what, problem.remedy);
}

RealtimeProcess::RealtimeProcess() {
  lock_memory();
  hold_cpu_latency();
}

RealtimeProcess::~RealtimeProcess() {
  if (cpu_latency_fd_ >= 0) ::close(cpu_latency_fd_);  // closing gives the latency back
  if (is_memory_locked_) ::munlockall();
}

void RealtimeProcess::lock_memory() {
  if (!can_lock_everything()) {
    problems_.push_back(
        {RealtimeNeed::kMemory,
         "memory is not locked in RAM: RLIMIT_MEMLOCK would make later allocations fail",
         setcap_command()});
    return;
  }
  if (::mlockall(MCL_CURRENT | MCL_FUTURE) == 0) {
    is_memory_locked_ = true;
  } else {
    problems_.push_back({RealtimeNeed::kMemory,
                         fmt::format("memory is not locked in RAM: {}", system_text(errno)),
                         setcap_command()});
  }
}

void RealtimeProcess::hold_cpu_latency() {
  cpu_latency_fd_ = ::open(kCpuLatencyDevice, O_WRONLY | O_CLOEXEC);
  if (cpu_latency_fd_ < 0) {
    const int error = errno;
    if (error == ENOENT || error == ENXIO || error == ENODEV) {
      problems_.push_back({RealtimeNeed::kCpuLatency,
                           fmt::format("{} does not exist in this kernel or container: its CPUs "
                                       "may sleep deeply between cycles",
                                       kCpuLatencyDevice),
                           ""});
    } else {
      problems_.push_back({RealtimeNeed::kCpuLatency,
                           fmt::format("{} cannot be opened ({}): CPUs may sleep deeply between "
                                       "cycles",
                                       kCpuLatencyDevice, system_text(error)),
                           fmt::format("sudo setfacl -m u:$USER:w {}", kCpuLatencyDevice)});
    }
    return;
  }
  const std::int32_t none_us = 0;
  if (::write(cpu_latency_fd_, &none_us, sizeof none_us) != sizeof none_us) {
    problems_.push_back(
        {RealtimeNeed::kCpuLatency,
         fmt::format("{} cannot be written: {}", kCpuLatencyDevice, system_text(errno)), ""});
  }
}

std::vector<RealtimeProblem> make_thread_realtime(std::string_view name, int priority,
                                                  std::optional<int> cpu) {
  std::vector<RealtimeProblem> problems;
  constexpr std::size_t kLongestName = 15;  // pthread_setname_np(3)
  ::pthread_setname_np(::pthread_self(), std::string(name.substr(0, kLongestName)).c_str());
  ::prctl(PR_SET_TIMERSLACK, 1UL);
  if (cpu) {
    cpu_set_t cpus;
    CPU_ZERO(&cpus);
    if (*cpu >= 0 && *cpu < CPU_SETSIZE) CPU_SET(static_cast<std::size_t>(*cpu), &cpus);
    const int error = ::pthread_setaffinity_np(::pthread_self(), sizeof cpus, &cpus);
    if (error != 0) {
      problems.push_back(
          {RealtimeNeed::kCpu,
           fmt::format("the {} thread is not bound to CPU {}: {}", name, *cpu, system_text(error)),
           "taskset -cp $$   # lists the CPUs that are allowed"});
    }
  }
  if (priority > 0) {
    sched_param parameters{};
    parameters.sched_priority = priority;
    const int error = ::pthread_setschedparam(::pthread_self(), SCHED_FIFO, &parameters);
    if (error != 0) {
      problems.push_back({RealtimeNeed::kPriority,
                          fmt::format("the {} thread has no SCHED_FIFO priority {}: {}", name,
                                      priority, system_text(error)),
                          setcap_command()});
    }
  }
  return problems;
}

void sleep_until(std::chrono::steady_clock::time_point deadline) noexcept {
  const auto since_boot =
      std::chrono::duration_cast<std::chrono::nanoseconds>(deadline.time_since_epoch());
  constexpr std::int64_t kSecond_ns = 1'000'000'000;
  if (since_boot.count() <= 0) return;
  timespec until{};
  until.tv_sec = since_boot.count() / kSecond_ns;
  until.tv_nsec = since_boot.count() % kSecond_ns;
  while (::clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr) == EINTR) {
  }
}

void prefault_stack() noexcept {
  // Far more than the diagnosis needs: its matrices, records and batches of frames lie elsewhere.
  constexpr std::size_t kStack_B = 64 * 1024;
  constexpr std::size_t kPage_B = 4096;
  volatile char stack[kStack_B];
  for (std::size_t i = 0; i < kStack_B; i += kPage_B) stack[i] = 0;
  asm volatile("" : : "r"(stack) : "memory");  // the stores have a purpose
}

std::uint64_t thread_page_faults() noexcept {
  rusage usage{};
  if (::getrusage(RUSAGE_THREAD, &usage) != 0) return 0;
  return static_cast<std::uint64_t>(usage.ru_minflt) + static_cast<std::uint64_t>(usage.ru_majflt);
}

}  // namespace faultline
