#pragma once

#include <stdexcept>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "diagnosis/model/plant_model.h"
#include "sim/fault.h"

namespace faultline {

/// The timeline names something the plant does not have, or asks of it what it cannot do.
class ScheduleError : public std::runtime_error {
 public:
  /// `what()` is "<field>: <text>".
  ScheduleError(std::size_t entry, const std::string& field, const std::string& text,
                const std::string& table = "fault")
      : std::runtime_error(field + ": " + text), entry_(entry), field_(field), table_(table) {}
  /// Index of the offending entry of [[table]], and which of its fields it is.
  [[nodiscard]] std::size_t entry() const noexcept { return entry_; }
  [[nodiscard]] const std::string& field() const noexcept { return field_; }
  [[nodiscard]] const std::string& table() const noexcept { return table_; }

 private:
  std::size_t entry_;
  std::string field_, table_;
};

/// The injected faults at one instant:
///
///   u_act = Γ_u u + b_u,   y_meas = Γ_y y + b_y,   m_j for the faults of the plant file
struct ActiveFaults {
  Eigen::VectorXd input_gain, input_bias;    ///< m
  Eigen::VectorXd output_gain, output_bias;  ///< q
  Eigen::VectorXd component;                 ///< one per [[fault]] of the plant file, in order
};

/// The timeline of faults of a run, resolved against a plant. Immutable.
class FaultSchedule {
 public:
  /// No faults, of no plant.
  FaultSchedule() = default;
  /// @throws ScheduleError unknown target (with the nearest name), kind that the target cannot
  /// have.
  FaultSchedule(const PlantModel& plant, std::vector<Injection> injections);

  /// The faults acting at t_s. Biases on one target add up, gains multiply.
  void evaluate(double t_s, ActiveFaults& out) const noexcept;
  /// A value for `evaluate` to write to: sizes set, no fault.
  [[nodiscard]] ActiveFaults none() const;

  /// Names of the faults (as the plant file names them) that act at t_s, sorted.
  [[nodiscard]] std::vector<std::string> active_names(double t_s) const;
  [[nodiscard]] const std::vector<Injection>& injections() const noexcept { return injections_; }

 private:
  enum class Target { kInput, kOutput, kComponent };
  struct Resolved {
    Target target;
    Eigen::Index index;
  };
  std::vector<Injection> injections_;
  std::vector<Resolved> resolved_;
  Eigen::Index input_count_, output_count_, component_count_;
};

}  // namespace faultline
