#include "diagnosis/runtime/estimator.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>
#include <optional>

#include <Eigen/QR>

#include "diagnosis/runtime/observer_step.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// A fault whose trace lies that close to what the past, or the other faults, can do (share of its
/// energy) is not estimated: 1e-6 of its amplitude. Rounding leaves 1e-28 of the energy.
constexpr double kSingular = 1e-12;
/// Share of the output errors' energy that the estimate must leave over to tell their size from.
constexpr double kLeastLeft = 1e-9;

/// One filter's part of the window: its rows of all samples, oldest first.
struct Part {
  Index first_row = 0;  // in the residual vector
  Index rows = 0;
  Index first_value = 0;  // in State::projected
  MatrixXd S;             // Π S: rows·window × faults
  MatrixXd Q;             // rows·window × rank
  // For response_delay().
  MatrixXd F, L, M, J;
  double threshold = 0.0;
  std::optional<CourseEvaluation> course;

  // Whether residual r would count as above the threshold that holds in the end.
  [[nodiscard]] bool is_above(const Eigen::Ref<const VectorXd>& r) const noexcept {
    constexpr std::size_t kEnd = std::numeric_limits<std::size_t>::max();
    return course
               ? course->evaluate({r.data(), static_cast<std::size_t>(r.size())}, kEnd) > threshold
               : r.norm() > threshold;
  }
};

struct Cost {
  double doubles = 0.0;
  double work = 0.0;
};

// Counted in doubles: sizes from a hostile file overflow integers.
Cost cost_of(const Bank& bank) {
  const double window = bank.decision.window;
  const auto faults = static_cast<double>(bank.fault_names.size());
  const auto outputs = static_cast<double>(bank.output_names.size());
  Cost cost;
  cost.doubles = window + 2.0 * faults * faults + outputs * (window + 1.0) * faults;
  cost.work = outputs * window * faults * faults;
  for (const ResidualFilter& filter : bank.filters) {
    const auto d = static_cast<double>(filter.F.rows());
    const auto rows = static_cast<double>(filter.H.rows());
    const double length = rows * window;
    const double rank = std::min(d, length);
    cost.doubles += length * (faults + rank + 2.0) + d * (d + faults + rows) + rows * faults;
    cost.work += length * d * (d + faults + outputs) + window * d * d * faults;  // O, S, T
    cost.work += 2.0 * length * rank * (d + rank + faults) + length * faults * faults;
    cost.work += window * (d + outputs) * (d + rows) * (faults + rank);
  }
  return cost;
}

// [M; MF; ..; MF^(N-1)]
MatrixXd observability(const ResidualFilter& filter, Index window) {
  const Index rows = filter.M.rows();
  MatrixXd O(rows * window, filter.M.cols());
  MatrixXd row = filter.M;
  for (Index t = 0; t < window; ++t) {
    O.middleRows(t * rows, rows) = row;
    row = (row * filter.F).eval();
  }
  return O;
}

// s_j(t) of all faults, stacked over t.
MatrixXd step_responses(const ResidualFilter& filter, Index window) {
  const Index rows = filter.J.rows();
  MatrixXd S(rows * window, filter.J.cols());
  MatrixXd e = MatrixXd::Zero(filter.L.rows(), filter.L.cols());
  for (Index t = 0; t < window; ++t) {
    S.middleRows(t * rows, rows) = filter.J + filter.M * e;
    e = (filter.F * e + filter.L).eval();
  }
  return S;
}

MatrixXd range_basis(const MatrixXd& O) {
  if (O.size() == 0) {
    return MatrixXd(O.rows(), 0);
  }
  const Eigen::ColPivHouseholderQR<MatrixXd> qr(O);
  return qr.householderQ() * MatrixXd::Identity(O.rows(), qr.rank());
}

// ‖T‖², T being block lower triangular with equal blocks along its diagonals.
double squared_norm_of_output_path(const ResidualFilter& filter, Index window) {
  double sum = static_cast<double>(window) * filter.H.squaredNorm();
  MatrixXd row = filter.M;
  for (Index t = 1; t < window; ++t) {
    sum += static_cast<double>(window - t) * (row * filter.E).squaredNorm();
    row = (row * filter.F).eval();
  }
  return sum;
}

