#include "diagnosis/certify/filter_proof.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <stdexcept>

#include <fmt/format.h>

#include "diagnosis/certify/balance.h"
#include "diagnosis/certify/filter_loop.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::VectorXd;

// Of a step response that only peaks, what comes after the filter's slowest pole has died down to
// this part is not looked at.
constexpr double kDiedDown = 1e-4;
// L and J describe the response to a fault this well in the sampled domain, ..
constexpr double kExactResponse = 1e-6;
// .. and at least this well in the continuous one, however coarse the sampling.
constexpr double kLeastResponse = 0.5;
// A fault that has not fired after so many samples never does.
constexpr std::size_t kMostSamples = 200'000;

double largest_stable_radius(const Bank& bank) {
  double largest = 0.0;
  for (const ResidualFilter& filter : bank.filters) {
    const double radius = spectral_radius(filter.F);
    largest = radius < 1.0 ? std::max(largest, radius) : largest;
  }
  return largest;
}

// y between samples is taken as a line: off by the square of the sample time times the plant's
// rates, relative to a response to a held fault by one power less.
double response_tolerance(const PlantModel& plant, const Bank& bank) {
  if (is_sampled(bank.domain) || plant.n() == 0) {
    return kExactResponse;
  }
  const VectorXd scales = state_scales(plant.A, plant.B, plant.C);
  const Eigen::MatrixXd A = scales.cwiseInverse().asDiagonal() * plant.A * scales.asDiagonal();
  return std::clamp(A.norm() * bank.sample_time_s, kExactResponse, kLeastResponse);
}

std::size_t sample_count(double samples) {
  return static_cast<std::size_t>(std::ceil(std::min(samples, static_cast<double>(kMostSamples))));
}

// Samples in which a sequential test adds up to its threshold what a fault of twice the smallest
// leaves above it, without noise.
std::size_t samples_to_add_up(const ResidualFilter& filter) {
  if (!filter.test) return 0;
  const SequentialTest& test = *filter.test;
  const double h = filter.threshold;
  const double offset = *std::min_element(test.offset.begin(), test.offset.end());
  if (test.kind == TestKind::kCusum) {
    return sample_count(h / (test.reference + offset));
  }
  const double above = 2.0 * std::sqrt(2.0 * h / test.window) + offset;
  return sample_count(2.0 * h / (above * above));
}

// Norms of a step response per unit of one fault, as they come.
class StepRecord {
 public:
  explicit StepRecord(std::uint32_t dwell) : dwell_(dwell) {}

  void add(double norm) { norms_.push_back(norm); }

  /// The largest value that the norm exceeds, or is, for `dwell` samples in succession.
  [[nodiscard]] double held() const {
    double held = 0.0;
    for (std::size_t k = dwell_; k <= norms_.size(); ++k) {
      const auto end = norms_.begin() + static_cast<std::ptrdiff_t>(k);
      held = std::max(held, *std::min_element(end - dwell_, end));
    }
    return held;
  }

  /// Samples from the onset to the one at which a step of `size` fires; none: 0.
  [[nodiscard]] std::size_t firing_sample(double size, double threshold) const {
    std::uint32_t exceeded = 0;
    for (std::size_t k = 0; k < norms_.size(); ++k) {
      exceeded = size * norms_[k] > threshold ? exceeded + 1 : 0;
      if (exceeded == dwell_) {
        return k;
      }
    }
    return 0;
  }

 private:
  std::uint32_t dwell_;
  std::vector<double> norms_;
};

// Goes through the samples of the fault steps until every number asked for is known.
class FiringAnalysis {
 public:
  FiringAnalysis(const Bank& bank, const ResidualFilter& filter, double threshold,
                 const std::vector<double>& sizes)
      : bank_(bank),
        filter_(filter),
        threshold_(threshold),
        dwell_(std::max(bank.decision.dwell, 1u)) {
    for (std::size_t j = 0; j < filter.sees.size(); ++j) {
      records_.emplace_back(dwell_);
      const bool is_steady = filter.sees[j] == Sensitivity::kSteady && sizes[j] > 0.0;
      steady_size_.push_back(is_steady ? sizes[j] : 0.0);
      exceeded_.push_back(0);
      waiting_ += is_steady ? 1 : 0;
      has_transient_ = has_transient_ || filter.sees[j] == Sensitivity::kTransient;
    }
  }

