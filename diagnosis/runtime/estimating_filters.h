#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "diagnosis/bank/bank.h"
#include "diagnosis/runtime/estimator.h"

namespace faultline {

/// The estimates that filters make themselves (FaultEstimation): the residual is the size of the
/// fault, with a proved bound, if the fault is constant, acts alone, and began at least
/// `settle_samples` ago. Whenever it begins or changes so much that it is seen, a residual crosses:
/// so the samples are counted from the last crossing of any residual, and from the last bad sample.
///
/// Nothing here allocates after construction. Use from one thread.
class EstimatingFilters {
 public:
  explicit EstimatingFilters(const Bank& bank);

  /// Takes the fired residuals (Evaluator::fired()) and the residuals (ResidualBank::residual()) of
  /// a good sample. A cycle that does not follow the one before settles again.
  void push(std::uint32_t cycle, std::span<const std::uint8_t> fired,
            std::span<const double> residual) noexcept;
  /// A bad sample: the filters settle again.
  void restart() noexcept { samples_since_ = 0; }

  /// True if a filter estimates this set: a single fault.
  [[nodiscard]] bool can_estimate(std::span<const std::size_t> faults) const noexcept;
  /// True if the filter that estimates the set has settled. @pre can_estimate(faults)
  [[nodiscard]] bool is_settled(std::span<const std::size_t> faults) const noexcept;
  /// The estimate after the last sample, or EstimateStatus::kSettling; its deviation is unknown,
  /// its bound is FaultEstimation::bound. @pre can_estimate(faults)
  /// @return valid until the next call.
  const MagnitudeEstimate& estimate(std::span<const std::size_t> faults) noexcept;

 private:
  struct Source {
    std::size_t row = 0;
    double bound = 0.0;
    std::uint32_t settle_samples = 0;
  };

  std::uint64_t dwell_;
  std::vector<std::optional<Source>> sources_;  // per fault; of several filters the best
  std::vector<std::uint8_t> fired_;
  std::vector<double> residual_;
  std::uint32_t newest_ = 0;         // cycle of the last sample
  std::uint64_t samples_since_ = 0;  // the last crossing began, or a sample was bad
  MagnitudeEstimate estimate_;
};

}  // namespace faultline
