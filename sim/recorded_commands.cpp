#include "sim/recorded_commands.h"

#include <algorithm>
#include <utility>

namespace faultline {
namespace {

/// Times of a file and of cycles are rounded differently: a row is of a cycle that begins so little
/// before it, in sample times.
constexpr double kRounding = 1e-6;

}  // namespace

RecordedCommands::RecordedCommands(std::shared_ptr<const RecordedSignal> record,
                                   std::vector<std::optional<std::size_t>> columns,
                                   CommandBase base, double sample_time_s)
    : record_(std::move(record)),
      columns_(std::move(columns)),
      base_(std::move(base)),
      sample_time_s_(sample_time_s),
      u_(base_.feedforward.size()) {
  for (std::size_t i = 0; i < columns_.size(); ++i) {
    if (columns_[i]) base_.feedforward[static_cast<Eigen::Index>(i)] = 0.0;
  }
}

void RecordedCommands::command(std::uint32_t k, std::span<const double> /*y*/,
                               std::span<double> u) noexcept {
  const double since_s = (k + kRounding) * sample_time_s_;
  base_.begin(k, u_);
  for (std::size_t i = 0; i < columns_.size(); ++i) {
    if (!columns_[i]) continue;
    u_[static_cast<Eigen::Index>(i)] +=
        record_->value(*columns_[i], since_s, RecordedSignal::Between::kHold, false);
  }
  base_.limit(u_);
  std::copy(u_.begin(), u_.end(), u.begin());
}

}  // namespace faultline
