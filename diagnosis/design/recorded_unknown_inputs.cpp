#include "diagnosis/design/recorded_unknown_inputs.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <Eigen/SVD>
#include <fmt/format.h>

#include "diagnosis/design/innovation_spectrum.h"
#include "diagnosis/design/joined_matrices.h"
#include "diagnosis/model/discretize.h"
#include "diagnosis/model/riccati.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr std::size_t kSamplesPerState = 50;
// Where the search begins, in state ranges per second.
constexpr double kFirstGuess = 0.1;
// Noise that every output is taken to have at least, in its range: rounding on the bus.
constexpr double kLeastNoise = 1e-6;
// Eigenvalues are kept this far above zero: the filters need a Q that reaches every state.
constexpr double kLeastVariance = 1e-12;
// Likelihood per state that one more direction must gain. Its three or so parameters gain half a
// unit each by chance; what is no white noise, nor of one spectrum, gains some more.
constexpr double kWorthADirection = 10.0;
// And of what the first one gains: what leaks through the spectrum's windows looks like more.
constexpr double kLeakage = 5e-3;
// Innovations this much above what the file says are something else that acts: the mean of many
// thousand squares wanders by a few percent at most.
constexpr double kExplained = 1.3;
// Time constants of the filter until its start is forgotten (e^-5 < 1 %).
constexpr double kStartTimeConstants = 5.0;

struct SampledPlant {
  MatrixXd A, B, Gamma;
  VectorXd state_unit;
};

SampledPlant sampled(const PlantModel& plant, double sample_time_s) {
  const Index n = plant.n();
  SampledPlant result;
  result.state_unit = plant.state_range.value_or(VectorXd::Ones(n));
  if (plant.time == TimeDomain::kDiscrete) {
    result.A = plant.A;
    result.B = plant.B;
    result.Gamma = MatrixXd::Identity(n, n);
    return result;
  }
  const SampledSystem system =
      discretize_zoh(plant.A, side_by_side(plant.B, MatrixXd::Identity(n, n)), sample_time_s);
  result.A = system.A;
  result.B = system.B.leftCols(plant.m());
  result.Gamma = system.B.rightCols(n);
  return result;
}

MatrixXd noise_covariance(const PlantModel& plant) {
  MatrixXd R = MatrixXd::Zero(plant.q(), plant.q());
  for (const Noise& noise : plant.noises) {
    const double sigma = noise.sigma.value_or(noise.bound.value_or(0.0) / std::numbers::sqrt3);
    R += sigma * sigma * noise.output * noise.output.transpose();
  }
  R.diagonal() += (kLeastNoise * plant.output_range).cwiseAbs2();
  return R;
}

// Stationary filter and smoother for one Q.
struct Smoother {
  MatrixXd K;          // x̂ = x̂⁻ + K e
  MatrixXd S_inverse;  // of the innovation's covariance
  MatrixXd J;          // smoothed = filtered + J (next smoothed - next predicted)
  Index start = 0;     // samples until the start is forgotten
};

Smoother make_smoother(const SampledPlant& plant, const MatrixXd& C, const MatrixXd& Q,
                       const MatrixXd& R) {
  Smoother smoother;
  MatrixXd predicted;
  try {
    predicted = solve_dare(plant.A.transpose(), C.transpose(), Q, R);
  } catch (const std::invalid_argument& error) {
    throw UnusableRecord(fmt::format("no Kalman filter of this plant: {}", error.what()));
  }
  const Index n = plant.A.rows();
  const MatrixXd I = MatrixXd::Identity(n, n);
  smoother.S_inverse =
      (C * predicted * C.transpose() + R).ldlt().solve(MatrixXd::Identity(C.rows(), C.rows()));
  smoother.K = predicted * C.transpose() * smoother.S_inverse;
  const MatrixXd filtered = (I - smoother.K * C) * predicted;
  smoother.J = filtered * plant.A.transpose() * predicted.ldlt().solve(I);
  const MatrixXd loop = plant.A * (I - smoother.K * C);
  double norm = loop.norm();
  MatrixXd power = loop;
  Index samples = 1;
  while (norm > std::exp(-kStartTimeConstants) && samples < (Index{1} << 30)) {
    power = (power * power).eval();
    norm = power.norm();
    samples *= 2;
  }
  smoother.start = samples;
  return smoother;
}

// What one pass over the record finds.
struct Pass {
  std::vector<MatrixXd> innovations;  // q×samples per stretch, without its start
  double innovation = 0.0;            // Σ eᵀ S⁻¹ e
  std::size_t samples = 0;
};

// Unknown inputs by the innovation's spectrum, in units.
struct SpectralFit {
  MatrixXd rates;  // covariance
  Index rank = 0;
  std::vector<double> gains;  // of likelihood, per direction that was tried
};

class Record {
 public:
  Record(const PlantModel& plant, double sample_time_s,
         const std::vector<RecordedStretch>& stretches)
      : plant_(sampled(plant, sample_time_s)),
        C_(plant.C),
        D_(plant.D),
        R_(noise_covariance(plant)),
        stretches_(stretches) {}

