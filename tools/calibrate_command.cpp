#include <charconv>
#include <cmath>
#include <map>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include <CLI/App.hpp>
#include <CLI/Validators.hpp>
#include <faultline/run_t.hpp>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <nlohmann/json.hpp>

#include "diagnosis/bank/bank_file.h"
#include "diagnosis/model/plant_file.h"
#include "tools/bank_print.h"
#include "tools/calibrate/calibration.h"
#include "tools/cli.h"
#include "tools/lcm/channels.h"
#include "tools/lcm/log_event.h"
#include "tools/lcm/message_type.h"
#include "tools/lcm/run_parts.h"
#include "tools/log/log_files.h"
#include "tools/log/recorded_samples.h"
#include "tools/threshold_print.h"

namespace faultline {
namespace {

struct CalibrateArguments {
  std::vector<std::string> logs;
  std::string rate, bank, plant, output, json;
  double held_out = CalibrationOptions().held_out;
};

// "1e-3/h" in alarms an hour.
double rate_per_h(const std::string& text) {
  const std::map<std::string_view, double> hours = {
      {"s", 1.0 / 3600.0}, {"min", 1.0 / 60.0}, {"h", 1.0},      {"day", 24.0},
      {"week", 168.0},     {"month", 720.0},    {"year", 8760.0}};
  double count = 0.0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), count);
  const std::string_view unit(end, static_cast<std::size_t>(text.data() + text.size() - end));
  const auto found = unit.starts_with('/') ? hours.find(unit.substr(1)) : hours.end();
  if (error != std::errc() || found == hours.end() || !std::isfinite(count) || !(count > 0.0)) {
    throw std::invalid_argument(
        fmt::format("--far: found \"{}\", expected a positive number per time: 1e-3/h, 1/month (s, "
                    "min, h, day, week, "
                    "month, year)",
                    text));
  }
  return count / found->second;
}

// The text of a part of the first run in a log.
RunParts recorded_parts(const std::string& file) {
  LogFiles log({file});
  RunParts parts;
  const auto is_whole = [&parts](const char* name) {
    const RunParts::Part* part = parts.find(name);
    return part != nullptr && part->is_whole();
  };
  while (const LogEvent* event = log.next()) {
    const MessageType* type = find_message_type(event->channel);
    run_t run;
    if (type == nullptr || type->channel != kRunChannel ||
        !decode_message(event->data, type->layout, run)) {
      continue;
    }
    parts.take(run);
    if (is_whole("plant") && is_whole("bank")) break;
  }
  return parts;
}

const RunParts::Part& whole_part(const RunParts& parts, const char* name, const std::string& log) {
  const RunParts::Part* part = parts.find(name);
  if (part == nullptr || !part->is_whole()) {
    throw std::invalid_argument(
        fmt::format("{}: found no whole {} in it (channel {}), expected --{} FILE", log, name,
                    kRunChannel, name));
  }
  return *part;
}

nlohmann::ordered_json calibrated_json(const Bank& bank) {
  nlohmann::ordered_json residuals = nlohmann::ordered_json::array();
  for (const ResidualFilter& filter : bank.filters) {
    const Calibration& c = filter.calibration.value();
    residuals.push_back({{"name", filter.name},
                         {"threshold", filter.threshold},
                         {"false_alarms_per_h", c.false_alarms_per_h},
                         {"interval_per_h", {c.rate_low_per_h, c.rate_high_per_h}},
                         {"hours", c.hours},
                         {"peaks", c.exceedances},
                         {"level", c.level},
                         {"scale", c.scale},
                         {"shape", c.shape},
                         {"held_out_hours", c.held_out_hours},
                         {"held_out_expected", c.held_out_expected},
                         {"held_out_found", c.held_out_found}});
  }
  return {{"bank", bank.name},
          {"false_alarms_per_h", bank.thresholds.false_alarms_per_h},
          {"residuals", residuals}};
}

int run_calibrate(const CalibrateArguments& arguments) {
  CalibrationOptions options;
  options.false_alarms_per_h = rate_per_h(arguments.rate);
  options.held_out = arguments.held_out;
  std::optional<RunParts> parts;
  const auto recorded = [&](const char* name) -> const RunParts::Part& {
    if (!parts) parts = recorded_parts(arguments.logs.front());
    return whole_part(*parts, name, arguments.logs.front());
  };
  const PlantModel plant = arguments.plant.empty()
                               ? parse_plant(recorded("plant").text(), recorded("plant").name)
                               : read_plant(arguments.plant);
  Bank bank = arguments.bank.empty() ? parse_bank(recorded("bank").text(), recorded("bank").name)
                                     : read_bank(arguments.bank);
  if (bank.plant_digest != plant_digest(plant)) {
    throw std::invalid_argument(fmt::format(
        "bank \"{}\" is for plant \"{}\" ({}), expected one for plant \"{}\" ({})", bank.name,
        bank.plant_name, bank.plant_digest, plant.name, plant_digest(plant)));
  }
  const RecordedSamples samples = read_recorded_samples(arguments.logs, plant);
  for (const std::string& remark : samples.remarks) fmt::print(stderr, "{}\n", remark);
  if (samples.sample_time_s && *samples.sample_time_s != bank.sample_time_s) {
    throw std::invalid_argument(
        fmt::format("found logs with a sample every {} s, expected every {} s as of bank \"{}\"",
                    *samples.sample_time_s, bank.sample_time_s, bank.name));
  }
  calibrate(plant, samples.stretches, options, bank);
  std::FILE* out = human_output(arguments.json);
  print_thresholds(out, bank);
  print_fault_reach(out, bank);
  write_bank(bank, arguments.output);
  fmt::print(out, "\n  written to {}\n", arguments.output);
  if (!arguments.json.empty()) write_json(calibrated_json(bank), arguments.json);
  return kExitYes;
}

}  // namespace

void add_calibrate_command(CLI::App& program, int& exit_code) {
  CLI::App* command = program.add_subcommand(
      "calibrate", "Set a bank's thresholds from fault-free logs, for a false-alarm rate");
  auto arguments = std::make_shared<CalibrateArguments>();
  command->add_option("LOG", arguments->logs, "LCM logs of runs without a fault")
      ->required()
      ->check(CLI::ExistingFile);
  command
      ->add_option("--far", arguments->rate,
                   "False alarms of the whole bank: 1e-3/h, 1/month (s, min, h, day, week, month, "
                   "year)")
      ->required();
  command->add_option("-o,--output", arguments->output, "Bank file to write")->required();
  command
      ->add_option("--bank", arguments->bank,
                   "Bank to calibrate; default: the one that the first log was recorded with")
      ->check(CLI::ExistingFile);
  command->add_option("--plant", arguments->plant, "Its plant file; default: that of the first log")
      ->check(CLI::ExistingFile);
  command
      ->add_option("--held-out", arguments->held_out,
                   "Part of the record, its end, that the fit is tried on")
      ->capture_default_str()
      ->check(CLI::Range(0.05, 0.8));
  add_json_option(*command, arguments->json);
  command->footer(kExitCodesHelp);
  command->callback([arguments, &exit_code] { exit_code = run_calibrate(*arguments); });
}

}  // namespace faultline