// Tᵀ Z, q·window × Z.cols(), by the adjoint recursion backwards in time:
//   (TᵀZ)_t = -Hᵀ z_t - Eᵀ λ_t,   λ_t-1 = Mᵀ z_t + Fᵀ λ_t,   λ_N-1 = 0
MatrixXd through_output_path(const ResidualFilter& filter, Index window, const MatrixXd& Z) {
  const Index rows = filter.H.rows();
  const Index q = filter.H.cols();
  MatrixXd result(q * window, Z.cols());
  MatrixXd lambda = MatrixXd::Zero(filter.F.rows(), Z.cols());
  for (Index t = window - 1; t >= 0; --t) {
    const MatrixXd z = Z.middleRows(t * rows, rows);
    result.middleRows(t * q, q) = -(filter.H.transpose() * z) - filter.E.transpose() * lambda;
    lambda = (filter.M.transpose() * z + filter.F.transpose() * lambda).eval();
  }
  return result;
}

}  // namespace

std::string_view estimate_status_text(EstimateStatus status) noexcept {
  switch (status) {
    case EstimateStatus::kTooFewSamples:
      return "the window does not lie behind the onset yet";
    case EstimateStatus::kTransientOnly:
      return "a fault of the set is seen only in transients";
    case EstimateStatus::kDependent:
      return "faults of the set leave the same traces";
    case EstimateStatus::kTooLarge:
      return "bank and window are too large";
    case EstimateStatus::kSettling:
      return "settling";
    case EstimateStatus::kValid:
      break;
  }
  return "";
}

struct MagnitudeEstimator::State {
  State(const Bank& bank, std::span<const double> output_resolution);
  void add_part(const ResidualFilter& filter, MatrixXd& G);
  void project_window() noexcept;
  EstimateStatus solve() noexcept;
  bool factorise() noexcept;
  void solve_factorised(VectorXd& x) const noexcept;
  void find_deviations() noexcept;
  [[nodiscard]] double residual_energy() noexcept;

  bool is_too_large = false;
  Index rows = 0;  // of the residual vector
  Index window = 1;
  std::vector<Part> parts;
  VectorXd energy;          // per fault: Σ‖S_j‖², before the past is eliminated
  MatrixXd Gamma, Psi;      // faults × faults
  MatrixXd Standing;        // faults × outputs: Σ SᵀΠT times one deviation of a constant error
  double error_gain = 0.0;  // Σ‖ΠT‖²
  MatrixXd ring;            // rows × window
  Index next = 0;           // column of the ring that is written next
  Index filled = 0;         // samples in the ring
  std::uint32_t newest = 0;  // their last cycle
  VectorXd projected;        // Π r of all parts
  VectorXd past;             // Qᵀ r of one part
  // Of the set at hand, in the order of MagnitudeEstimate::faults; scaled by 1/√energy.
  MatrixXd factor;  // Cholesky, lower
  VectorXd m, column, standing;
  VectorXd e, e_next, L_m, r;  // for response_delay()
  MagnitudeEstimate estimate;
};

