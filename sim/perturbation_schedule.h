#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <boost/random/mersenne_twister.hpp>

#include "diagnosis/model/plant_model.h"
#include "sim/perturbation.h"

namespace faultline {

/// The disturbances and noise of a run, resolved against a plant.
///
/// Every random source draws from a stream of its own, which depends on the seed, the target's name
/// and how many sources of the same target stand before it, and on nothing else; it draws in every
/// sample, acting or not. What one source does thus never changes another.
class PerturbationSchedule {
 public:
  /// Nothing acts.
  PerturbationSchedule() = default;
  /// @throws ScheduleError unknown target (with the nearest name); no size and no bound to take
  ///   instead. Its table is "disturbance" or "noise".
  PerturbationSchedule(const PlantModel& plant, const std::vector<Perturbation>& disturbances,
                       const std::vector<Perturbation>& noises, std::int64_t seed);

  /// The next sample, at t_s: what acts over it, into `out` (as `none` made it). Real-time: neither
  /// allocates nor throws.
  void advance(double t_s, ActivePerturbations& out) noexcept;
  /// A value for `advance` to write to: sizes set, nothing acts; empty if nothing ever does.
  [[nodiscard]] ActivePerturbations none() const;

  /// What may act beyond its bound in the plant file, on which every threshold is built: one line
  /// per target.
  [[nodiscard]] const std::vector<std::string>& warnings() const noexcept { return warnings_; }

 private:
  struct Source {
    Perturbation perturbation;
    double size = 0.0;
    bool is_noise = false;
    Eigen::Index index = 0;
    boost::random::mt19937_64 stream;
  };
  struct Target {
    std::string name;
    std::optional<double> bound;
  };
  void add(const std::string& table, const std::vector<Target>& targets,
           const std::vector<Perturbation>& perturbations, const PlantModel& plant,
           std::int64_t seed);
  void warn_beyond_bounds(const std::string& table, const std::vector<Target>& targets);

  std::vector<Source> sources_;
  std::vector<std::string> warnings_;
  Eigen::Index disturbance_count_ = 0, noise_count_ = 0;
};

}  // namespace faultline
