#pragma once

#include <memory>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "diagnosis/model/plant_model.h"
#include "sim/integration.h"
#include "sim/integrator.h"
#include "sim/plant.h"
#include "sim/plant_dynamics.h"

namespace faultline {

/// The plant as its file says it. Commands u, faults m, disturbances d and noise w are held over
/// each sample:
///
///   f(x)  = A x + B u + L m + E_d d + Σ gain·E_o·φ(E_i x)
///   y_k   = C x_k + D u_k + D_m m_k + D_f d_k + F w_k
///
/// in deviations from the operating point. x_k+1 follows from f by the method of integration.
class ModelPlant final : public SimulatedPlant {
 public:
  /// @param sample_time_s for continuous plants; a discrete plant's own must be equal.
  /// @throws std::invalid_argument sample time not positive or not the discrete plant's; a method
  ///   of integration the plant cannot have.
  ModelPlant(const PlantModel& model, double sample_time_s, const Integration& integration = {});

  void reset(const Eigen::VectorXd& x) noexcept override;
  void measure(const PlantDrive& drive, std::span<double> y) noexcept override;
  void step(const PlantDrive& drive) noexcept override;
  [[nodiscard]] const Eigen::VectorXd& state() const noexcept override { return x_absolute_; }
  [[nodiscard]] const std::vector<PlantComponent>& components() const noexcept override {
    return components_;
  }
  [[nodiscard]] bool is_finite() const noexcept override {
    return dx_.allFinite() && result_.trouble == IntegrationResult::Trouble::kNone;
  }
  [[nodiscard]] std::string failure() const override;

 private:
  void take(std::span<const double> u) noexcept;
  static void derivative(void* self, const double* x, double* dx);

  PlantDynamics dynamics_;                  // from sample to sample; of x' where integrator_ is
  std::unique_ptr<Integrator> integrator_;  // else one product per sample
  IntegrationResult result_;
  PlantOutputs outputs_;
  std::vector<PlantComponent> components_;
  std::vector<std::string> state_names_;
  Eigen::VectorXd x_operating_, u_operating_, y_operating_;
  Eigen::VectorXd dx_, dx_next_, du_, dy_, phi_, x_absolute_;
};

}  // namespace faultline
