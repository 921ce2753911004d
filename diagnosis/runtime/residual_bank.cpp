#include "diagnosis/runtime/residual_bank.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <numeric>
#include <vector>

#include "diagnosis/runtime/observer_step.h"
#include "diagnosis/runtime/sequential_step.h"

namespace faultline {
namespace {

// Filters that run side by side: two AVX registers of doubles (see tests/benchmarks).
constexpr std::size_t kLanes = 8;

// Four doubles in a register. The compilers' vector extension, because gcc 12 keeps sums of plain
// arrays in memory (three times slower); its operators work element by element, so the bits are
// those of a plain loop over the lanes.
using Quad = double __attribute__((vector_size(4 * sizeof(double))));

// One number of each of kLanes filters.
struct Lanes {
  Quad low = {};
  Quad high = {};

  void set(std::size_t lane, double value) noexcept {
    std::memcpy(reinterpret_cast<std::byte*>(this) + lane * sizeof(double), &value, sizeof(double));
  }
  [[nodiscard]] double get(std::size_t lane) const noexcept {
    double value = 0.0;
    std::memcpy(&value, reinterpret_cast<const std::byte*>(this) + lane * sizeof(double),
                sizeof(double));
    return value;
  }
};
static_assert(sizeof(Lanes) == kLanes * sizeof(double));

// kLanes filters of similar order as one set of matrices whose entries are Lanes. A smaller filter
// is padded with zeros, which keeps its padding at zero.
struct Block {
  std::size_t order = 0;  // largest d
  std::size_t rows = 0;   // most rows of a residual
  std::size_t first_coefficient = 0;
  std::size_t first_state = 0;
  std::size_t filter_count = 0;
};

// Where a filter's residual is to be put, and where its block leaves it.
struct Destination {
  std::size_t filter = 0;
  std::size_t first_row = 0;
  std::size_t rows = 0;
};

// A Lipschitz term and the place of its filter's state.
struct PlacedTerm {
  NonlinearTerm term;
  std::size_t first_state = 0;
  std::size_t lane = 0;
};

// A filter whose thresholds follow a course.
struct PlacedCourse {
  CourseEvaluation course;
  std::size_t filter = 0;
  std::size_t first_row = 0;
  std::size_t rows = 0;
};

// A filter whose evaluation is the statistic of a sequential test.
struct PlacedTest {
  SequentialStatistic statistic;
  std::size_t filter = 0;
  std::size_t first_row = 0;
  std::size_t rows = 0;
};

// One row of [M H K] or [F E G] times [v; y; u]: states first, then channels, each in order.
inline Lanes row_product(const Lanes* coefficient, const Lanes* v, std::size_t order,
                         const double* sample, std::size_t channel_count) noexcept {
  Lanes sum;
  for (std::size_t s = 0; s < order; ++s) {
    sum.low += coefficient[s].low * v[s].low;
    sum.high += coefficient[s].high * v[s].high;
  }
  for (std::size_t c = 0; c < channel_count; ++c) {
    sum.low += coefficient[order + c].low * sample[c];
    sum.high += coefficient[order + c].high * sample[c];
  }
  return sum;
}

}  // namespace

struct ResidualBank::State {
  std::size_t output_count = 0;
  std::size_t input_count = 0;
  std::vector<double> operating_point;  // y₀, u₀
  std::vector<double> sample;           // y_k - y₀, u_k - u₀
  std::vector<Block> blocks;
  std::vector<Lanes> coefficients;  // per block: rows of [M -H K], then of [F -E G]
  std::vector<Lanes> v, v_next;
  std::vector<Lanes> block_residual;      // of the block at hand
  std::vector<Destination> destinations;  // in the order of the lanes
  std::vector<double> residual;
  std::vector<double> evaluation;
  std::vector<double> thresholds;      // per filter
  std::vector<double> row_thresholds;  // per row of `residual`
  std::vector<PlacedTerm> terms;       // in the order of the lanes, then of the filter's file
  std::vector<PlacedCourse> courses;
  std::vector<PlacedTest> tests;
  bool has_more = false;  // terms, courses or tests: one question where there are none
  std::size_t k = 0;      // of the next sample; counts for courses

  [[nodiscard]] std::size_t channel_count() const { return output_count + input_count; }

