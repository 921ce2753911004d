#include "diagnosis/certify/check_thresholds.h"

#include <iterator>
#include <stdexcept>
#include <vector>

#include "diagnosis/certify/findings.h"

namespace faultline {
namespace {

using Eigen::MatrixXd;

MatrixXd column(const std::vector<double>& values) {
  return Eigen::VectorXd::Map(values.data(), std::ssize(values));
}

}  // namespace

void check_thresholds(const LinearThresholdProof& proof, const ResidualFilter& filter,
                      CheckResult& result) {
  Findings findings(result, filter.name);
  LinearThresholds found;
  try {
    found = proof.prove(filter);
  } catch (const std::invalid_argument& error) {
    return findings.add("certified thresholds", "a proof", error.what());
  }
  findings.compare("threshold", filter.threshold, found.threshold, 0.0);
  if (filter.test) {
    const MatrixXd offset = found.offset;
    findings.compare("what bounded sources add at most", column(filter.test->offset), offset,
                     1e-9 * filter.test->reference);
  } else if (!filter.course) {
    findings.add("thresholds from the first sample on", "there are none", "they are certified");
  } else {
    findings.compare_courses("componentwise threshold", filter.course->component, found.component);
  }
  if (!filter.shares) {
    findings.add("shares of its threshold", "there are none", "it is certified");
    return;
  }
  // A share that is rounding differs from machine to machine.
  const double noise = filter.test ? 1e-9 : 1e-9 * found.component.maxCoeff();
  const auto compare = [&](const char* claim, const std::vector<double>& stored,
                           const std::vector<double>& recomputed) {
    findings.compare(claim, column(stored), column(recomputed), noise);
  };
  compare("share of the disturbances", filter.shares->disturbance, found.shares.disturbance);
  compare("share of the noise", filter.shares->noise, found.shares.noise);
  compare("share of the rounding", filter.shares->resolution, found.shares.resolution);
  compare("share of the leakage", filter.shares->leakage, found.shares.leakage);
  compare("share of the jitter", filter.shares->jitter, found.shares.jitter);
  compare("share of Gaussian noise", filter.shares->gaussian, found.shares.gaussian);
}

}  // namespace faultline
