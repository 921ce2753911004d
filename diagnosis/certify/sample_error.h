#pragma once

#include <Eigen/Core>

#include "diagnosis/bank/bank.h"

namespace faultline {

/// What errors of the samples do to a residual: with |y error| <= δ_y and |u error| <= δ_u in each
/// sample, whatever their courses, row i of r is off by at most (output δ_y + input δ_u)_i; that is
/// attained.
///
///   output = |H| + Σ_k |M F^k E|,  input = |K| + Σ_k |M F^k G|   (element by element)
///
/// the l1 norms of the impulse responses (l1_norm()).
struct SampleErrorGain {
  Eigen::MatrixXd output;  ///< rows×q
  Eigen::MatrixXd input;   ///< rows×m
};

/// @throws std::invalid_argument the filter is not stable, or forgets too slowly: more than ten
///   million samples.
[[nodiscard]] SampleErrorGain sample_error_gain(const ResidualFilter& filter);

}  // namespace faultline
