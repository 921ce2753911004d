// Designing and certifying banks for generic plants of n states, n/2 inputs (a fault on each) and
// 3n/5 outputs. Times are per residual, so that sizes compare; beside them, in the same run, the
// floor: a design decides ranks, and the least that takes is one singular value decomposition of an
// n×n matrix. "GrowthExponent" is the slope of log(time per residual) over log(n).

#include <chrono>
#include <cmath>
#include <map>
#include <string>

#include <Eigen/SVD>
#include <benchmark/benchmark.h>

#include "diagnosis/certify/certify.h"
#include "diagnosis/design/design_bank.h"
#include "tests/support/random_plant.h"

namespace faultline {
namespace {

// Counts the time per residual, of which one run of a design has many.
constexpr double kMinTime_s = 0.05;

using Clock = std::chrono::steady_clock;

/// Seconds per item, by n: what the growth is fitted to.
using Times = std::map<double, double>;
Times& design_times() {
  static Times times;
  return times;
}
Times& floor_times() {
  static Times times;
  return times;
}

double growth_exponent(const Times& times) {
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

BankRequest request_for(const PlantModel& plant, std::size_t concurrent) {
  BankRequest request;
  request.name = "benchmark";
  request.concurrent = concurrent;
  request.sample_time_s = 0.01;
  request.threshold = 0.5;
  for (Eigen::Index i = 0; i < plant.n(); ++i) {
    request.poles.emplace_back(-1.0 - 0.2 * static_cast<double>(i));
  }
  return request;
}

void design(benchmark::State& state, const PlantRecipe& recipe, std::size_t concurrent,
            Times* times) {
  const PlantModel plant = random_plant(recipe);
  const BankRequest request = request_for(plant, concurrent);
  double residuals = 0.0;
  double seconds = 0.0;
  double certify_seconds = 0.0;
  double runs = 0.0;
  for (auto _ : state) {
    const auto begin = Clock::now();
    DesignResult result = design_bank(plant, request);
    const auto designed = Clock::now();
    certify(plant, result.bank);
    const auto end = Clock::now();
    const double taken = std::chrono::duration<double>(end - begin).count();
    certify_seconds += std::chrono::duration<double>(end - designed).count();
    if (!result.is_solvable) state.SkipWithError("not solvable");
    residuals = static_cast<double>(result.residuals.size());
    state.SetIterationTime(taken / residuals);
    seconds += taken;
    runs += 1.0;
  }
  state.counters["residuals"] = residuals;
  state.counters["bank_s"] = seconds / runs;
  state.counters["of_that_certify_s"] = certify_seconds / runs;
  if (times != nullptr) (*times)[static_cast<double>(recipe.n)] = seconds / runs / residuals;
}

void DesignPerResidual(benchmark::State& state) {
  const Eigen::Index n = state.range(0);
  design(state, {PlantKind::kGeneric, n, n / 2, n * 3 / 5, 1}, 1, &design_times());
}
BENCHMARK(DesignPerResidual)
    ->ArgName("n")
    ->Arg(5)
    ->Arg(10)
    ->Arg(20)
    ->Arg(40)
    ->Arg(60)
    ->UseManualTime()
    ->MinTime(kMinTime_s)
    ->Unit(benchmark::kMillisecond);

// 120 residuals: every three of ten faults.
void DesignPerResidualForTriples(benchmark::State& state) {
  design(state, {PlantKind::kGeneric, 20, 10, 12, 1}, 3, nullptr);
}
BENCHMARK(DesignPerResidualForTriples)
    ->UseManualTime()
    ->MinTime(kMinTime_s)
    ->Unit(benchmark::kMillisecond);

void FloorOneDecomposition(benchmark::State& state) {
  const Eigen::Index n = state.range(0);
  const Eigen::MatrixXd X = RandomNumbers(1).normal(n, n);
  double seconds = 0.0;
  double runs = 0.0;
  for (auto _ : state) {
    const auto begin = Clock::now();
    const Eigen::BDCSVD<Eigen::MatrixXd> svd(X, Eigen::ComputeFullU | Eigen::ComputeFullV);
    benchmark::DoNotOptimize(svd.singularValues().sum());
    const double taken = std::chrono::duration<double>(Clock::now() - begin).count();
    state.SetIterationTime(taken);
    seconds += taken;
    runs += 1.0;
  }
  floor_times()[static_cast<double>(n)] = seconds / runs;
}
BENCHMARK(FloorOneDecomposition)
    ->ArgName("n")
    ->Arg(5)
    ->Arg(10)
    ->Arg(20)
    ->Arg(40)
    ->Arg(60)
    ->UseManualTime()
    ->MinTime(kMinTime_s)
    ->Unit(benchmark::kMillisecond);

// Of the runs before it: needs them (no --benchmark_filter that leaves them out).
void GrowthExponent(benchmark::State& state) {
  if (design_times().size() < 2 || floor_times().size() < 2) {
    state.SkipWithError("run together with the other benchmarks");
  }
  for (auto _ : state) {
    benchmark::DoNotOptimize(growth_exponent(design_times()));
  }
  if (design_times().size() < 2 || floor_times().size() < 2) return;
  state.counters["design"] = growth_exponent(design_times());
  state.counters["floor"] = growth_exponent(floor_times());
  for (const auto& [n, seconds] : design_times()) {
    state.counters["over_floor_" + std::to_string(static_cast<int>(n))] =
        seconds / floor_times().at(n);
  }
}
BENCHMARK(GrowthExponent)->Iterations(1);

}  // namespace
}  // namespace faultline
