#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "diagnosis/bank/bank.h"

namespace faultline {

// Private to diagnosis/runtime.

/// The statistic of a SequentialTest, sample by sample. Real-time: `step` and `restart` neither
/// allocate nor throw; a GLR step looks at every sample of its window.
class SequentialStatistic {
 public:
  /// Precondition: filter.test is there.
  explicit SequentialStatistic(const ResidualFilter& filter);

  /// Takes the white residual of one sample; the statistic afterwards. NaN if there is one in it.
  double step(std::span<const double> r) noexcept;
  /// Forgets everything.
  void restart() noexcept;

 private:
  [[nodiscard]] double step_cusum(std::span<const double> r) noexcept;
  [[nodiscard]] double step_glr(std::span<const double> r) noexcept;
  [[nodiscard]] double likelihood(std::size_t row) const noexcept;

  TestKind kind_;
  double reference_;
  double limit_;  // of a CUSUM: what lasted long is not remembered longer
  std::vector<double> offset_;
  std::vector<double> up_, down_;  // CUSUM, per row
  std::vector<double> recent_;     // GLR: row by row, a ring of `window_`
  std::size_t window_ = 0;
  std::size_t next_ = 0;   // of the ring
  std::size_t count_ = 0;  // samples in it
};

}  // namespace faultline
