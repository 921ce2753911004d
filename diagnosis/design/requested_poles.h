#pragma once

#include <complex>
#include <string>
#include <vector>

#include "diagnosis/design/bank_request.h"
#include "diagnosis/design/geometric.h"
#include "diagnosis/design/pole_placement.h"

namespace faultline {

/// The poles that the request gives a residual of order d: the first d, or the only one d times.
/// @throws InputError there are fewer, or the last of them is half of a pair
[[nodiscard]] std::vector<std::complex<double>> requested_poles(const BankRequest& request,
                                                                const std::string& residual,
                                                                Eigen::Index d);

/// The request's decay: `decay_rate_per_s`, or what it comes to in a sample (as place_decay()).
/// @pre request.decay_rate_per_s
[[nodiscard]] double requested_decay(const BankRequest& request);

/// D_1 of the quotient's F by the request's poles or decay rate.
/// @throws InputError the poles cannot be had
[[nodiscard]] PolePlacement requested_placement(const BankRequest& request,
                                                const std::string& residual,
                                                const GeometricQuotient& quotient);

}  // namespace faultline
