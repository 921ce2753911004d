#include <algorithm>
#include <memory>
#include <string>
#include <vector>

#include <CLI/App.hpp>
#include <CLI/Validators.hpp>
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "diagnosis/bank/bank_file.h"
#include "diagnosis/certify/check.h"
#include "diagnosis/model/plant_file.h"
#include "tools/bank_print.h"
#include "tools/cli.h"

namespace faultline {
namespace {

using Json = nlohmann::ordered_json;

struct CheckArguments {
  std::string bank, plant, json;
};

/// What a residual must not see, and the most that it sees of it.
struct Ignored {
  std::vector<std::string> names;
  double leakage = 0.0;
};

Ignored ignored_by(const Bank& bank, const ResidualFilter& filter,
                   const FilterCertificate& certificate) {
  Ignored ignored;
  for (std::size_t j = 0; j < bank.fault_names.size(); ++j) {
    if (filter.sees[j] != Sensitivity::kNone) continue;
    ignored.names.push_back(bank.fault_names[j]);
    ignored.leakage = std::max(ignored.leakage, certificate.fault_gain[j]);
  }
  for (std::size_t i = 0; i < bank.disturbances.size(); ++i) {
    if (!bank.disturbances[i].is_ignored()) continue;
    ignored.names.push_back(bank.disturbances[i].name);
    ignored.leakage = std::max(ignored.leakage, certificate.disturbance_gain[i]);
  }
  for (const double gain : certificate.input_gain) {
    ignored.leakage = std::max(ignored.leakage, gain);
  }
  return ignored;
}

/// "sees u3, u4 with gain 1.00 .. 2.00", "sees u1 with gain at most 0.30 while it changes".
std::string seen_text(const Bank& bank, const ResidualFilter& filter,
                      const FilterCertificate& certificate, Sensitivity how) {
  std::vector<std::string> names;
  std::vector<double> gains;
  const bool is_steady = how == Sensitivity::kSteady;
  for (std::size_t j = 0; j < bank.fault_names.size(); ++j) {
    if (filter.sees[j] != how) continue;
    names.push_back(bank.fault_names[j]);
    gains.push_back(is_steady ? certificate.dc_gain[j] : certificate.fault_gain[j]);
  }
  if (names.empty()) return "";
  const auto [smallest, largest] = std::minmax_element(gains.begin(), gains.end());
  return is_steady ? fmt::format("; sees {} with gain {:.3g} .. {:.3g}", fmt::join(names, ", "),
                                 *smallest, *largest)
                   : fmt::format("; sees {} only while they change, with gain up to {:.3g}",
                                 fmt::join(names, ", "), *largest);
}

double smallest_margin(const ResidualFilter& filter, const FilterCertificate& certificate) {
  double smallest = 1.0;
  for (std::size_t j = 0; j < filter.sees.size(); ++j) {
    if (filter.sees[j] == Sensitivity::kNone) continue;
    smallest = std::min(smallest, certificate.margin[j]);
  }
  return smallest;
}

void print_residual(std::FILE* out, const Bank& bank, const ResidualFilter& filter,
                    const FilterCertificate& certificate, std::size_t width) {
  if (certificate.margin.size() != filter.sees.size()) {
    fmt::print(out, "  {:<{}}  cannot be proved\n", filter.name, width);
    return;
  }
  const Ignored ignored = ignored_by(bank, filter, certificate);
  fmt::print(
      out,
      "  {:<{}}  ignores {}: leakage {:.1g}{}{}; margin {:.3g}; dims stable for tolerances "
      "{:g} .. {:g}\n",
      filter.name, width,
      ignored.names.empty() ? "the inputs" : fmt::format("{}", fmt::join(ignored.names, ", ")),
      ignored.leakage, seen_text(bank, filter, certificate, Sensitivity::kSteady),
      seen_text(bank, filter, certificate, Sensitivity::kTransient),
      smallest_margin(filter, certificate), certificate.rank.tolerance_min,
      certificate.rank.tolerance_max);
}

Json check_json(const Bank& bank, const CheckResult& result) {
  Json json{{"bank", bank.name},
            {"plant", bank.plant_name},
            {"holds", result.holds()},
            {"findings", Json::array()},
            {"residuals", Json::array()}};
  for (const CheckFinding& finding : result.findings) {
    json["findings"].push_back({{"subject", finding.subject},
                                {"claim", finding.claim},
                                {"stored", finding.stored},
                                {"recomputed", finding.recomputed}});
  }
  for (std::size_t i = 0; i < result.certificates.size(); ++i) {
    const ResidualFilter& filter = bank.filters[i];
    const FilterCertificate& certificate = result.certificates[i];
    Json residual{{"name", filter.name}};
    if (certificate.margin.size() == filter.sees.size()) {
      residual["leakage"] = ignored_by(bank, filter, certificate).leakage;
      residual["dc_gain"] = certificate.dc_gain;
      residual["margin"] = certificate.margin;
      residual["tolerances"] = {certificate.rank.tolerance_min, certificate.rank.tolerance_max};
    }
    json["residuals"].push_back(residual);
  }
  return json;
}

int check(const CheckArguments& arguments) {
  const Bank bank = read_bank(arguments.bank);
  const PlantModel plant = read_plant(arguments.plant);
  const CheckResult result = check_bank(plant, bank);
  std::FILE* out = human_output(arguments.json);
  fmt::print(out, "{}: bank \"{}\", recomputed from plant \"{}\" and its filters\n\n",
             arguments.bank, bank.name, plant.name);
  std::size_t width = 0;
  for (const ResidualFilter& filter : bank.filters) width = std::max(width, filter.name.size());
  for (std::size_t i = 0; i < result.certificates.size(); ++i) {
    print_residual(out, bank, bank.filters[i], result.certificates[i], width);
  }
  if (result.holds()) {
    print_isolability(out, bank);
    fmt::print(out, "\n  OK: every claim holds\n");
  } else {
    fmt::print(out, "\n  WRONG: {} of its claims {} not hold\n", result.findings.size(),
               result.findings.size() == 1 ? "does" : "do");
    for (const CheckFinding& finding : result.findings) {
      fmt::print(out, "  {}\n", sentence(finding));
    }
  }
  if (!arguments.json.empty()) write_json(check_json(bank, result), arguments.json);
  return result.holds() ? kExitYes : kExitNo;
}

}  // namespace

void add_check_command(CLI::App& program, int& exit_code) {
  CLI::App* command = program.add_subcommand(
      "check", "Recompute every claim of a bank from the plant and the filters alone");
  auto arguments = std::make_shared<CheckArguments>();
  command->add_option("BANK", arguments->bank, "Bank file (*.bank.json)")
      ->required()
      ->check(CLI::ExistingFile);
  command->add_option("--plant", arguments->plant, "Plant that the bank is for (plant.toml)")
      ->required()
      ->check(CLI::ExistingFile);
  add_json_option(*command, arguments->json);
  command->footer(kExitCodesHelp);
  command->callback([arguments, &exit_code] { exit_code = check(*arguments); });
}

}  // namespace faultline
