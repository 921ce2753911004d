#include "sim/reference.h"

#include <utility>

namespace faultline {

Reference::Reference(Eigen::VectorXd start, std::vector<ReferenceStep> steps, double sample_time_s)
    : start_(std::move(start)), steps_(std::move(steps)), sample_time_s_(sample_time_s) {
  if (steps_.empty()) return;
  pieces_.resize(static_cast<std::size_t>(start_.size()));
  for (const ReferenceStep& step : steps_) {
    std::vector<Piece>& pieces = pieces_[static_cast<std::size_t>(step.output)];
    const double from = pieces.empty() ? start_[step.output] : pieces.back().value(step.at_s);
    pieces.push_back({step.at_s, from, step.value, step.ramp_s});
  }
}

double Reference::Piece::value(double t_s) const noexcept {
  const double elapsed_s = t_s - at_s;
  if (elapsed_s >= ramp_s) return to;
  return from + (to - from) * (elapsed_s / ramp_s);
}

void Reference::at(std::uint32_t k, Eigen::VectorXd& y) const noexcept {
  y = start_;
  const double t_s = static_cast<double>(k) * sample_time_s_;
  for (std::size_t output = 0; output < pieces_.size(); ++output) {
    for (const Piece& piece : pieces_[output]) {
      if (t_s < piece.at_s) break;
      y[static_cast<Eigen::Index>(output)] = piece.value(t_s);
    }
  }
}

}  // namespace faultline
