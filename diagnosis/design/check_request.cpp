#include "diagnosis/design/check_request.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <string>

#include <fmt/format.h>

#include "diagnosis/bank/bank.h"

namespace faultline {
namespace {

// What may have been meant: the pole mirrored at the border of the stable region.
std::string nearest_stable(std::complex<double> pole, bool is_discrete) {
  if (pole == 0.0) {
    return "; dead-beat, 0, is stable in the sampled domains only";
  }
  if (!is_discrete && pole.real() == 0.0) {
    return "; an undamped pole never settles";
  }
  const std::complex<double> mirrored =
      is_discrete ? 1.0 / std::conj(pole) : std::complex<double>(-pole.real(), pole.imag());
  if (is_discrete && std::abs(mirrored) >= 1.0) {
    return "; an undamped pole never settles";
  }
  return mirrored.imag() == 0.0
             ? fmt::format("; did you mean {:.4g}?", mirrored.real())
             : fmt::format("; did you mean {:.4g}{:+.4g}i?", mirrored.real(), mirrored.imag());
}

void check_poles(const BankRequest& request) {
  const bool is_discrete = is_sampled(request.domain);
  if (request.decay_rate_per_s) {
    if (!(*request.decay_rate_per_s > 0.0) || !std::isfinite(*request.decay_rate_per_s)) {
      throw request_error(
          request, "decay_rate_per_s",
          fmt::format("found {}, expected a positive number", *request.decay_rate_per_s));
    }
    return;
  }
  if (request.poles.empty()) {
    throw request_error(request, "poles", "found no pole, expected at least one");
  }
  for (std::size_t i = 0; i < request.poles.size(); ++i) {
    const std::complex<double> pole = request.poles[i];
    const bool is_finite = std::isfinite(pole.real()) && std::isfinite(pole.imag());
    if (!is_finite || !(is_discrete ? std::abs(pole) < 1.0 : pole.real() < 0.0)) {
      throw request_error(request, "poles",
                          fmt::format("found {}{:+}i, expected {}{}", pole.real(), pole.imag(),
                                      is_discrete ? "poles inside the unit circle (domain = "
                                                    "\"sampled\": z plane)"
                                                  : "negative real parts",
                                      is_finite ? nearest_stable(pole, is_discrete) : ""));
    }
    if (pole.imag() == 0.0) {
      continue;
    }
    if (i + 1 == request.poles.size() || request.poles[i + 1] != std::conj(pole)) {
      throw request_error(request, "poles",
                          fmt::format("found {}{:+}i alone, expected its conjugate behind it",
                                      pole.real(), pole.imag()));
    }
    ++i;
  }
}

void check_time(const PlantModel& plant, const BankRequest& request) {
  if (!(request.sample_time_s > 0.0) || !std::isfinite(request.sample_time_s)) {
    throw request_error(request, "sample_time_s",
                        fmt::format("found {}, expected a positive number", request.sample_time_s));
  }
  if (plant.time == TimeDomain::kContinuous) {
    return;
  }
  if (!is_sampled(request.domain)) {
    throw request_error(request, "domain",
                        "found \"continuous\", expected \"sampled\": the plant is discrete");
  }
  if (request.sample_time_s != plant.sample_time_s) {
    throw request_error(request, "sample_time_s",
                        fmt::format("found {}, expected the discrete plant's own, {}",
                                    request.sample_time_s, plant.sample_time_s.value_or(0.0)));
  }
}

void check_concurrent(const PlantModel& plant, const BankRequest& request) {
  const std::size_t fault_count = plant.faults.size();
  if (fault_count == 0) {
    throw request_error(request, "plant",
                        fmt::format("found plant \"{}\" without faults, expected some under "
                                    "[faults] or [[fault]]",
                                    plant.name));
  }
  if (request.method == "uio" && request.concurrent > fault_count) {
    throw request_error(request, "concurrent",
                        fmt::format("found {}, expected at most the plant's {} faults",
                                    request.concurrent, fault_count));
  }
  if (request.concurrent < 1 || (request.method != "uio" && request.concurrent >= fault_count)) {
    throw request_error(
        request, "concurrent",
        fmt::format("found {}, expected at least 1 and less than the plant's {} faults: a residual "
                    "that ignores all of them sees none",
                    request.concurrent, fault_count));
  }
  // There are fewer residuals than fault sets; see kMaxDecisionWords.
  const std::size_t set_count = fault_set_count(fault_count, request.concurrent);
  if (set_count > kMaxDecisionWords / (set_count / 64 + 1)) {
    throw request_error(request, "concurrent",
                        fmt::format("found {} of {} faults at one time, expected fewer: the "
                                    "decision table would not fit",
                                    request.concurrent, fault_count));
  }
}

bool has_matching_shapes(const PlantModel& plant) {
  const Eigen::Index n = plant.n();
  const Eigen::Index m = plant.m();
  const Eigen::Index q = plant.q();
  const auto fits = [&](const Eigen::VectorXd& state, const Eigen::VectorXd& output) {
    return state.size() == n && output.size() == q;
  };
  return plant.A.cols() == n && plant.B.rows() == n && plant.C.cols() == n && plant.D.rows() == q &&
         plant.D.cols() == m && std::ssize(plant.state_names) == n &&
         std::ssize(plant.input_names) == m && std::ssize(plant.output_names) == q &&
         plant.input_range.size() == m && plant.output_range.size() == q &&
         plant.x_operating.size() == n && plant.u_operating.size() == m &&
         plant.y_operating.size() == q &&
         std::all_of(plant.faults.begin(), plant.faults.end(),
                     [&](const Fault& fault) { return fits(fault.state, fault.output); }) &&
         std::all_of(plant.disturbances.begin(), plant.disturbances.end(),
                     [&](const Disturbance& disturbance) {
                       return fits(disturbance.state, disturbance.output);
                     });
}

// What a plant file cannot say, but a PlantModel made by a program can.
void check_plant(const PlantModel& plant, const BankRequest& request) {
  if (plant.n() == 0 || plant.q() == 0) {
    throw request_error(request, "plant",
                        fmt::format("found plant \"{}\" with {} states and {} outputs, expected "
                                    "at least one of each",
                                    plant.name, plant.n(), plant.q()));
  }
  if (!has_matching_shapes(plant)) {
    throw request_error(
        request, "plant",
        fmt::format("found plant \"{}\" with matrices, directions or names of different sizes, "
                    "expected A n×n, B n×m, C q×n, D q×m, and one name and range per channel",
                    plant.name));
  }
  bool is_finite = plant.A.allFinite() && plant.B.allFinite() && plant.C.allFinite() &&
                   plant.D.allFinite() && plant.input_range.allFinite() &&
                   plant.output_range.allFinite();
  for (const Fault& fault : plant.faults) {
    is_finite = is_finite && fault.state.allFinite() && fault.output.allFinite() &&
                std::isfinite(fault.size);
  }
  for (const Disturbance& disturbance : plant.disturbances) {
    is_finite = is_finite && disturbance.state.allFinite() && disturbance.output.allFinite();
  }
  if (!is_finite) {
    throw request_error(
        request, "plant",
        fmt::format("found plant \"{}\" with NaN or infinity, expected finite numbers",
                    plant.name));
  }
}

}  // namespace

void check_request(const PlantModel& plant, const BankRequest& request) {
  if (request.method != "geometric" && request.method != "eigenstructure" &&
      request.method != "uio") {
    throw request_error(
        request, "method",
        fmt::format("found \"{}\", expected \"geometric\", \"eigenstructure\" or \"uio\"",
                    request.method));
  }
  check_plant(plant, request);
  check_concurrent(plant, request);
  check_time(plant, request);
  if (request.method == "uio") {
    return;
  }
  check_poles(request);
  if (!(request.threshold > 0.0) || !std::isfinite(request.threshold)) {
    throw request_error(
        request, "decision",
        fmt::format("found threshold {}, expected a positive number", request.threshold));
  }
}

}  // namespace faultline
