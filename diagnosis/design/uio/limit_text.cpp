#include "diagnosis/design/uio/limit_text.h"

#include <cmath>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "diagnosis/design/subspace.h"

namespace faultline {
namespace {

std::string complex_text(std::complex<double> z) {
  return std::abs(z.imag()) < kRankTolerance ? fmt::format("{:.4g}", z.real())
                                             : fmt::format("{:.4g}{:+.4g}i", z.real(), z.imag());
}

// "u1 of 1, u2 of -0.5": entries of a fault vector that are not zero.
std::string sizes_text(const PlantModel& plant, const std::vector<std::size_t>& faults,
                       const Eigen::VectorXcd& sizes) {
  std::vector<std::string> parts;
  for (std::size_t j = 0; j < faults.size(); ++j) {
    const std::complex<double> size = sizes[static_cast<Eigen::Index>(j)];
    if (std::abs(size) > kRankTolerance) {
      parts.push_back(fmt::format("{} of {}", plant.faults[faults[j]].name, complex_text(size)));
    }
  }
  return fmt::format("{}", fmt::join(parts, " with "));
}

}  // namespace

std::string fixed_mode_text(const FixedMode& mode, bool is_decoupling) {
  const std::string where =
      mode.vertex < 0
          ? ""
          : fmt::format(" when the slopes are at corner {} of their bounds", mode.vertex + 1);
  if (is_decoupling) {
    return fmt::format(
        "decoupling leaves the mode {} that no gain makes stable{} (an invariant "
        "zero of the plant from the disturbances to the outputs): decouple fewer "
        "directions or measure more",
        complex_text(mode.lambda), where);
  }
  return fmt::format(
      "the outputs do not see the mode {}{}, which no gain makes stable: measure "
      "more, carry fewer faults as states or narrow the slopes",
      complex_text(mode.lambda), where);
}

std::string hidden_fault_text(const PlantModel& plant, const ObserverTask& task,
                              const HiddenFault& hidden, bool is_decoupling) {
  const std::string faults = sizes_text(plant, task.detect, hidden.m);
  const std::string course =
      hidden.angle_rad == 0.0
          ? fmt::format("a constant {}", faults)
          : fmt::format("{}, oscillating by {:.4g} rad per sample,", faults, hidden.angle_rad);
  const Eigen::VectorXcd carried = hidden.e.tail(std::ssize(task.carry));
  const char* const blind =
      is_decoupling ? " for an observer that decouples these disturbances" : "";
  if (carried.size() > 0 && carried.cwiseAbs().maxCoeff() > kRankTolerance) {
    return fmt::format(
        "{} looks exactly like {}{}: the residual stays at zero whatever the gain. "
        "Decouple less, carry fewer faults, or detect with one observer and "
        "estimate with another",
        course, sizes_text(plant, task.carry, -carried), blind);
  }
  return fmt::format("{} leaves the residual at zero whatever the gain{}: {}", course, blind,
                     is_decoupling ? "decouple less or measure more"
                                   : "no output shows it; measure more or choose another band");
}

}  // namespace faultline