  void run(FilterLoop::FaultStep step, double band) {
    const std::size_t horizon = std::min(
        kMostSamples, static_cast<std::size_t>(-std::log(kDiedDown) / band) +
                          static_cast<std::size_t>(filter_.F.rows()) + 2 * std::size_t{dwell_});
    for (std::size_t k = 0; k < kMostSamples; ++k) {
      if (waiting_ == 0 && (!has_transient_ || k >= horizon)) {
        break;
      }
      add(step.advance());
    }
  }

  void write(FilterCertificate& certificate) const {
    for (std::size_t j = 0; j < records_.size(); ++j) {
      double& smallest = certificate.smallest_fault[j];
      if (filter_.sees[j] == Sensitivity::kTransient && !filter_.test) {
        smallest = smallest_for(records_[j].held());
      }
      if (smallest > 0.0) {
        const std::size_t samples =
            records_[j].firing_sample(2.0 * smallest, threshold_) + samples_to_add_up(filter_);
        certificate.delay_s[j] = bank_.sample_time_s * static_cast<double>(samples);
      }
    }
  }

  [[nodiscard]] double smallest_for(double gain) const {
    const double smallest = gain > 0.0 ? threshold_ / gain : 0.0;
    return std::isfinite(smallest) ? smallest : 0.0;
  }

 private:
  void add(const VectorXd& norms) {
    for (std::size_t j = 0; j < records_.size(); ++j) {
      const double norm = norms[static_cast<Index>(j)];
      records_[j].add(norm);
      if (steady_size_[j] > 0.0 && exceeded_[j] < dwell_) {
        exceeded_[j] = 2.0 * steady_size_[j] * norm > threshold_ ? exceeded_[j] + 1 : 0;
        waiting_ -= exceeded_[j] == dwell_ ? 1 : 0;
      }
    }
  }

  const Bank& bank_;
  const ResidualFilter& filter_;
  double threshold_;  // of ResidualEvaluation
  std::uint32_t dwell_;
  std::vector<StepRecord> records_;
  std::vector<double> steady_size_;  // smallest fault of the steadily seen ones, else 0
  std::vector<std::uint32_t> exceeded_;
  int waiting_ = 0;  // steadily seen faults whose double has not fired yet
  bool has_transient_ = false;
};

// Gains over all frequencies, into the certificate.
class GainAnalysis {
 public:
  GainAnalysis(const PlantModel& plant, const Bank& bank, const FilterLoop& loop,
               FilterProof& proof)
      : plant_(plant), bank_(bank), loop_(loop), proof_(proof) {
    FilterCertificate& certificate = proof.certificate;
    const std::size_t m = plant.input_names.size();
    const std::size_t k = plant.faults.size();
    const std::size_t l = plant.disturbances.size();
    certificate.input_gain.resize(m);
    certificate.disturbance_gain.resize(l);
    certificate.fault_gain.resize(k);
    certificate.dc_gain.resize(k);
    certificate.band_gain.assign(k, std::numeric_limits<double>::infinity());
    proof.input_noise.resize(m);
    proof.disturbance_noise.resize(l);
    proof.fault_noise.resize(k);
    proof.stored_gain.resize(k);
    proof.internal_error.resize(k);
    rest_evaluation_.resize(k);
  }

  /// Per fault, per fault size: the evaluation of the residual at rest.
  [[nodiscard]] const std::vector<double>& rest_evaluation() const { return rest_evaluation_; }

  void add(double angle) {
    const FilterLoop::Gains gains = loop_.at(angle);
    FilterCertificate& certificate = proof_.certificate;
    std::size_t column = 0;
    for (std::size_t i = 0; i < certificate.input_gain.size(); ++i, ++column) {
      raise(certificate.input_gain[i], proof_.input_noise[i], gains, column, 1.0);
    }
    for (std::size_t j = 0; j < certificate.fault_gain.size(); ++j, ++column) {
      const double size = plant_.faults[j].size;
      raise(certificate.fault_gain[j], proof_.fault_noise[j], gains, column, size);
      const double gain = size * gains.gain[static_cast<Index>(column)];
      const double possible = size * gains.possible[static_cast<Index>(column)];
      const double shown = gain > rounding_error(possible) ? gain : 0.0;
      if (angle == 0.0) {
        certificate.dc_gain[j] = shown;
        const VectorXd response = gains.fault_response.col(static_cast<Index>(j)).real();
        rest_evaluation_[j] = shown > 0.0 ? size * loop_.evaluation().of(response) : 0.0;
      }
      if (angle <= loop_.band()) {
        certificate.band_gain[j] = std::min(certificate.band_gain[j], shown);
      }
      proof_.stored_gain[j] =
          std::max(proof_.stored_gain[j], size * gains.stored_gain[static_cast<Index>(j)]);
      proof_.internal_error[j] =
          std::max(proof_.internal_error[j], size * gains.internal_error[static_cast<Index>(j)]);
    }
    for (std::size_t i = 0; i < certificate.disturbance_gain.size(); ++i, ++column) {
      if (angle == 0.0 ||
          bank_.disturbances[i].treatment != BankDisturbance::Treatment::kConstant) {
        raise(certificate.disturbance_gain[i], proof_.disturbance_noise[i], gains, column, 1.0);
      }
    }
  }