  void add_block(const Bank& bank, std::span<const std::size_t> filters);
  void add_rows(const Bank& bank, std::span<const std::size_t> filters, const Block& block,
                bool is_state_equation);
  void add_course(const ResidualFilter& filter, const Destination& destination);
  void step_block(const Block& block) noexcept;
  void step_more() noexcept;
  void add_terms() noexcept;
  void set_thresholds() noexcept;
  void deliver(const Block& block, const Destination* destination) noexcept;
};

void ResidualBank::State::add_block(const Bank& bank, std::span<const std::size_t> filters) {
  Block block;
  block.first_coefficient = coefficients.size();
  block.first_state = v.size();
  block.filter_count = filters.size();
  for (const std::size_t i : filters) {
    block.order = std::max(block.order, static_cast<std::size_t>(bank.filters[i].F.rows()));
    block.rows = std::max(block.rows, static_cast<std::size_t>(bank.filters[i].H.rows()));
  }
  add_rows(bank, filters, block, false);
  add_rows(bank, filters, block, true);
  for (std::size_t l = 0; l < filters.size(); ++l) {
    for (const FilterNonlinearity& term : bank.filters[filters[l]].nonlinearities) {
      terms.push_back({NonlinearTerm(term), block.first_state, l});
    }
  }
  v.resize(v.size() + block.order);
  block_residual.resize(std::max(block_residual.size(), block.rows));
  blocks.push_back(block);
}

void ResidualBank::State::add_rows(const Bank& bank, std::span<const std::size_t> filters,
                                   const Block& block, bool is_state_equation) {
  const std::size_t rows = is_state_equation ? block.order : block.rows;
  const std::size_t cols = block.order + channel_count();
  const std::size_t first = coefficients.size();
  coefficients.resize(first + rows * cols);
  for (std::size_t l = 0; l < filters.size(); ++l) {
    const ResidualFilter& filter = bank.filters[filters[l]];
    const Eigen::MatrixXd& of_state = is_state_equation ? filter.F : filter.M;
    const Eigen::MatrixXd& of_y = is_state_equation ? filter.E : filter.H;
    const Eigen::MatrixXd& of_u = is_state_equation ? filter.G : filter.K;
    for (Eigen::Index i = 0; i < of_state.rows(); ++i) {
      Lanes* row = &coefficients[first + static_cast<std::size_t>(i) * cols];
      for (Eigen::Index j = 0; j < of_state.cols(); ++j) {
        row[j].set(l, of_state(i, j));
      }
      Lanes* of_channels = row + block.order;
      for (Eigen::Index j = 0; j < of_y.cols(); ++j) {
        of_channels[j].set(l, -of_y(i, j));
      }
      for (Eigen::Index j = 0; j < of_u.cols(); ++j) {
        of_channels[of_y.cols() + j].set(l, of_u(i, j));
      }
    }
  }
}

void ResidualBank::State::add_course(const ResidualFilter& filter, const Destination& destination) {
  thresholds[destination.filter] = filter.threshold;
  if (filter.course) {
    courses.push_back(
        {CourseEvaluation(filter), destination.filter, destination.first_row, destination.rows});
  }
  if (filter.test) {
    tests.push_back(
        {SequentialStatistic(filter), destination.filter, destination.first_row, destination.rows});
  }
}

void ResidualBank::State::step_block(const Block& block) noexcept {
  const std::size_t cols = block.order + channel_count();
  const Lanes* coefficient = coefficients.data() + block.first_coefficient;
  const Lanes* v_k = v.data() + block.first_state;
  for (std::size_t i = 0; i < block.rows; ++i, coefficient += cols) {
    block_residual[i] = row_product(coefficient, v_k, block.order, sample.data(), sample.size());
  }
  for (std::size_t i = 0; i < block.order; ++i, coefficient += cols) {
    v_next[block.first_state + i] =
        row_product(coefficient, v_k, block.order, sample.data(), sample.size());
  }
}

// What observers and tests need beyond the linear part of the step.
void ResidualBank::State::step_more() noexcept {
  add_terms();
  set_thresholds();
  for (const PlacedCourse& placed : courses) {
    evaluation[placed.filter] = placed.course.evaluate(
        std::span<const double>(residual).subspan(placed.first_row, placed.rows), k);
  }
  for (PlacedTest& placed : tests) {
    evaluation[placed.filter] = placed.statistic.step(
        std::span<const double>(residual).subspan(placed.first_row, placed.rows));
  }
  ++k;
}

// To v_next, which holds the linear part.
void ResidualBank::State::add_terms() noexcept {
  for (const PlacedTerm& placed : terms) {
    const Lanes* v_k = &v[placed.first_state];
    const double excess =
        placed.term.excess([&](std::size_t i) { return v_k[i].get(placed.lane); }, sample);
    Lanes* next = &v_next[placed.first_state];
    for (std::size_t i = 0; i < placed.term.order(); ++i) {
      next[i].set(placed.lane, next[i].get(placed.lane) + placed.term.W()[i] * excess);
    }
  }
}

void ResidualBank::State::set_thresholds() noexcept {
  for (const PlacedCourse& placed : courses) {
    thresholds[placed.filter] = placed.course.threshold(k);
    const std::span<const double> rows = placed.course.rows(k);
    std::copy(rows.begin(), rows.end(),
              row_thresholds.begin() + static_cast<std::ptrdiff_t>(placed.first_row));
  }
}

void ResidualBank::State::deliver(const Block& block, const Destination* destination) noexcept {
  if (block.rows == 1) {
    for (std::size_t l = 0; l < block.filter_count; ++l, ++destination) {
      const double r = block_residual[0].get(l);
      residual[destination->first_row] = r;
      evaluation[destination->filter] = std::abs(r);
    }
    return;
  }
  for (std::size_t l = 0; l < block.filter_count; ++l, ++destination) {
    double* r = &residual[destination->first_row];
    double sum_of_squares = 0.0;
    for (std::size_t i = 0; i < destination->rows; ++i) {
      r[i] = block_residual[i].get(l);
      sum_of_squares += r[i] * r[i];
    }
    evaluation[destination->filter] =
        destination->rows == 1 ? std::abs(r[0]) : std::sqrt(sum_of_squares);
  }
}

ResidualBank::ResidualBank(const Bank& bank) : state_(std::make_unique<State>()) {
  State& state = *state_;
  state.output_count = bank.output_names.size();
  state.input_count = bank.input_names.size();
  for (const Eigen::VectorXd* point : {&bank.y_operating, &bank.u_operating}) {
    state.operating_point.insert(state.operating_point.end(), point->begin(), point->end());
  }
  state.sample.resize(state.channel_count());
  state.residual.resize(static_cast<std::size_t>(bank.residual_rows()));
  state.evaluation.resize(bank.filters.size());
  state.thresholds.resize(bank.filters.size());
  state.row_thresholds.assign(state.residual.size(), kNoThreshold);

  // Filters of equal order together, so that little is padded; otherwise in their own order.
  std::vector<std::size_t> by_order(bank.filters.size());
  std::iota(by_order.begin(), by_order.end(), std::size_t{0});
  std::stable_sort(by_order.begin(), by_order.end(), [&](std::size_t a, std::size_t b) {
    return bank.filters[a].F.rows() < bank.filters[b].F.rows();
  });
  std::vector<std::size_t> first_row(bank.filters.size());
  std::size_t row = 0;
  for (std::size_t i = 0; i < bank.filters.size(); ++i) {
    first_row[i] = row;
    row += static_cast<std::size_t>(bank.filters[i].H.rows());
  }
  for (const std::size_t i : by_order) {
    state.destinations.push_back(
        {i, first_row[i], static_cast<std::size_t>(bank.filters[i].H.rows())});
    state.add_course(bank.filters[i], state.destinations.back());
  }
  for (std::size_t i = 0; i < by_order.size(); i += kLanes) {
    state.add_block(bank, std::span(by_order).subspan(i, std::min(kLanes, by_order.size() - i)));
  }
  state.v_next.resize(state.v.size());
  state.has_more = !state.terms.empty() || !state.courses.empty() || !state.tests.empty();
  state.set_thresholds();
}

ResidualBank::~ResidualBank() = default;
ResidualBank::ResidualBank(ResidualBank&&) noexcept = default;
ResidualBank& ResidualBank::operator=(ResidualBank&&) noexcept = default;

void ResidualBank::step(std::span<const double> y, std::span<const double> u) noexcept {
  State& state = *state_;
  assert(y.size() == state.output_count && u.size() == state.input_count);
  for (std::size_t c = 0; c < y.size(); ++c) {
    state.sample[c] = y[c] - state.operating_point[c];
  }
  for (std::size_t c = 0; c < u.size(); ++c) {
    state.sample[y.size() + c] = u[c] - state.operating_point[y.size() + c];
  }
  const Destination* destination = state.destinations.data();
  for (const Block& block : state.blocks) {
    state.step_block(block);
    state.deliver(block, destination);
    destination += block.filter_count;
  }
  if (state.has_more) state.step_more();
  state.v.swap(state.v_next);
}

void ResidualBank::reset() noexcept {
  State& state = *state_;
  std::fill(state.v.begin(), state.v.end(), Lanes());
  std::fill(state.residual.begin(), state.residual.end(), 0.0);
  std::fill(state.evaluation.begin(), state.evaluation.end(), 0.0);
  for (PlacedTest& placed : state.tests) placed.statistic.restart();
  state.k = 0;
  state.set_thresholds();
}

void ResidualBank::restart_tests(std::span<const std::uint8_t> is_contaminated) noexcept {
  for (PlacedTest& placed : state_->tests) {
    if (is_contaminated[placed.filter] != 0) placed.statistic.restart();
  }
}

std::span<const double> ResidualBank::residual() const noexcept { return state_->residual; }

std::span<const double> ResidualBank::evaluation() const noexcept { return state_->evaluation; }

std::span<const double> ResidualBank::thresholds() const noexcept { return state_->thresholds; }

std::span<const double> ResidualBank::row_thresholds() const noexcept {
  return state_->row_thresholds;
}

std::size_t ResidualBank::filter_count() const noexcept { return state_->evaluation.size(); }

}  // namespace faultline