MagnitudeEstimator::State::State(const Bank& bank, std::span<const double> output_resolution) {
  const auto fault_count = static_cast<Index>(bank.fault_names.size());
  const std::size_t set_size = std::min(bank.concurrent, bank.fault_names.size());
  estimate.faults.reserve(set_size);
  estimate.value.reserve(set_size);
  estimate.deviation.reserve(set_size);
  estimate.bound.reserve(set_size);
  const Cost cost = cost_of(bank);
  assert(output_resolution.empty() || output_resolution.size() == bank.output_names.size());
  is_too_large = !(cost.doubles <= kMaxDoubles && cost.work <= kMaxWork);
  if (is_too_large) {
    return;
  }
  window = std::max<Index>(bank.decision.window, 1);
  energy = VectorXd::Zero(fault_count);
  Gamma = MatrixXd::Zero(fault_count, fault_count);
  MatrixXd G = MatrixXd::Zero(static_cast<Index>(bank.output_names.size()) * window, fault_count);
  Index largest_order = 0, largest_rank = 0, most_rows = 0;
  for (const ResidualFilter& filter : bank.filters) {
    add_part(filter, G);
    largest_order = std::max(largest_order, filter.F.rows());
    largest_rank = std::max(largest_rank, parts.back().Q.cols());
    most_rows = std::max(most_rows, filter.H.rows());
  }
  Psi = G.transpose() * G;
  Standing = MatrixXd::Zero(fault_count, static_cast<Index>(output_resolution.size()));
  const double uniform_deviation = 1.0 / std::sqrt(12.0);  // of a step of one
  for (Index t = 0; t < window && !output_resolution.empty(); ++t) {
    Standing += G.middleRows(t * Standing.cols(), Standing.cols()).transpose();
  }
  for (Index c = 0; c < Standing.cols(); ++c) {
    Standing.col(c) *= output_resolution[static_cast<std::size_t>(c)] * uniform_deviation;
  }
  ring = MatrixXd::Zero(rows, window);
  projected = VectorXd::Zero(rows * window);
  past = VectorXd::Zero(largest_rank);
  const auto n = static_cast<Index>(set_size);
  factor = MatrixXd::Zero(n, n);
  m = column = standing = VectorXd::Zero(n);
  e = e_next = L_m = VectorXd::Zero(largest_order);
  r = VectorXd::Zero(most_rows);
}

void MagnitudeEstimator::State::add_part(const ResidualFilter& filter, MatrixXd& G) {
  Part part;
  part.first_row = rows;
  part.rows = filter.H.rows();
  part.first_value = rows * window;
  part.S = step_responses(filter, window);
  part.Q = range_basis(observability(filter, window));
  energy += part.S.colwise().squaredNorm().transpose();
  // Twice: once leaves what rounding left of a large past.
  for (int pass = 0; pass < 2; ++pass) {
    const MatrixXd in_past = part.Q.transpose() * part.S;
    part.S.noalias() -= part.Q * in_past;
  }
  Gamma.noalias() += part.S.transpose() * part.S;
  G += through_output_path(filter, window, part.S);
  error_gain += squared_norm_of_output_path(filter, window) -
                through_output_path(filter, window, part.Q).squaredNorm();
  part.F = filter.F;
  part.L = filter.L;
  part.M = filter.M;
  part.J = filter.J;
  part.threshold = filter.threshold;
  if (filter.course) part.course.emplace(filter);
  rows += part.rows;
  parts.push_back(std::move(part));
}

// Π r of every part, oldest sample first.
void MagnitudeEstimator::State::project_window() noexcept {
  for (const Part& part : parts) {
    Eigen::Ref<VectorXd> values = projected.segment(part.first_value, part.rows * window);
    for (Index t = 0; t < window; ++t) {
      values.segment(t * part.rows, part.rows) =
          ring.col((next + t) % window).segment(part.first_row, part.rows);
    }
    Eigen::Ref<VectorXd> in_past = past.head(part.Q.cols());
    in_past.noalias() = part.Q.transpose() * values;
    values.noalias() -= part.Q * in_past;
  }
}

// Cholesky factor of Γ scaled so that each fault's own trace has energy 1 before elimination: its
// pivots are the shares that neither the past nor the faults before it can explain.
bool MagnitudeEstimator::State::factorise() noexcept {
  const std::vector<std::size_t>& set = estimate.faults;
  for (Index i = 0; i < static_cast<Index>(set.size()); ++i) {
    const auto a = static_cast<Index>(set[static_cast<std::size_t>(i)]);
    for (Index j = 0; j <= i; ++j) {
      const auto b = static_cast<Index>(set[static_cast<std::size_t>(j)]);
      double value = Gamma(a, b) / std::sqrt(energy[a] * energy[b]);
      for (Index k = 0; k < j; ++k) {
        value -= factor(i, k) * factor(j, k);
      }
      if (i != j) {
        factor(i, j) = value / factor(j, j);
      } else if (value > kSingular) {
        factor(i, i) = std::sqrt(value);
      } else {
        return false;
      }
    }
  }
  return true;
}

