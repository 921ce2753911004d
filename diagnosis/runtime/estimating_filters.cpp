#include "diagnosis/runtime/estimating_filters.h"

#include <algorithm>
#include <cassert>
#include <cmath>

namespace faultline {

EstimatingFilters::EstimatingFilters(const Bank& bank)
    : dwell_(std::max<std::uint32_t>(bank.decision.dwell, 1)),
      sources_(bank.fault_names.size()),
      fired_(bank.filters.size()),
      residual_(static_cast<std::size_t>(bank.residual_rows())) {
  std::size_t row = 0;
  for (const ResidualFilter& filter : bank.filters) {
    if (const auto& estimation = filter.estimation) {
      std::optional<Source>& source = sources_[estimation->fault];
      if (!source || estimation->bound < source->bound) {
        source = {row, estimation->bound, estimation->settle_samples};
      }
    }
    row += static_cast<std::size_t>(filter.H.rows());
  }
  estimate_.faults.reserve(1);
  estimate_.value.reserve(1);
  estimate_.deviation.reserve(1);
  estimate_.bound.reserve(1);
}

void EstimatingFilters::push(std::uint32_t cycle, std::span<const std::uint8_t> fired,
                             std::span<const double> residual) noexcept {
  assert(fired.size() == fired_.size() && residual.size() == residual_.size());
  samples_since_ = cycle == newest_ + 1 ? samples_since_ + 1 : 0;
  newest_ = cycle;
  if (!std::equal(fired.begin(), fired.end(), fired_.begin())) {
    // The run that makes a residual cross is `dwell` samples long, this one the last of them.
    samples_since_ = std::min(samples_since_, dwell_ - 1);
    std::copy(fired.begin(), fired.end(), fired_.begin());
  }
  std::copy(residual.begin(), residual.end(), residual_.begin());
}

bool EstimatingFilters::can_estimate(std::span<const std::size_t> faults) const noexcept {
  return faults.size() == 1 && sources_[faults[0]].has_value();
}

bool EstimatingFilters::is_settled(std::span<const std::size_t> faults) const noexcept {
  const Source& source = *sources_[faults[0]];
  return samples_since_ >= source.settle_samples && std::isfinite(residual_[source.row]);
}

const MagnitudeEstimate& EstimatingFilters::estimate(std::span<const std::size_t> faults) noexcept {
  assert(can_estimate(faults));
  estimate_.faults.assign(faults.begin(), faults.end());
  estimate_.value.clear();
  estimate_.deviation.clear();
  estimate_.bound.clear();
  estimate_.status = is_settled(faults) ? EstimateStatus::kValid : EstimateStatus::kSettling;
  if (estimate_.status == EstimateStatus::kValid) {
    const Source& source = *sources_[faults[0]];
    estimate_.value.push_back(residual_[source.row]);
    estimate_.deviation.push_back(MagnitudeEstimate::kUnknown);
    estimate_.bound.push_back(source.bound);
  }
  return estimate_;
}

}  // namespace faultline
