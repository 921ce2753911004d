// Certified thresholds under everything that is within the bounds, for as long as one likes:
//
//   certified_threshold_benchmark [SAMPLES = 1e8, for each method]
//
// Prints how often they were crossed (never), how near the courses came that are worst for each
// residual, and how many samples a second were played. Exit code 1 if one was crossed.
#include <chrono>
#include <cstdlib>
#include <string>
#include <vector>

#include <fmt/format.h>

#include "diagnosis/certify/certify.h"
#include "diagnosis/design/design_bank.h"
#include "diagnosis/model/plant_file.h"
#include "tests/diagnosis/threshold_trial.h"

namespace faultline {
namespace {

struct Subject {
  std::string name;
  PlantModel plant;
  BankRequest request;
};

// The example's bank with certified thresholds: noise up to five of its sigmas, states within ±5
// where the plant file gives no range.
Subject subject(const std::string& folder, const std::string& bank, DesignDomain domain) {
  const std::string path = std::string(FAULTLINE_EXAMPLES_DIR) + "/" + folder + "/" + bank;
  Subject result{
      folder + "/" + bank + (domain == DesignDomain::kContinuous ? ", continuous" : ", sampled"),
      {},
      read_bank_request(path)};
  result.plant = read_plant(result.request.plant);
  for (Noise& noise : result.plant.noises) {
    if (!noise.bound) noise.bound = 5.0 * noise.sigma.value();
  }
  if (result.plant.noises.empty()) {
    for (Eigen::Index i = 0; i < result.plant.q(); ++i) {
      result.plant.noises.push_back({"", Eigen::VectorXd::Unit(result.plant.q(), i), 0.01, {}});
    }
  }
  if (!result.plant.state_range) {
    result.plant.state_range = Eigen::VectorXd::Constant(result.plant.n(), 5.0);
  }
  if (result.request.method == "uio") return result;
  if (domain != DesignDomain::kContinuous) {
    result.request.domain = domain;
    if (!result.request.poles.empty())
      result.request.decay_rate_per_s = -result.request.poles.front().real();
    result.request.poles.clear();
  }
  result.request.threshold_kind = ThresholdBasis::Kind::kCertified;
  return result;
}

int run(std::uint64_t samples) {
  int crossed = 0;
  fmt::print("{:<46} {:>10} {:>9} {:>9} {:>14} {:>12}\n", "bank", "samples", "crossed", "largest",
             "least worst", "samples/s");
  for (const Subject& one : {subject("hou2015", "bank.toml", DesignDomain::kSampled),
                             subject("hou2015", "bank.toml", DesignDomain::kContinuous),
                             subject("jin", "bank.toml", DesignDomain::kSampled),
                             subject("jin", "bank_weakened.toml", DesignDomain::kSampled),
                             subject("ma2024", "bank.toml", DesignDomain::kSampled)}) {
    Bank bank = design_bank(one.plant, one.request).bank;
    certify(one.plant, bank);
    const auto begin = std::chrono::steady_clock::now();
    const ThresholdTrial::Result result = ThresholdTrial(one.plant, bank, 20261201).run(samples);
    const std::chrono::duration<double> time_s = std::chrono::steady_clock::now() - begin;
    double least = 1.0;
    for (const double worst : result.largest_of_worst) least = std::min(least, worst);
    fmt::print("{:<46} {:>10.3g} {:>9} {:>9.4f} {:>14} {:>12.3g}\n", one.name,
               static_cast<double>(result.samples), result.crossings, result.largest,
               one.plant.nonlinearities.empty() ? fmt::format("{:.4f}", least) : "-",
               static_cast<double>(result.samples) / time_s.count());
    std::fflush(stdout);
    crossed += result.crossings > 0 ? 1 : 0;
  }
  return crossed == 0 ? 0 : 1;
}

}  // namespace
}  // namespace faultline

int main(int argc, char** argv) {
  return faultline::run(static_cast<std::uint64_t>(argc > 1 ? std::atof(argv[1]) : 1e8));
}
