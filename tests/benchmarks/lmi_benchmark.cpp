// One H-/L∞ synthesis over random stable plants of n states, 3n/5 outputs, one disturbance, a noise
// per output and one fault. "status" 0: solved, 3: inaccurate. The
// solver factors a dense matrix of that size some 30 times: time grows as n⁶ in the end.
// "GrowthExponent" is the slope of log(time) over log(n).

#include <chrono>
#include <cmath>
#include <map>

#include <benchmark/benchmark.h>

#include "diagnosis/design/uio/observer_synthesis.h"
#include "tests/diagnosis/design/uio/random_observer_model.h"

namespace faultline {
namespace {

double growth_exponent(const std::map<double, double>& times) {
  double count = 0.0, x = 0.0, y = 0.0, xx = 0.0, xy = 0.0;
  for (const auto& [n, seconds] : times) {
    const double log_n = std::log(n);
    const double log_t = std::log(seconds);
    count += 1.0;
    x += log_n;
    y += log_t;
    xx += log_n * log_n;
    xy += log_n * log_t;
  }
  return (count * xy - x * y) / (count * xx - x * x);
}

void synthesis(benchmark::State& state) {
  const Eigen::Index n = state.range(0);
  const Eigen::Index q = 3 * n / 5;
  RandomNumbers random(static_cast<std::uint64_t>(n));
  const ObserverModel model = random_observer_model(random, n, q, 1);
  const ReferenceSystem reference{0.5, -3.0 * model.F_x};
  static std::map<double, double> times;
  ObserverSynthesis observer;
  double seconds = 0.0;
  for (auto _ : state) {
    const auto start = std::chrono::steady_clock::now();
    observer = synthesise_observer(model, no_decoupling(model), output_error(model), 0.9,
                                   FrequencyBand{0.0, 0.1}, reference, ResidualWeight::kScalar);
    seconds += std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  }
  times[static_cast<double>(n)] = seconds / static_cast<double>(state.iterations());
  state.counters["status"] = static_cast<double>(observer.status);
  state.counters["objective"] = observer.objective;
  if (times.size() > 1) state.counters["GrowthExponent"] = growth_exponent(times);
  state.SetLabel(observer.reason);
}
BENCHMARK(synthesis)->Arg(4)->Arg(6)->Arg(10)->Arg(15)->Unit(benchmark::kMillisecond);
// What the solver can still, and what it can no longer do.
BENCHMARK(synthesis)->Arg(20)->Arg(30)->Iterations(1)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace faultline

BENCHMARK_MAIN();
