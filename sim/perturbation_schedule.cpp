#include "sim/perturbation_schedule.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

#include <boost/random/normal_distribution.hpp>
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

/// What must be right about one entry besides its size. @return field and text.
std::optional<std::pair<std::string, std::string>> mistake_of(const Perturbation& perturbation,
                                                              double sample_time_s) {
  const auto beyond = [&](double frequency_Hz) {
    return 2.0 * frequency_Hz * sample_time_s >= 1.0;
  };
  const auto text = [&](double frequency_Hz) {
    return fmt::format("found {}, expected less than half the sample rate: {} Hz", frequency_Hz,
                       0.5 / sample_time_s);
  };
  if (perturbation.kind == PerturbationKind::kSinusoid && beyond(perturbation.frequency_Hz)) {
    return {{"frequency_Hz", text(perturbation.frequency_Hz)}};
  }
  if (perturbation.kind == PerturbationKind::kBandLimited && beyond(perturbation.to_Hz)) {
    return {{"to_Hz", text(perturbation.to_Hz)}};
  }
  return std::nullopt;
}

bool is_normal(PerturbationKind kind) {
  return kind == PerturbationKind::kGaussian || kind == PerturbationKind::kBandLimited;
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
                                           std::int64_t seed, double sample_time_s)
    : disturbance_count_(std::ssize(plant.disturbances)), noise_count_(std::ssize(plant.noises)) {
  std::vector<Target> targets;
  for (const Disturbance& disturbance : plant.disturbances) {
    // What an uncertainty adds follows from the states; nobody drives it. These come last.
    if (!disturbance.uncertainty.empty()) break;
    targets.push_back({disturbance.name, disturbance.bound, std::nullopt});
  }
  add("disturbance", targets, disturbances, plant, seed, sample_time_s);
  targets.clear();
  for (const Noise& noise : plant.noises) {
    targets.push_back({noise.name, noise.bound, noise.sigma});
  }
  add("noise", targets, noises, plant, seed, sample_time_s);
}

PerturbationSchedule::Source PerturbationSchedule::make_source(const Perturbation& perturbation,
                                                               const Target& target,
                                                               double sample_time_s) {
  Source source{.perturbation = perturbation};
  if (is_normal(perturbation.kind)) {
    source.size = perturbation.sigma ? *perturbation.sigma : *target.sigma;
    source.reach = std::numeric_limits<double>::infinity();
    if (perturbation.kind == PerturbationKind::kBandLimited) {
      source.band.emplace(perturbation.from_Hz, perturbation.to_Hz, sample_time_s);
    }
    return source;
  }
  if (perturbation.kind == PerturbationKind::kRecorded) {
    const std::string& column = perturbation.column.empty() ? target.name : perturbation.column;
    source.column = perturbation.record->index_of(column);
    source.size = perturbation.size.value_or(1.0);
    source.reach = std::abs(source.size) * perturbation.record->largest(source.column);
    return source;
  }
  source.size = perturbation.size ? *perturbation.size : *target.bound;
  source.reach = std::abs(source.size);
  return source;
}

void PerturbationSchedule::add(const std::string& table, const std::vector<Target>& targets,
                               const std::vector<Perturbation>& perturbations,
                               const PlantModel& plant, std::int64_t seed, double sample_time_s) {
  std::vector<int> entries_of(targets.size(), 0);
  for (std::size_t entry = 0; entry < perturbations.size(); ++entry) {
    const Perturbation& perturbation = perturbations[entry];
    if (const auto mistake = mistake_of(perturbation, sample_time_s)) {
      throw ScheduleError(entry, mistake->first, mistake->second, table);
    }
    const bool takes_sigma = is_normal(perturbation.kind);
    const bool takes_bound = !takes_sigma && perturbation.kind != PerturbationKind::kRecorded;
    bool is_known = false;
    for (std::size_t i = 0; i < targets.size(); ++i) {
      const Target& target = targets[i];
      if (perturbation.target != kAll && perturbation.target != target.name) continue;
      is_known = true;
      if ((takes_sigma && !perturbation.sigma && !target.sigma) ||
          (takes_bound && !perturbation.size && !target.bound)) {
        throw ScheduleError(entry, takes_sigma ? "sigma" : "size",
                            fmt::format("found nothing, expected a number: \"{}\" has no {} in "
                                        "the file of plant \"{}\"",
                                        target.name, takes_sigma ? "sigma" : "bound", plant.name),
                            table);
      }
      const std::string stream = fmt::format("{}/{}/{}", table, target.name, entries_of[i]++);
      Source source = make_source(perturbation, target, sample_time_s);
      source.is_noise = table == "noise";
      source.index = static_cast<Eigen::Index>(i);
      source.stream = boost::random::mt19937_64(stream_seed(seed, stream));
      sources_.push_back(std::move(source));
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
        size += source.reach;
      }
    }
    if (targets[i].bound && std::isinf(size)) {
      warnings_.push_back(fmt::format(
          "{} \"{}\" is normally distributed, beyond its bound {:g} in the plant file at times: no "
          "threshold allows for that",
          table, targets[i].name, *targets[i].bound));
    } else if (targets[i].bound && size > *targets[i].bound) {
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

/// What a source does at t_s, per size.
double PerturbationSchedule::draw(Source& source, double t_s) noexcept {
  const Perturbation& perturbation = source.perturbation;
  const double since_s = t_s - perturbation.at_s;
  switch (perturbation.kind) {
    case PerturbationKind::kUniform:
      return boost::random::uniform_real_distribution<double>(-1.0, 1.0)(source.stream);
    case PerturbationKind::kConstant:
      return 1.0;
    case PerturbationKind::kSinusoid:
      return sinusoid(since_s, perturbation.frequency_Hz, perturbation.phase_rad);
    case PerturbationKind::kGaussian:
      return boost::random::normal_distribution<double>()(source.stream);
    case PerturbationKind::kBandLimited:
      return source.band->next(source.stream);
    case PerturbationKind::kRecorded:
      return perturbation.record->value(source.column, since_s, perturbation.between,
                                        perturbation.is_repeated);
  }
  return 0.0;
}

void PerturbationSchedule::advance(double t_s, ActivePerturbations& out) noexcept {
  out.disturbance.setZero();
  out.noise.setZero();
  for (Source& source : sources_) {
    const double part = draw(source, t_s);
    if (!is_between(t_s, source.perturbation.at_s, source.perturbation.until_s)) continue;
    (source.is_noise ? out.noise : out.disturbance)[source.index] += source.size * part;
  }
}

}  // namespace faultline