// x becomes Γ⁻¹ x, both of the set's size.
void MagnitudeEstimator::State::solve_factorised(VectorXd& x) const noexcept {
  const std::vector<std::size_t>& set = estimate.faults;
  const auto n = static_cast<Index>(set.size());
  const auto scale = [&](Index i) {
    return std::sqrt(energy[static_cast<Index>(set[static_cast<std::size_t>(i)])]);
  };
  for (Index i = 0; i < n; ++i) {
    x[i] /= scale(i);
    for (Index k = 0; k < i; ++k) {
      x[i] -= factor(i, k) * x[k];
    }
    x[i] /= factor(i, i);
  }
  for (Index i = n - 1; i >= 0; --i) {
    for (Index k = i + 1; k < n; ++k) {
      x[i] -= factor(k, i) * x[k];
    }
    x[i] /= factor(i, i);
  }
  for (Index i = 0; i < n; ++i) {
    x[i] /= scale(i);
  }
}

EstimateStatus MagnitudeEstimator::State::solve() noexcept {
  const std::vector<std::size_t>& set = estimate.faults;
  for (const std::size_t fault : set) {
    const auto j = static_cast<Index>(fault);
    if (!(Gamma(j, j) > kSingular * energy[j])) {
      return EstimateStatus::kTransientOnly;
    }
  }
  if (!factorise()) {
    return EstimateStatus::kDependent;
  }
  project_window();
  for (std::size_t i = 0; i < set.size(); ++i) {
    double sum = 0.0;
    for (const Part& part : parts) {
      sum += part.S.col(static_cast<Index>(set[i]))
                 .dot(projected.segment(part.first_value, part.rows * window));
    }
    m[static_cast<Index>(i)] = -sum;
  }
  solve_factorised(m);
  for (std::size_t i = 0; i < set.size(); ++i) {
    estimate.value.push_back(m[static_cast<Index>(i)]);
    estimate.bound.push_back(MagnitudeEstimate::kUnknown);
  }
  find_deviations();
  return EstimateStatus::kValid;
}

// Σ‖Π(r + S m)‖²
double MagnitudeEstimator::State::residual_energy() noexcept {
  double sum = 0.0;
  for (const Part& part : parts) {
    Eigen::Ref<VectorXd> values = projected.segment(part.first_value, part.rows * window);
    for (std::size_t i = 0; i < estimate.faults.size(); ++i) {
      values += estimate.value[i] * part.S.col(static_cast<Index>(estimate.faults[i]));
    }
    sum += values.squaredNorm();
  }
  return sum;
}

void MagnitudeEstimator::State::find_deviations() noexcept {
  const std::vector<std::size_t>& set = estimate.faults;
  const auto n = static_cast<Index>(set.size());
  const auto fault = [&](Index i) { return static_cast<Index>(set[static_cast<std::size_t>(i)]); };
  double taken = 0.0;  // tr Γ⁻¹Ψ
  for (Index i = 0; i < n; ++i) {
    column.setZero();
    column[i] = 1.0;
    solve_factorised(column);
    double variance = 0.0;  // per σ²
    for (Index a = 0; a < n; ++a) {
      double weighted = 0.0;
      for (Index b = 0; b < n; ++b) {
        weighted += Psi(fault(a), fault(b)) * column[b];
      }
      variance += column[a] * weighted;
      taken += a == i ? weighted : 0.0;
    }
    double standing_variance = 0.0;
    for (Index c = 0; c < Standing.cols(); ++c) {
      double effect = 0.0;
      for (Index a = 0; a < n; ++a) {
        effect += column[a] * Standing(fault(a), c);
      }
      standing_variance += effect * effect;
    }
    estimate.deviation.push_back(std::max(variance, 0.0));
    standing[i] = standing_variance;
  }
  const double left = error_gain - taken;
  const bool is_known = left > kLeastLeft * error_gain;
  const double sigma_squared = is_known ? residual_energy() / left : 0.0;
  for (std::size_t i = 0; i < set.size(); ++i) {
    double& deviation = estimate.deviation[i];  // a variance per σ² until here
    deviation = is_known ? std::sqrt(sigma_squared * deviation + standing[static_cast<Index>(i)])
                         : MagnitudeEstimate::kUnknown;
  }
}

