// One step of a residual bank: ours beside the loops it replaces, in one run. Seven channels
// (q = 3, m = 4) and one row per residual, as in docs/design.md's example. Observers: order 5,
// three rows, one sin, a course of 1500 samples, beside linear filters of that shape.

#include <cstdint>
#include <random>
#include <string>
#include <vector>

#include <Eigen/Core>
#include <benchmark/benchmark.h>

#include "diagnosis/bank/bank.h"
#include "diagnosis/runtime/residual_bank.h"

namespace faultline {
namespace {

constexpr Eigen::Index kOutputs = 3;
constexpr Eigen::Index kInputs = 4;

class Random {
 public:
  double uniform() { return std::uniform_real_distribution<double>(-1.0, 1.0)(engine_); }
  Eigen::MatrixXd matrix(Eigen::Index rows, Eigen::Index cols) {
    return Eigen::MatrixXd::NullaryExpr(rows, cols, [this] { return uniform(); });
  }

 private:
  std::mt19937_64 engine_{1};
};

/// `count` filters of order 1..largest_order, one row each.
Bank make_bank(std::size_t count, Eigen::Index largest_order) {
  Random random;
  Bank bank;
  bank.input_names.resize(kInputs);
  bank.output_names.resize(kOutputs);
  bank.u_operating = Eigen::VectorXd::Zero(kInputs);
  bank.y_operating = Eigen::VectorXd::Zero(kOutputs);
  for (std::size_t i = 0; i < count; ++i) {
    const Eigen::Index order = 1 + static_cast<Eigen::Index>(i) % largest_order;
    ResidualFilter filter;
    filter.F = 0.9 * Eigen::MatrixXd::Identity(order, order);
    filter.E = random.matrix(order, kOutputs);
    filter.G = random.matrix(order, kInputs);
    filter.M = random.matrix(1, order);
    filter.H = random.matrix(1, kOutputs);
    filter.K = random.matrix(1, kInputs);
    bank.filters.push_back(filter);
  }
  return bank;
}

/// `count` filters as observers have them: order 5, three rows.
Bank make_observers(std::size_t count, bool is_linear) {
  constexpr Eigen::Index kOrder = 5, kRows = 3, kCourse = 1500;
  Random random;
  Bank bank = make_bank(count, 1);
  for (ResidualFilter& filter : bank.filters) {
    filter.F = 0.9 * Eigen::MatrixXd::Identity(kOrder, kOrder);
    filter.E = random.matrix(kOrder, kOutputs);
    filter.G = random.matrix(kOrder, kInputs);
    filter.M = random.matrix(kRows, kOrder);
    filter.H = random.matrix(kRows, kOutputs);
    filter.K = random.matrix(kRows, kInputs);
    if (is_linear) continue;
    FilterNonlinearity term;
    term.W = random.matrix(kOrder, 1);
    term.a_v = random.matrix(kOrder, 1);
    term.a_y = random.matrix(kOutputs, 1);
    term.a_u = Eigen::VectorXd::Zero(kInputs);
    filter.nonlinearities = {term};
    filter.evaluation = Evaluation::kComponent;
    filter.course =
        ThresholdCourse{Eigen::MatrixXd::Identity(kRows, kRows), Eigen::VectorXd::Ones(kCourse),
                        Eigen::MatrixXd::Ones(kCourse, kRows)};
  }
  return bank;
}

/// Samples that change from step to step, so that nothing is hoisted out of the loop.
struct Samples {
  static constexpr std::size_t kCount = 64;
  Samples() {
    Random random;
    for (std::size_t k = 0; k < kCount; ++k) {
      y.emplace_back(random.matrix(kOutputs, 1));
      u.emplace_back(random.matrix(kInputs, 1));
    }
  }
  std::vector<Eigen::VectorXd> y, u;
};

Bank bank_of(const benchmark::State& state) {
  return make_bank(static_cast<std::size_t>(state.range(0)), state.range(1));
}

void step(benchmark::State& state, const Bank& bank_to_run) {
  ResidualBank bank(bank_to_run);
  const Samples samples;
  std::size_t k = 0;
  for (auto _ : state) {
    const Eigen::VectorXd& y = samples.y[k % Samples::kCount];
    const Eigen::VectorXd& u = samples.u[k % Samples::kCount];
    bank.step({y.data(), kOutputs}, {u.data(), kInputs});
    benchmark::DoNotOptimize(bank.evaluation().data());
    benchmark::ClobberMemory();
    ++k;
  }
}

void BM_OurStep(benchmark::State& state) { step(state, bank_of(state)); }

void BM_ObserverStep(benchmark::State& state) {
  step(state, make_observers(static_cast<std::size_t>(state.range(0)), false));
}

void BM_LinearOfThatShape(benchmark::State& state) {
  step(state, make_observers(static_cast<std::size_t>(state.range(0)), true));
}

void BM_PerFilterNaive(benchmark::State& state) {
  const Bank bank = bank_of(state);
  const Samples samples;
  std::vector<Eigen::VectorXd> v, r(bank.filters.size());
  for (const ResidualFilter& filter : bank.filters) {
    v.emplace_back(Eigen::VectorXd::Zero(filter.F.rows()));
  }
  std::size_t k = 0;
  for (auto _ : state) {
    const Eigen::VectorXd& y = samples.y[k % Samples::kCount];
    const Eigen::VectorXd& u = samples.u[k % Samples::kCount];
    for (std::size_t i = 0; i < bank.filters.size(); ++i) {
      const ResidualFilter& f = bank.filters[i];
      r[i] = f.M * v[i] - f.H * y + f.K * u;
      v[i] = f.F * v[i] - f.E * y + f.G * u;
    }
    benchmark::DoNotOptimize(r.data());
    benchmark::ClobberMemory();
    ++k;
  }
}

void BM_PerFilterNoalias(benchmark::State& state) {
  const Bank bank = bank_of(state);
  const Samples samples;
  std::vector<Eigen::VectorXd> v, v_next, r;
  for (const ResidualFilter& filter : bank.filters) {
    v.emplace_back(Eigen::VectorXd::Zero(filter.F.rows()));
    r.emplace_back(1);
  }
  v_next = v;
  std::size_t k = 0;
  for (auto _ : state) {
    const Eigen::VectorXd& y = samples.y[k % Samples::kCount];
    const Eigen::VectorXd& u = samples.u[k % Samples::kCount];
    for (std::size_t i = 0; i < bank.filters.size(); ++i) {
      const ResidualFilter& f = bank.filters[i];
      r[i].noalias() = f.M * v[i];
      r[i].noalias() -= f.H * y;
      r[i].noalias() += f.K * u;
      v_next[i].noalias() = f.F * v[i];
      v_next[i].noalias() -= f.E * y;
      v_next[i].noalias() += f.G * u;
      v[i].swap(v_next[i]);
    }
    benchmark::DoNotOptimize(r.data());
    benchmark::ClobberMemory();
    ++k;
  }
}

void BM_StackedGemv(benchmark::State& state) {
  const Bank bank = bank_of(state);
  const Samples samples;
  Eigen::Index order = 0;
  for (const ResidualFilter& filter : bank.filters) {
    order += filter.F.rows();
  }
  const auto rows = static_cast<Eigen::Index>(bank.filters.size());
  Eigen::MatrixXd stacked = Eigen::MatrixXd::Zero(rows + order, order + kOutputs + kInputs);
  Eigen::Index first = 0;
  for (Eigen::Index i = 0; i < rows; ++i) {
    const ResidualFilter& f = bank.filters[static_cast<std::size_t>(i)];
    const Eigen::Index d = f.F.rows();
    stacked.block(i, first, 1, d) = f.M;
    stacked.block(i, order, 1, kOutputs + kInputs) << -f.H, f.K;
    stacked.block(rows + first, first, d, d) = f.F;
    stacked.block(rows + first, order, d, kOutputs + kInputs) << -f.E, f.G;
    first += d;
  }
  Eigen::VectorXd in = Eigen::VectorXd::Zero(stacked.cols());
  Eigen::VectorXd out(stacked.rows());
  std::size_t k = 0;
  for (auto _ : state) {
    in.segment<kOutputs>(order) = samples.y[k % Samples::kCount];
    in.tail<kInputs>() = samples.u[k % Samples::kCount];
    out.noalias() = stacked * in;
    in.head(order) = out.tail(order);
    benchmark::DoNotOptimize(out.data());
    benchmark::ClobberMemory();
    ++k;
  }
}

// Six filters of order 1 as in Hou's example; the same number, and many, of orders 1 to 4.
void banks(benchmark::internal::Benchmark* benchmark) {
  benchmark->ArgNames({"filters", "order"})->Args({6, 1})->Args({6, 4})->Args({100, 4});
}

BENCHMARK(BM_OurStep)->Apply(banks);
BENCHMARK(BM_PerFilterNaive)->Apply(banks);
BENCHMARK(BM_PerFilterNoalias)->Apply(banks);
BENCHMARK(BM_StackedGemv)->Apply(banks);
BENCHMARK(BM_LinearOfThatShape)->ArgName("filters")->Arg(1)->Arg(2)->Arg(8);
BENCHMARK(BM_ObserverStep)->ArgName("filters")->Arg(1)->Arg(2)->Arg(8);

}  // namespace
}  // namespace faultline
