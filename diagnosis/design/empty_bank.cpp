#include "diagnosis/design/empty_bank.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "diagnosis/design/requested_disturbances.h"
#include "diagnosis/model/digest.h"

namespace faultline {
namespace {

// The window of the fault size estimate, in time constants of the slowest filter: long enough to
// tell a step from what the filter still remembers, e^-5 < 1 %. Between sensible bounds, in
// samples.
constexpr double kWindowTimeConstants = 5.0;
constexpr double kSmallestWindow = 10.0;
constexpr double kLargestWindow = 1000.0;

}  // namespace

namespace {

ThresholdBasis threshold_basis(const PlantModel& plant, const BankRequest& request) {
  ThresholdBasis basis;
  basis.kind = request.threshold_kind;
  basis.jitter_s = request.jitter_s;
  basis.false_alarms_per_h = request.false_alarms_per_h;
  if (!request.resolution.empty()) basis.output_resolution = Eigen::VectorXd::Zero(plant.q());
  for (const auto& [name, lsb] : request.resolution) {
    const auto found = std::find(plant.output_names.begin(), plant.output_names.end(), name);
    if (found == plant.output_names.end()) {
      throw request_error(request, "decision",
                          fmt::format("resolution: found \"{}\", expected outputs of the plant: {} "
                                      "(commands are read as they act)",
                                      name, fmt::join(plant.output_names, ", ")));
    }
    basis.output_resolution[found - plant.output_names.begin()] = lsb;
  }
  if (basis.jitter_s > 0.0 && plant.time == TimeDomain::kDiscrete) {
    throw request_error(
        request, "decision",
        "jitter_s: found it, expected none: the plant is discrete, there is nothing "
        "between its samples");
  }
  return basis;
}

}  // namespace

FilterCertificate empty_certificate(const PlantModel& plant) {
  const std::vector<double> per_fault(plant.faults.size());
  FilterCertificate certificate;
  certificate.input_gain.resize(plant.input_names.size());
  certificate.disturbance_gain.resize(plant.disturbances.size());
  for (auto* values : {&certificate.fault_gain, &certificate.dc_gain, &certificate.band_gain,
                       &certificate.margin, &certificate.smallest_fault, &certificate.delay_s}) {
    *values = per_fault;
  }
  return certificate;
}

Bank bank_without_filters(const PlantModel& plant, const BankRequest& request) {
  Bank bank;
  bank.name = request.name;
  bank.method = request.method;
  bank.plant_name = plant.name;
  bank.plant_digest = plant_digest(plant);
  bank.request_digest = text_digest(request.text);
  bank.domain = request.domain;
  bank.sample_time_s = request.sample_time_s;
  bank.concurrent = request.concurrent;
  bank.input_names = plant.input_names;
  bank.output_names = plant.output_names;
  bank.fault_names = plant.fault_names();
  for (const Fault& fault : plant.faults) {
    bank.fault_sizes.push_back(fault.size);
  }
  bank.disturbances = disturbance_treatments(plant, request);
  bank.u_operating = plant.u_operating;
  bank.y_operating = plant.y_operating;
  bank.decision = request.decision;
  bank.thresholds = threshold_basis(plant, request);
  return bank;
}

std::uint32_t estimate_window(const std::vector<ResidualFilter>& filters) {
  double window = kSmallestWindow;
  for (const ResidualFilter& filter : filters) {
    if (const double radius = spectral_radius(filter.F); radius > 0.0) {
      window = std::max(window, std::ceil(-kWindowTimeConstants / std::log(radius)));
    }
  }
  return static_cast<std::uint32_t>(std::min(window, kLargestWindow));
}

}  // namespace faultline
