#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <string>

#include "tools/bench/bench_inputs.h"

namespace faultline {

// What load_bench_inputs makes of a scenario, part by part. All throw InputError with the place in
// the scenario (or in the file it names).

/// A text and the name that messages give it.
struct NamedText {
  std::string text, source;
};

/// The plant that is simulated, at its operating point each time it is made; empty where its
/// library is not at hand (a replay). A library stays loaded as long as the maker: it must outlive
/// the plants.
[[nodiscard]] PlantMaker plant_maker(const Scenario& scenario, const PlantModel& plant,
                                     const NamedText& plant_file, double sample_time_s);
/// Absolute; of the simulated plant.
[[nodiscard]] Eigen::VectorXd initial_state(const Scenario& scenario, const PlantModel& plant);

/// The text of a data file that the scenario names under a key: that of the part "data:NAME" where
/// the run has one (it comes from a log), else what the file holds, which becomes this part. NAME
/// is the path as the scenario writes it. @throws std::system_error it cannot be read.
[[nodiscard]] NamedText data_text(BenchInputs& inputs, const Scenario& scenario,
                                  const std::filesystem::path& file);

/// All that happens to the plant besides its commands: `schedule` and `perturbations` of `inputs`,
/// whose plant, map and make_plant are there.
void make_schedules(BenchInputs& inputs, const Scenario& scenario);

}  // namespace faultline
