#include "tools/interruptible_load.h"

#include <chrono>
#include <future>
#include <thread>
#include <utility>

namespace faultline {
namespace {

/// How soon a signal is seen while a bank is designed.
constexpr std::chrono::milliseconds kSignalPeriod{20};

}  // namespace

std::optional<BenchInputs> load_until_signal(const std::filesystem::path& file, StopSignal& stop,
                                             const std::filesystem::path& plant_library) {
  std::packaged_task<BenchInputs()> load(
      [file, plant_library] { return load_bench_inputs(file, plant_library); });
  std::future<BenchInputs> inputs = load.get_future();
  std::thread(std::move(load)).detach();
  while (inputs.wait_for(kSignalPeriod) != std::future_status::ready) {
    if (stop.poll() != 0) return std::nullopt;
  }
  return inputs.get();
}

}  // namespace faultline
