#include <chrono>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <system_error>
#include <vector>

#include <unistd.h>

#include <CLI/App.hpp>
#include <CLI/Validators.hpp>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <nlohmann/json.hpp>

#include "diagnosis/bank/bank_file.h"
#include "diagnosis/design/bank_request.h"
#include "diagnosis/design/design_bank.h"
#include "tools/assignment_print.h"
#include "tools/bank_print.h"
#include "tools/bench/bench_inputs.h"
#include "tools/bench/certified_design.h"
#include "tools/cli.h"
#include "tools/design_json.h"
#include "tools/observer_print.h"
#include "tools/quantisation.h"

namespace faultline {
namespace {

// Leakage from an ignored fault of size one beyond this part of the threshold is worth a warning.
constexpr double kMuchLeakage = 0.2;

struct DesignArguments {
  std::string request, output, json, dbc;
  bool is_partial = false;
};

void print_verdict(std::FILE* out, const PlantModel& plant, const DesignResult& result) {
  fmt::print(
      out, "{}: {} for plant \"{}\" ({} states, {} inputs, {} outputs, {} faults)\n",
      result.bank.name,
      result.is_solvable ? "solvable, every residual exists and sees what it must" : "NOT SOLVABLE",
      plant.name, plant.n(), plant.m(), plant.q(), plant.faults.size());
  if (result.candidate_count > 0) {
    fmt::print(out, "  {} of {} residuals are enough{}\n", result.residuals.size(),
               result.candidate_count,
               result.is_structure_proved_smallest ? "; fewer are not"
                                                   : "; that fewer are not was not proved");
  }
}

void print_failures(std::FILE* out, const DesignResult& result) {
  const std::vector<std::string> sentences = failure_sentences(result);
  if (!sentences.empty()) fmt::print(out, "\n  what fails\n");
  for (const std::string& sentence : sentences) fmt::print(out, "  {}\n", sentence);
}

void print_indistinguishable(std::FILE* out, const DesignResult& result) {
  if (result.indistinguishable.empty()) return;
  fmt::print(out, "\n  one signature each\n");
  for (const std::vector<FaultSet>& group : result.indistinguishable) {
    std::vector<std::string> sets;
    for (const FaultSet& set : group) {
      sets.push_back(set.empty() ? "no fault"
                                 : fmt::format("{{{}}}", join_names(result.bank.fault_names, set)));
    }
    fmt::print(out, "    {}\n", fmt::join(sets, "  "));
  }
}

void print_warnings(std::FILE* out, const PlantModel& plant, const DesignResult& result) {
  const Bank& bank = result.bank;
  if (bank.method != "uio" && !plant.nonlinearities.empty()) {
    fmt::print(out,
               "  WARNING  method \"{}\" takes the plant for linear: what its nonlinearities add "
               "reaches the residuals like a disturbance; method \"uio\" reckons with them\n",
               bank.method);
  }
  for (const ResidualReport& report : result.residuals) {
    if (report.stability.tolerance_min > 1e-12 || report.stability.tolerance_max < 1e-6) {
      fmt::print(
          out,
          "  WARNING  {}: its dimensions hold only for rank tolerances {:g} .. {:g} (smallest "
          "number kept {:.1g}, largest dropped {:.1g}): the plant's data decide it narrowly\n",
          report.name, report.stability.tolerance_min, report.stability.tolerance_max,
          report.rank_margin.smallest_kept, report.rank_margin.largest_dropped);
    }
  }
  for (const ResidualFilter& filter : bank.filters) {
    for (std::size_t j = 0; j < bank.fault_names.size(); ++j) {
      const double leak = filter.certificate.fault_gain[j];
      if (filter.sees[j] == Sensitivity::kNone && leak > kMuchLeakage * filter.threshold) {
        fmt::print(
            out,
            "  WARNING  {}: {} leaks through discretisation, up to {:.0f} % of the threshold "
            "per fault size: domain = \"sampled\" or a shorter sample time would keep it out\n",
            filter.name, bank.fault_names[j], 100.0 * leak / filter.threshold);
      }
    }
  }
}

/// bank.toml → bank.bank.json beside it.
std::filesystem::path default_output(const std::filesystem::path& request) {
  return std::filesystem::path(request).replace_extension(".bank.json");
}

void write(const Bank& bank, const DesignArguments& arguments, std::FILE* out) {
  const std::filesystem::path output = arguments.output.empty()
                                           ? default_output(arguments.request)
                                           : std::filesystem::path(arguments.output);
  try {
    write_bank(bank, output);
  } catch (const std::system_error& error) {
    throw OutputError(error.what());
  }
  fmt::print(out, "\n  written to {}\n", output.string());
}

// Shows on a terminal how far a long design is; a short one, or another stderr, sees nothing of it.
class ProgressLine {
 public:
  ~ProgressLine() {
    if (is_shown_) fmt::print(stderr, "\r\033[K");
  }
  void operator()(std::size_t done, std::size_t total) {
    const auto now = Clock::now();
    if (!is_terminal_ || now - shown_ < kPeriod) return;
    shown_ = now;
    is_shown_ = true;
    fmt::print(stderr, "\r  {} of {} steps of the design done\033[K", done, total);
    std::fflush(stderr);
  }

