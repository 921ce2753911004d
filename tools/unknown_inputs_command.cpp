#include <filesystem>
#include <fstream>
#include <iterator>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <CLI/App.hpp>
#include <CLI/Validators.hpp>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <nlohmann/json.hpp>

#include "diagnosis/design/recorded_unknown_inputs.h"
#include "diagnosis/model/plant_file.h"
#include "diagnosis/model/plant_text.h"
#include "tools/cli.h"
#include "tools/log/recorded_samples.h"

namespace faultline {
namespace {

struct UnknownInputsArguments {
  std::string plant, output, json;
  std::vector<std::string> logs;
  int rank = 0;
  double sample_time_s = 0.0;
};

// Two halves of a record that differ by more agree on nothing.
constexpr double kDoubtfulAngle_deg = 20.0;

std::vector<double> numbers(const Eigen::VectorXd& values) {
  return {values.begin(), values.end()};
}

// A name that no disturbance of the plant has.
std::string free_name(const PlantModel& plant, Eigen::Index number) {
  std::string name = fmt::format("recorded{}", number);
  for (const Disturbance& disturbance : plant.disturbances) {
    if (disturbance.name == name) name += "_";
  }
  return name;
}

std::vector<Disturbance> disturbances_of(const PlantModel& plant,
                                         const RecordedUnknownInputs& found) {
  std::vector<Disturbance> disturbances;
  for (Eigen::Index j = 0; j < found.rank; ++j) {
    disturbances.push_back({free_name(plant, j + 1), found.directions.col(j),
                            Eigen::VectorXd::Zero(plant.q()), found.largest[j], ""});
  }
  return disturbances;
}

void print_found(std::FILE* out, const PlantModel& plant, const RecordedUnknownInputs& found) {
  fmt::print(out, "{} samples; the innovation is {:.3g} times what the plant file explains\n",
             found.samples, found.innovation_before);
  if (found.rank == 0) {
    fmt::print(out, "no unknown input: the plant's noise explains the record\n");
    return;
  }
  fmt::print(out, "{} unknown input{}; with {} the innovation is {:.3g} times what is explained\n",
             found.rank, found.rank == 1 ? "" : "s", found.rank == 1 ? "it" : "them",
             found.innovation_after);
  fmt::print(out, "the halves of the record differ by {:.1f} degrees{}\n", found.halves_deg,
             found.halves_deg > kDoubtfulAngle_deg
                 ? ": too much to trust; a longer record, or one in which the states and inputs "
                   "move more and faster, would tell"
                 : "");
  fmt::print(out, "singular values {:.3g}; log-likelihood gained by each direction tried {:.4g}\n",
             fmt::join(numbers(found.singular_values), ", "),
             fmt::join(found.likelihood_gains, ", "));
  for (const Disturbance& disturbance : disturbances_of(plant, found)) {
    fmt::print(out, "\n[[disturbance]]\nname  = \"{}\"\nstate = [{:.6g}]\nbound = {:.6g}\n",
               disturbance.name, fmt::join(numbers(disturbance.state), ", "),
               disturbance.bound.value_or(0.0));
  }
}

nlohmann::ordered_json found_json(const PlantModel& plant, const RecordedUnknownInputs& found) {
  nlohmann::ordered_json inputs = nlohmann::ordered_json::array();
  for (const Disturbance& disturbance : disturbances_of(plant, found)) {
    inputs.push_back({{"name", disturbance.name},
                      {"state", numbers(disturbance.state)},
                      {"largest", disturbance.bound.value_or(0.0)}});
  }
  return {{"samples", found.samples},
          {"innovation_before", found.innovation_before},
          {"innovation_after", found.innovation_after},
          {"singular_values", numbers(found.singular_values)},
          {"likelihood_gains", found.likelihood_gains},
          {"rank", found.rank},
          {"halves_deg", found.halves_deg},
          {"unknown_inputs", inputs}};
}

int unknown_inputs(const UnknownInputsArguments& arguments) {
  PlantModel plant = read_plant(arguments.plant);
  std::FILE* out = human_output(arguments.json);
  const RecordedSamples recorded = read_recorded_samples(arguments.logs, plant);
  for (const std::string& remark : recorded.remarks) fmt::print(stderr, "{}\n", remark);
  double sample_time_s = arguments.sample_time_s;
  if (plant.sample_time_s) sample_time_s = *plant.sample_time_s;
  if (sample_time_s == 0.0) sample_time_s = recorded.sample_time_s.value_or(0.0);
  if (sample_time_s == 0.0) {
    throw std::invalid_argument(
        "the logs do not say their sample time (no RUN with a bank), expected --sample-time");
  }
  RecordedUnknownInputs found;
  try {
    found = find_unknown_inputs(
        plant, sample_time_s, recorded.stretches,
        arguments.rank > 0 ? std::optional<Eigen::Index>(arguments.rank) : std::nullopt);
  } catch (const UnusableRecord& error) {
    throw std::invalid_argument(error.what());
  }
  print_found(out, plant, found);
  if (!arguments.json.empty()) write_json(found_json(plant, found), arguments.json);
  if (!arguments.output.empty() && found.rank > 0) {
    std::vector<Disturbance> added = disturbances_of(plant, found);
    plant.disturbances.insert(plant.disturbances.begin(), added.begin(), added.end());
    write_to(arguments.output, [&](std::FILE* target) {
      fmt::print(
          target, "{}",
          plant_text(plant, {fmt::format("{}, with the unknown inputs recorded in {}",
                                         arguments.plant, fmt::join(arguments.logs, ", "))}));
    });
    fmt::print(out, "\nwritten to {}\n", arguments.output);
  }
  return found.rank > 0 ? kExitYes : kExitNo;
}

}  // namespace

void add_unknown_inputs_command(CLI::App& program, int& exit_code) {
  CLI::App* command = program.add_subcommand(
      "unknown-inputs",
      "Find where unknown inputs enter a plant, from logs of runs without a fault");
  auto arguments = std::make_shared<UnknownInputsArguments>();
  command->add_option("PLANT", arguments->plant, "Plant file (plant.toml)")
      ->required()
      ->check(CLI::ExistingFile);
  command->add_option("LOG", arguments->logs, "LCM logs with SAMPLE messages, as `run` writes them")
      ->required()
      ->check(CLI::ExistingFile);
  command
      ->add_option("--rank", arguments->rank,
                   "How many unknown inputs; default: as many as the logs tell")
      ->check(CLI::Range(1, 1000));
  command
      ->add_option(
          "--sample-time", arguments->sample_time_s,
          "Seconds between samples; default: the discrete plant's, or that of the log's bank")
      ->check(CLI::PositiveNumber);
  command->add_option("-o,--output", arguments->output,
                      "Plant file to write, with a [[disturbance]] per unknown input");
  add_json_option(*command, arguments->json);
  command->footer(kExitCodesHelp);
  command->callback([arguments, &exit_code] { exit_code = unknown_inputs(*arguments); });
}

}  // namespace faultline