  [[nodiscard]] const SampledPlant& plant() const { return plant_; }

  // @param each told of every smoothed w
  template <class OnNoise>
  Pass pass(const Smoother& smoother, const OnNoise& each) const {
    const Index n = plant_.A.rows();
    Pass result;
    for (const RecordedStretch& stretch : stretches_) {
      const Index count = stretch.y.cols();
      if (count <= 2 * smoother.start + 1) {
        continue;
      }
      MatrixXd innovations(C_.rows(), count - smoother.start);
      MatrixXd filtered(n, count);
      MatrixXd predicted(n, count + 1);
      predicted.col(0) =
          C_.completeOrthogonalDecomposition().solve(stretch.y.col(0) - D_ * stretch.u.col(0));
      for (Index k = 0; k < count; ++k) {
        const VectorXd e = stretch.y.col(k) - C_ * predicted.col(k) - D_ * stretch.u.col(k);
        filtered.col(k) = predicted.col(k) + smoother.K * e;
        predicted.col(k + 1) = plant_.A * filtered.col(k) + plant_.B * stretch.u.col(k);
        if (k >= smoother.start) {
          innovations.col(k - smoother.start) = e;
          result.innovation += e.dot(smoother.S_inverse * e);
        }
      }
      result.samples += static_cast<std::size_t>(count - smoother.start);
      result.innovations.push_back(std::move(innovations));
      VectorXd next = filtered.col(count - 1);
      for (Index k = count - 1; k-- > smoother.start;) {
        const VectorXd smoothed = filtered.col(k) + smoother.J * (next - predicted.col(k + 1));
        const VectorXd w = next - plant_.A * smoothed - plant_.B * stretch.u.col(k);
        if (k + smoother.start < count) {  // nor is the end smoothed yet
          each(w);
        }
        next = smoothed;
      }
    }
    return result;
  }

  // From units of state ranges per second to Q.
  [[nodiscard]] MatrixXd from_units(const MatrixXd& rates) const {
    const MatrixXd scaled = plant_.Gamma * plant_.state_unit.asDiagonal();
    return scaled * rates * scaled.transpose();
  }

  // What the spectrum of one filter's innovation says, in coordinates in which a state range per
  // second is one. Directions are added until one more is not worth it; `rank`: just so many.
  [[nodiscard]] SpectralFit fit(std::optional<Index> rank, Index most) const {
    const Index n = plant_.A.rows();
    const MatrixXd guess = from_units(kFirstGuess * kFirstGuess * MatrixXd::Identity(n, n));
    const Smoother filter = make_smoother(plant_, C_, guess, R_);
    const MatrixXd T = plant_.Gamma * plant_.state_unit.asDiagonal();
    const Eigen::PartialPivLU<MatrixXd> to_units(T);
    const MatrixXd L = plant_.A * filter.K;
    const InnovationSpectrum spectrum(
        {to_units.solve((plant_.A - L * C_) * T), to_units.solve(L), C_ * T, R_},
        pass(filter, [](const VectorXd&) {}).innovations);
    if (spectrum.windows() == 0.0) {
      throw UnusableRecord(
          "found no stretch of good samples long enough for a spectrum, expected some hundreds in "
          "a row in each half of the record");
    }
    SpectralFit result;
    InnovationSpectrum::Fit best = spectrum.without();
    const double worth = kWorthADirection * static_cast<double>(n);
    for (Index r = 1; r <= rank.value_or(most); ++r) {
      InnovationSpectrum::Fit next = most_likely_with_one_more(spectrum, best);
      result.gains.push_back(next.log_likelihood - best.log_likelihood);
      if (!rank && result.gains.back() < std::max(worth, kLeakage * result.gains.front())) {
        break;
      }
      best = std::move(next);
    }
    result.rates = best.covariance();
    result.rank = best.E.cols();
    return result;
  }

  // The likelihood has local maxima: from the steepest direction and from each state by itself.
  [[nodiscard]] static InnovationSpectrum::Fit most_likely_with_one_more(
      const InnovationSpectrum& spectrum, const InnovationSpectrum::Fit& fit) {
    const Index n = fit.E.rows();
    // As large as the smallest that is there, or as a first guess.
    const double size = fit.E.cols() == 0 ? kFirstGuess : 0.1 * fit.E.colwise().norm().minCoeff();
    InnovationSpectrum::Fit best =
        spectrum.most_likely(side_by_side(fit.E, size * spectrum.steepest(fit)));
    for (Index i = 0; i < n; ++i) {
      InnovationSpectrum::Fit other =
          spectrum.most_likely(side_by_side(fit.E, size * VectorXd::Unit(n, i)));
      if (other.log_likelihood > best.log_likelihood) {
        best = std::move(other);
      }
    }
    return best;
  }