MagnitudeEstimator::MagnitudeEstimator(const Bank& bank, std::span<const double> output_resolution)
    : state_(std::make_unique<State>(bank, output_resolution)) {}
MagnitudeEstimator::~MagnitudeEstimator() = default;
MagnitudeEstimator::MagnitudeEstimator(MagnitudeEstimator&&) noexcept = default;
MagnitudeEstimator& MagnitudeEstimator::operator=(MagnitudeEstimator&&) noexcept = default;

void MagnitudeEstimator::push(std::uint32_t cycle, std::span<const double> residual) noexcept {
  State& state = *state_;
  if (state.is_too_large) {
    return;
  }
  assert(static_cast<Index>(residual.size()) == state.rows);
  const bool follows = cycle == state.newest + 1;
  const bool is_finite =
      std::all_of(residual.begin(), residual.end(), [](double r) { return std::isfinite(r); });
  if (!follows || !is_finite) {
    restart();
  }
  if (!is_finite) {
    return;
  }
  std::copy(residual.begin(), residual.end(), state.ring.col(state.next).data());
  state.next = (state.next + 1) % state.window;
  state.filled = std::min(state.filled + 1, state.window);
  state.newest = cycle;
}

void MagnitudeEstimator::restart() noexcept {
  state_->next = 0;
  state_->filled = 0;
}

bool MagnitudeEstimator::is_window_behind(std::int64_t cycle) const noexcept {
  const State& state = *state_;
  if (state.is_too_large || state.filled < state.window) {
    return false;
  }
  // Cycles wrap at 2^32, and so does this difference.
  const std::uint32_t samples_since = state.newest - static_cast<std::uint32_t>(cycle);
  return cycle < 0 || samples_since >= static_cast<std::uint32_t>(state.window - 1);
}

const MagnitudeEstimate& MagnitudeEstimator::estimate(std::span<const std::size_t> faults,
                                                      std::int64_t last_crossing_cycle) noexcept {
  State& state = *state_;
  MagnitudeEstimate& estimate = state.estimate;
  assert(faults.size() <= estimate.faults.capacity());
  estimate.faults.assign(faults.begin(), faults.end());
  estimate.value.clear();
  estimate.deviation.clear();
  estimate.bound.clear();
  if (state.is_too_large) {
    estimate.status = EstimateStatus::kTooLarge;
  } else if (!is_window_behind(last_crossing_cycle)) {
    estimate.status = EstimateStatus::kTooFewSamples;
  } else {
    estimate.status = state.solve();
  }
  return estimate;
}

std::optional<std::uint32_t> MagnitudeEstimator::response_delay(std::size_t filter) noexcept {
  State& state = *state_;
  if (state.estimate.status != EstimateStatus::kValid) {
    return std::nullopt;
  }
  const Part& part = state.parts[filter];
  Eigen::Ref<VectorXd> e = state.e.head(part.F.rows());
  Eigen::Ref<VectorXd> e_next = state.e_next.head(part.F.rows());
  Eigen::Ref<VectorXd> L_m = state.L_m.head(part.F.rows());
  Eigen::Ref<VectorXd> r = state.r.head(part.rows);
  e.setZero();
  L_m.setZero();
  for (std::size_t i = 0; i < state.estimate.faults.size(); ++i) {
    L_m += state.estimate.value[i] * part.L.col(static_cast<Index>(state.estimate.faults[i]));
  }
  for (Index t = 0; t < state.window; ++t) {
    r.noalias() = part.M * e;
    for (std::size_t i = 0; i < state.estimate.faults.size(); ++i) {
      r -= state.estimate.value[i] * part.J.col(static_cast<Index>(state.estimate.faults[i]));
    }
    if (part.is_above(r)) {
      return static_cast<std::uint32_t>(t);
    }
    e_next.noalias() = part.F * e;
    e = e_next - L_m;
  }
  return std::nullopt;
}

}  // namespace faultline
