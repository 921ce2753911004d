#include "diagnosis/design/requested_poles.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

namespace faultline {

using Eigen::Index;
using Poles = std::vector<std::complex<double>>;

Poles requested_poles(const BankRequest& request, const std::string& residual, Index d) {
  const auto count = static_cast<std::size_t>(d);
  if (request.poles.size() == 1) {
    return Poles(count, request.poles.front());
  }
  if (request.poles.size() < count) {
    throw request_error(request, "poles",
                        fmt::format("found {} poles, expected {}: residual {} has order {}",
                                    request.poles.size(), count, residual, count));
  }
  const Poles poles(request.poles.begin(), request.poles.begin() + d);
  const auto complex_count = std::count_if(poles.begin(), poles.end(),
                                           [](const auto& pole) { return pole.imag() != 0.0; });
  if (complex_count % 2 != 0) {  // pairs stand together: only the last one can be split
    throw request_error(
        request, "poles",
        fmt::format("residual {} has order {}, and the first {} poles split the "
                    "complex pair {}{:+}i, expected a real pole there",
                    residual, count, count, poles.back().real(), poles.back().imag()));
  }
  return poles;
}

double requested_decay(const BankRequest& request) {
  const double rate = request.decay_rate_per_s.value_or(0.0);
  return is_sampled(request.domain) ? std::exp(-rate * request.sample_time_s) : rate;
}

PolePlacement requested_placement(const BankRequest& request, const std::string& residual,
                                  const GeometricQuotient& quotient) {
  const Index d = quotient.A_0.rows();
  if (request.decay_rate_per_s) {
    return place_decay(quotient.A_0, quotient.M, requested_decay(request),
                       is_sampled(request.domain));
  }
  PolePlacement placement =
      place_poles(quotient.A_0, quotient.M, requested_poles(request, residual, d));
  if (!placement.is_possible) {
    throw request_error(request, "poles",
                        fmt::format("residual {} has order {}; {}", residual, d, placement.reason));
  }
  return placement;
}

}  // namespace faultline
