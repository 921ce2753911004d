#pragma once

#include <random>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "diagnosis/bank/bank.h"
#include "diagnosis/design/bank_request.h"
#include "diagnosis/model/plant_model.h"

namespace faultline {

/// A plant, and what is asked of it.
struct CertifyCase {
  PlantModel plant;
  BankRequest request;

  [[nodiscard]] Bank designed() const;   ///< without certificates
  [[nodiscard]] Bank certified() const;  ///< with certificates
};

/// A stable plant of gaussian entries with actuator faults on all its inputs; poles of the request
/// for the domain given.
[[nodiscard]] CertifyCase random_case(std::uint64_t seed, Eigen::Index n, Eigen::Index m,
                                      Eigen::Index q, std::size_t concurrent, DesignDomain domain);

/// The same names with all numbers of a plant; ranges 100, operating point 0, actuator faults.
[[nodiscard]] PlantModel plant_of(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B,
                                  const Eigen::MatrixXd& C);

/// A filter behind its plant, both sample by sample: inputs, faults and disturbances are held, the
/// plant is sampled exactly. Plain arithmetic, nothing shared with the certificates.
class LoopSimulation {
 public:
  LoopSimulation(const PlantModel& plant, const Bank& bank, const ResidualFilter& filter);

  /// Unit signals to which the plant can be driven: inputs, then faults, then disturbances.
  [[nodiscard]] Eigen::Index inputs() const { return B_.cols(); }

  /// The residual of this sample; then on to the next. `w` as above.
  Eigen::VectorXd step(const Eigen::VectorXd& w);

 private:
  const ResidualFilter& filter_;
  Eigen::Index m_;
  Eigen::MatrixXd A_, B_, C_, D_;
  Eigen::VectorXd x_, v_;
};

}  // namespace faultline