 private:
  static void raise(double& gain, double& noise, const FilterLoop::Gains& gains, std::size_t column,
                    double size) {
    const auto at = static_cast<Index>(column);
    gain = std::max(gain, size * gains.gain[at]);
    noise = std::max(noise, size * rounding_error(gains.possible[at]));
  }

  const PlantModel& plant_;
  const Bank& bank_;
  const FilterLoop& loop_;
  FilterProof& proof_;
  std::vector<double> rest_evaluation_;
};

void check_finite(const ResidualFilter& filter, const FilterCertificate& certificate) {
  const auto is_finite = [](const std::vector<double>& values) {
    return std::all_of(values.begin(), values.end(), [](double x) { return std::isfinite(x); });
  };
  if (!is_finite(certificate.input_gain) || !is_finite(certificate.disturbance_gain) ||
      !is_finite(certificate.fault_gain) || !is_finite(certificate.dc_gain) ||
      !is_finite(certificate.band_gain) || !is_finite(certificate.margin)) {
    throw std::invalid_argument(
        fmt::format("residual {}: its gains or margins are not finite numbers: the entries of the "
                    "plant or the filter differ too much in size, scale the plant",
                    filter.name));
  }
}

}  // namespace

BankProof::BankProof(const PlantModel& plant, const Bank& bank)
    : plant_(plant),
      bank_(bank),
      loop_(plant, bank, largest_stable_radius(bank)),
      decoupling_(plant, bank),
      response_tolerance_(response_tolerance(plant, bank)) {}

FilterProof BankProof::prove(const ResidualFilter& filter) {
  const FilterLoop loop(loop_, filter);
  if (!(loop.spectral_radius() < 1.0)) {
    throw std::invalid_argument(
        fmt::format("residual {}: spectral radius {:.6g}, expected a "
                    "stable filter (below 1)",
                    filter.name, loop.spectral_radius()));
  }
  FilterProof proof;
  FilterCertificate& certificate = proof.certificate;
  certificate.spectral_radius = loop.spectral_radius();
  certificate.band_Hz = loop.band() / (2.0 * std::numbers::pi * bank_.sample_time_s);

  GainAnalysis gains(plant_, bank_, loop, proof);
  for (const double angle : loop_.angles()) {
    gains.add(angle);
  }
  for (const double angle : loop.own_angles()) {
    gains.add(angle);
  }
  const FilterLoop::ExactResponse exact = loop.exact_response(bank_.domain);
  for (std::size_t j = 0; j < plant_.faults.size(); ++j) {
    const double size = plant_.faults[j].size;
    proof.exact_error.push_back(size * exact.error[static_cast<Index>(j)]);
    proof.exact_noise.push_back(size * exact.noise[static_cast<Index>(j)]);
  }
  proof.response_tolerance = response_tolerance_;
  Decoupling decoupling = decoupling_.of(filter.ignores);
  certificate.margin = std::move(decoupling.margin);
  certificate.rank = decoupling.rank;
  check_finite(filter, certificate);

  const std::size_t k = plant_.faults.size();
  certificate.smallest_fault.assign(k, 0.0);
  certificate.delay_s.assign(k, 0.0);
  for (std::size_t j = 0; j < k; ++j) {
    const double evaluation = gains.rest_evaluation()[j];
    if (filter.sees[j] == Sensitivity::kSteady && evaluation > 0.0) {
      const double smallest = loop.evaluation().threshold() * plant_.faults[j].size / evaluation;
      certificate.smallest_fault[j] = std::isfinite(smallest) ? smallest : 0.0;
    }
  }
  FiringAnalysis firing(bank_, filter, loop.evaluation().threshold(), certificate.smallest_fault);
  firing.run(FilterLoop::FaultStep(loop_, loop), loop.band());
  firing.write(certificate);
  return proof;
}

}  // namespace faultline
