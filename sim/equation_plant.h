#pragma once

#include <array>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "diagnosis/model/plant_model.h"
#include "sim/integrator.h"
#include "sim/plant.h"
#include "sim/plant_table.h"

namespace faultline {

/// Values of parameters other than the table's, by name.
using PlantParameters = std::map<std::string, double, std::less<>>;

/// p of a table: its nominal values, but those of `parameters`.
/// @throws std::invalid_argument a parameter that the table does not have (the nearest name).
[[nodiscard]] std::vector<double> parameter_values(const faultline_plant_table& table,
                                                   const PlantParameters& parameters);

/// A plant in C or C++ behind the plant file that describes it to everybody else:
///
///   dx/dt = f(x, u, p, d)        y = h(x, u, p, d) + F w
///
/// u, p, d and w held over the sample. Faults are deviations of p from its value. Inputs, outputs,
/// disturbances and noise come in the file's order, and are matched by name; states are the
/// table's, in its order. A noise of the file whose name is a disturbance of the table is that
/// disturbance; any other enters by its column F. A disturbance that the file leaves out stays
/// zero. An exception from the table's functions ends the run as a state that is not finite does.
class EquationPlant final : public SimulatedPlant {
 public:
  /// At the file's operating point. `table` must outlive the plant.
  /// @throws std::invalid_argument names that only one of both has (the nearest name); states in
  ///   another order; an unknown parameter; sample time not positive; a method of integration that
  ///   such a plant cannot have.
  EquationPlant(const faultline_plant_table& table, const PlantModel& file, double sample_time_s,
                const Integration& integration = {}, const PlantParameters& parameters = {});

  void reset(const Eigen::VectorXd& x) noexcept override;
  void measure(const PlantDrive& drive, std::span<double> y) noexcept override;
  void step(const PlantDrive& drive) noexcept override;
  [[nodiscard]] const Eigen::VectorXd& state() const noexcept override { return x_; }
  /// The table's parameters.
  [[nodiscard]] const std::vector<PlantComponent>& components() const noexcept override {
    return components_;
  }
  [[nodiscard]] bool is_finite() const noexcept override {
    return x_.allFinite() && result_.trouble == IntegrationResult::Trouble::kNone &&
           thrown_.front() == '\0';
  }
  [[nodiscard]] std::string failure() const override;

 private:
  struct Link {
    std::size_t from, to;
  };
  void take(const PlantDrive& drive) noexcept;

  const faultline_plant_table* table_;
  std::vector<std::size_t> input_, output_;  // the table's place of each of the file's
  std::vector<Link> disturbance_, noise_;    // of the file -> of the table
  Eigen::MatrixXd F_;
  std::vector<PlantComponent> components_;
  std::vector<std::string> state_names_;
  std::unique_ptr<Integrator> integrator_;
  IntegrationResult result_;
  std::array<char, 200> thrown_{};  // the first exception's text; empty: none
  Eigen::VectorXd x_, noise_part_;
  std::vector<double> u_, p_, d_, y_;
};

}  // namespace faultline
