#include "sim/perturbation_schedule.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <boost/random/uniform_real_distribution.hpp>
#include <fmt/format.h>

#include "diagnosis/model/toml_reader.h"
#include "sim/fault.h"
#include "sim/fault_schedule.h"

namespace faultline {
namespace {

constexpr std::string_view kAll = "all";

// Seed of a source's stream: FNV-1a over its name, then the finaliser of splitmix64, so that
// neighbouring seeds and similar names share nothing.
std::uint64_t stream_seed(std::int64_t seed, const std::string& name) {
  constexpr std::uint64_t kFnvOffset = 0xcbf29ce484222325ULL;
  constexpr std::uint64_t kFnvPrime = 0x100000001b3ULL;
  std::uint64_t hash = kFnvOffset;
  for (const char character : name) {
    hash = (hash ^ static_cast<unsigned char>(character)) * kFnvPrime;
  }
  hash += static_cast<std::uint64_t>(seed) * 0x9e3779b97f4a7c15ULL;
  hash = (hash ^ (hash >> 30)) * 0xbf58476d1ce4e5b9ULL;
  hash = (hash ^ (hash >> 27)) * 0x94d049bb133111ebULL;
  return hash ^ (hash >> 31);
}

std::string unknown_target(const std::string& table, const std::vector<std::string>& known,
                           const std::string& plant, const std::string& target) {
  if (known.empty()) {
    return fmt::format("found \"{}\", expected none: plant \"{}\" has no [[{}]]", target, plant,
                       table);
  }
  std::string text = fmt::format("found \"{}\", expected \"all\" or a [[{}]] of plant \"{}\" ({})",
                                 target, table, plant, fmt::join(known, ", "));
  if (const auto near = nearest_name(target, known)) {
    text += fmt::format("; did you mean \"{}\"?", *near);
  }
  return text;
}

template <class Entries>
std::vector<std::string> names_of(const Entries& entries) {
  std::vector<std::string> names;
  names.reserve(entries.size());
  for (const auto& entry : entries) names.push_back(entry.name);
  return names;
}

}  // namespace

std::string_view perturbation_kind_name(PerturbationKind kind) noexcept {
  switch (kind) {
    case PerturbationKind::kUniform:
      return "uniform";
    case PerturbationKind::kConstant:
      return "constant";
    case PerturbationKind::kSinusoid:
      return "sinusoid";
    case PerturbationKind::kGaussian:
      return "gaussian";
    case PerturbationKind::kBandLimited:
      return "band_limited";
    case PerturbationKind::kRecorded:
      return "recorded";
  }
  return "";
}

PerturbationSchedule::PerturbationSchedule(const PlantModel& plant,
                                           const std::vector<Perturbation>& disturbances,
                                           const std::vector<Perturbation>& noises,
                                           std::int64_t seed)
    : disturbance_count_(std::ssize(plant.disturbances)), noise_count_(std::ssize(plant.noises)) {
  std::vector<Target> targets;
  for (const Disturbance& disturbance : plant.disturbances) {
    targets.push_back({disturbance.name, disturbance.bound});
  }
  add("disturbance", targets, disturbances, plant, seed);
  targets.clear();
  for (const Noise& noise : plant.noises) targets.push_back({noise.name, noise.bound});
  add("noise", targets, noises, plant, seed);
}

void PerturbationSchedule::add(const std::string& table, const std::vector<Target>& targets,
                               const std::vector<Perturbation>& perturbations,
                               const PlantModel& plant, std::int64_t seed) {
  std::vector<int> entries_of(targets.size(), 0);
  for (std::size_t entry = 0; entry < perturbations.size(); ++entry) {
    const Perturbation& perturbation = perturbations[entry];
    bool is_known = false;
    for (std::size_t i = 0; i < targets.size(); ++i) {
      const Target& target = targets[i];
      if (perturbation.target != kAll && perturbation.target != target.name) continue;
      is_known = true;
      if (!perturbation.size && !target.bound) {
        throw ScheduleError(entry, "size",
                            fmt::format("found nothing, expected a number: \"{}\" has no bound in "
                                        "the file of plant \"{}\"",
                                        target.name, plant.name),
                            table);
      }
      const std::string stream = fmt::format("{}/{}/{}", table, target.name, entries_of[i]++);
      sources_.push_back({.perturbation = perturbation,
                          .size = perturbation.size ? *perturbation.size : *target.bound,
                          .is_noise = table == "noise",
                          .index = static_cast<Eigen::Index>(i),
                          .stream = boost::random::mt19937_64(stream_seed(seed, stream))});
    }
    if (!is_known) {
      throw ScheduleError(entry, "target",
                          unknown_target(table, names_of(targets), plant.name, perturbation.target),
                          table);
    }
  }
  warn_beyond_bounds(table, targets);
}

void PerturbationSchedule::warn_beyond_bounds(const std::string& table,
                                              const std::vector<Target>& targets) {
  for (std::size_t i = 0; i < targets.size(); ++i) {
    double size = 0.0;
    for (const Source& source : sources_) {
      if (source.is_noise == (table == "noise") && source.index == static_cast<Eigen::Index>(i)) {
        size += std::abs(source.size);
      }
    }
    if (targets[i].bound && size > *targets[i].bound) {
      warnings_.push_back(fmt::format(
          "{} \"{}\" may reach {:g}, beyond its bound {:g} in the plant file: no threshold allows "
          "for that",
          table, targets[i].name, size, *targets[i].bound));
    }
  }
}

ActivePerturbations PerturbationSchedule::none() const {
  if (sources_.empty()) return {};
  return {Eigen::VectorXd::Zero(disturbance_count_), Eigen::VectorXd::Zero(noise_count_)};
}

void PerturbationSchedule::advance(double t_s, ActivePerturbations& out) noexcept {
  out.disturbance.setZero();
  out.noise.setZero();
  for (Source& source : sources_) {
    const Perturbation& perturbation = source.perturbation;
    double part = 1.0;
    if (perturbation.kind == PerturbationKind::kUniform) {
      part = boost::random::uniform_real_distribution<double>(-1.0, 1.0)(source.stream);
    } else if (perturbation.kind == PerturbationKind::kSinusoid) {
      part = sinusoid(t_s - perturbation.at_s, perturbation.frequency_Hz, perturbation.phase_rad);
    }
    if (!is_between(t_s, perturbation.at_s, perturbation.until_s)) continue;
    (source.is_noise ? out.noise : out.disturbance)[source.index] += source.size * part;
  }
}

}  // namespace faultline
