#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <vector>

#include <Eigen/Core>

#include "sim/command_base.h"
#include "sim/controller.h"
#include "sim/recorded_signal.h"

namespace faultline {

/// Commands as a record has them, held from row to row, the last for ever; its first row is that of
/// cycle 0:
///
///   u_k = clamp(record(k T) + a sin(ω k), u_min, u_max)
///
/// Absolute. An input that the record does not have gets its CommandBase.
class RecordedCommands final : public Controller {
 public:
  /// @param columns per input: its signal in the record, if it has one. @pre sample_time_s > 0
  RecordedCommands(std::shared_ptr<const RecordedSignal> record,
                   std::vector<std::optional<std::size_t>> columns, CommandBase base,
                   double sample_time_s);
  void command(std::uint32_t k, std::span<const double> y, std::span<double> u) noexcept override;

 private:
  std::shared_ptr<const RecordedSignal> record_;
  std::vector<std::optional<std::size_t>> columns_;
  CommandBase base_;
  double sample_time_s_;
  Eigen::VectorXd u_;
};

}  // namespace faultline