 private:
  using Clock = std::chrono::steady_clock;
  static constexpr std::chrono::milliseconds kPeriod{500};
  const bool is_terminal_ = ::isatty(STDERR_FILENO) == 1;
  bool is_shown_ = false;
  Clock::time_point shown_ = Clock::now();
};

DesignResult designed_with_progress(const PlantModel& plant, const BankRequest& request) {
  ProgressLine line;
  return designed_and_certified(plant, request, std::ref(line));
}

int design(const DesignArguments& arguments) {
  const BankRequest request = read_bank_request(arguments.request);
  const PlantModel plant = read_requested_plant(request);
  const DesignResult result = designed_with_progress(plant, request);
  std::FILE* out = human_output(arguments.json);
  nlohmann::ordered_json json = design_json(result);
  print_verdict(out, plant, result);
  print_assignments(out, result);
  print_observers(out, result);
  if (!result.bank.filters.empty()) print_bank(out, result.bank);
  print_failures(out, result);
  print_indistinguishable(out, result);
  if (!arguments.dbc.empty()) {
    const auto errors = quantisation_errors(result.bank, arguments.dbc);
    print_quantisation(out, result.bank, errors);
    json["quantisation"] = quantisation_json(result.bank, errors);
  }
  print_warnings(out, plant, result);
  if (!arguments.json.empty()) write_json(json, arguments.json);
  const bool has_partial_bank = !result.is_solvable && !result.bank.filters.empty();
  if (result.is_solvable || (has_partial_bank && arguments.is_partial)) {
    write(result.bank, arguments, out);
  } else if (has_partial_bank) {
    fmt::print(out, "\n  not written; --partial writes the residuals that exist\n");
  }
  return result.is_solvable ? kExitYes : kExitNo;
}

}  // namespace

void add_design_command(CLI::App& program, int& exit_code) {
  CLI::App* command = program.add_subcommand(
      "design", "Design and certify the residual bank that a bank.toml asks for");
  auto arguments = std::make_shared<DesignArguments>();
  command->add_option("BANK", arguments->request, "Bank request (bank.toml)")
      ->required()
      ->check(CLI::ExistingFile);
  command->add_option("-o,--output", arguments->output,
                      "Bank file to write; default: BANK with extension .bank.json");
  command
      ->add_option("--dbc", arguments->dbc,
                   "Also tell what rounding to the signals of this DBC does to each residual")
      ->check(CLI::ExistingFile);
  command->add_flag("--partial", arguments->is_partial,
                    "Write the residuals that exist even if not all do; the answer stays no (1)");
  add_json_option(*command, arguments->json);
  command->footer(kExitCodesHelp);
  command->callback([arguments, &exit_code] { exit_code = design(*arguments); });
}

}  // namespace faultline
