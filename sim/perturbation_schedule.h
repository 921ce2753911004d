#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <boost/random/mersenne_twister.hpp>

#include "diagnosis/model/plant_model.h"
#include "sim/band_limited_noise.h"
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
  /// @param sample_time_s of the run; 0: not known, no frequency is checked
  /// @throws ScheduleError unknown target (with the nearest name); no size and no bound (no sigma)
  ///   to take instead; a frequency from half the sample rate on. Its table is "disturbance" or
  ///   "noise".
  /// @throws InputError a record does not have the column.
  /// @pre recorded ones have their record; band-limited ones need the sample time
  PerturbationSchedule(const PlantModel& plant, const std::vector<Perturbation>& disturbances,
                       const std::vector<Perturbation>& noises, std::int64_t seed,
                       double sample_time_s = 0.0);

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
    double size = 0.0;   ///< or sigma
    double reach = 0.0;  ///< |.| at most; infinite if there is no most
    bool is_noise = false;
    Eigen::Index index = 0;
    boost::random::mt19937_64 stream;
    std::optional<BandLimitedNoise> band;  ///< kBandLimited
    std::size_t column = 0;                ///< kRecorded
  };
  struct Target {
    std::string name;
    std::optional<double> bound, sigma;
  };
  [[nodiscard]] static Source make_source(const Perturbation& perturbation, const Target& target,
                                          double sample_time_s);
  [[nodiscard]] static double draw(Source& source, double t_s) noexcept;
  void add(const std::string& table, const std::vector<Target>& targets,
           const std::vector<Perturbation>& perturbations, const PlantModel& plant,
           std::int64_t seed, double sample_time_s);
  void warn_beyond_bounds(const std::string& table, const std::vector<Target>& targets);

  std::vector<Source> sources_;
  std::vector<std::string> warnings_;
  Eigen::Index disturbance_count_ = 0, noise_count_ = 0;
};

}  // namespace faultline