  // Mean innovation square per output of the filter with so much of unknown inputs.
  [[nodiscard]] double innovation(const MatrixXd& rates) const {
    MatrixXd reachable = rates;
    reachable.diagonal().array() += kLeastVariance;
    const Pass found =
        pass(make_smoother(plant_, C_, from_units(reachable), R_), [](const VectorXd&) {});
    return found.samples == 0 ? 0.0
                              : found.innovation / static_cast<double>(found.samples) /
                                    static_cast<double>(C_.rows());
  }

  // Largest |d| of each direction, w = Γ E d.
  [[nodiscard]] VectorXd largest(const MatrixXd& rates, const MatrixXd& E) const {
    VectorXd most = VectorXd::Zero(E.cols());
    const MatrixXd to_d = (plant_.Gamma * E).completeOrthogonalDecomposition().pseudoInverse();
    static_cast<void>(
        pass(make_smoother(plant_, C_, from_units(rates), R_),
             [&](const VectorXd& w) { most = most.cwiseMax((to_d * w).cwiseAbs()); }));
    return most;
  }

 private:
  SampledPlant plant_;
  const MatrixXd& C_;
  const MatrixXd& D_;
  MatrixXd R_;
  const std::vector<RecordedStretch>& stretches_;
};

struct Spectrum {
  VectorXd values;  // descending
  MatrixXd vectors;
};

Spectrum spectrum_of(const MatrixXd& rates) {
  const Eigen::SelfAdjointEigenSolver<MatrixXd> solver(rates);
  return {solver.eigenvalues().reverse().cwiseMax(0.0), solver.eigenvectors().rowwise().reverse()};
}

double angle_deg(const MatrixXd& U, const MatrixXd& V) {
  const Eigen::JacobiSVD<MatrixXd> svd(U.transpose() * V);
  const double cosine = std::min(1.0, svd.singularValues().minCoeff());
  return std::acos(cosine) * 180.0 / std::numbers::pi;
}

// The first or the second half of every stretch.
std::vector<RecordedStretch> half_of(const std::vector<RecordedStretch>& stretches,
                                     bool is_second) {
  std::vector<RecordedStretch> halves;
  for (const RecordedStretch& stretch : stretches) {
    const Index half = stretch.y.cols() / 2;
    halves.push_back(is_second
                         ? RecordedStretch{stretch.y.rightCols(half), stretch.u.rightCols(half)}
                         : RecordedStretch{stretch.y.leftCols(half), stretch.u.leftCols(half)});
  }
  return halves;
}

}  // namespace

RecordedUnknownInputs find_unknown_inputs(const PlantModel& plant, double sample_time_s,
                                          const std::vector<RecordedStretch>& record,
                                          std::optional<Index> rank) {
  RecordedUnknownInputs found;
  for (const RecordedStretch& stretch : record) {
    found.samples += static_cast<std::size_t>(stretch.y.cols());
  }
  const std::size_t needed = kSamplesPerState * static_cast<std::size_t>(plant.n());
  if (found.samples < needed) {
    throw UnusableRecord(fmt::format("found {} good samples, expected at least {}: {} per state",
                                     found.samples, needed, kSamplesPerState));
  }
  const Index n = plant.n();
  const Record whole(plant, sample_time_s, record);
  found.innovation_before = whole.innovation(MatrixXd::Zero(n, n));
  if (!rank && found.innovation_before <= kExplained) {
    found.innovation_after = found.innovation_before;
    found.directions = MatrixXd(n, 0);
    return found;
  }
  const SpectralFit fit = whole.fit(rank ? std::min(*rank, n) : rank, std::min(plant.q(), n));
  const MatrixXd& rates = fit.rates;
  const Spectrum spectrum = spectrum_of(rates);
  found.rank = fit.rank;
  found.singular_values = spectrum.values.head(found.rank).cwiseSqrt();
  found.likelihood_gains = fit.gains;
  const MatrixXd U = spectrum.vectors.leftCols(found.rank);
  found.innovation_after = whole.innovation(rates);
  if (found.rank == 0) {
    found.directions = MatrixXd(n, 0);
    return found;
  }
  found.directions = whole.plant().state_unit.asDiagonal() * U;
  for (Index j = 0; j < found.rank; ++j) {
    Index at = 0;
    found.directions.col(j).cwiseAbs().maxCoeff(&at);
    const double sign = found.directions(at, j) < 0.0 ? -1.0 : 1.0;
    found.directions.col(j) *= sign / found.directions.col(j).norm();
  }
  MatrixXd reachable = rates;
  reachable.diagonal().array() += kLeastVariance;
  found.largest = whole.largest(reachable, found.directions);
  const std::vector<RecordedStretch> first = half_of(record, false);
  const std::vector<RecordedStretch> second = half_of(record, true);
  const auto spectrum_of_half = [&](const std::vector<RecordedStretch>& half) {
    return spectrum_of(Record(plant, sample_time_s, half).fit(found.rank, found.rank).rates);
  };
  const Spectrum of_first = spectrum_of_half(first);
  const Spectrum of_second = spectrum_of_half(second);
  found.halves_deg =
      angle_deg(of_first.vectors.leftCols(found.rank), of_second.vectors.leftCols(found.rank));
  return found;
}

}  // namespace faultline
