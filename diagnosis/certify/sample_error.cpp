#include "diagnosis/certify/sample_error.h"

#include <stdexcept>

#include <fmt/format.h>

#include "diagnosis/certify/l1_norm.h"

namespace faultline {

SampleErrorGain sample_error_gain(const ResidualFilter& filter) {
  try {
    return {l1_norm({filter.F, filter.E, filter.M, filter.H}),
            l1_norm({filter.F, filter.G, filter.M, filter.K})};
  } catch (const std::invalid_argument& error) {
    throw std::invalid_argument(fmt::format("{}: {}", filter.name, error.what()));
  }
}

}  // namespace faultline
