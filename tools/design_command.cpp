#include <filesystem>
#include <memory>
#include <string>
#include <system_error>

#include <CLI/App.hpp>
#include <CLI/Validators.hpp>
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "diagnosis/bank/bank_file.h"
#include "diagnosis/design/bank_request.h"
#include "diagnosis/design/design_bank.h"
#include "tools/bank_print.h"
#include "tools/bench/bench_inputs.h"
#include "tools/bench/certified_design.h"
#include "tools/cli.h"

namespace faultline {
namespace {

using Json = nlohmann::ordered_json;

struct DesignArguments {
  std::string request, output, json;
};

std::string join_names(const Bank& bank, const std::vector<std::size_t>& faults) {
  std::vector<std::string> names;
  for (const std::size_t fault : faults) names.push_back(bank.fault_names[fault]);
  return fmt::format("{}", fmt::join(names, ", "));
}

void print_failures(std::FILE* out, const DesignResult& result) {
  for (const ResidualReport& report : result.residuals) {
    if (report.exists) continue;
    fmt::print(out, "  {} (ignores {}): {}\n", report.name, join_names(result.bank, report.ignores),
               report.reason);
  }
  for (const DesignFailure& failure : result.failing) {
    fmt::print(out, "  {{{}}} hides {}: the residual that ignores the first cannot see the last\n",
               join_names(result.bank, failure.ignores), result.bank.fault_names[failure.fault]);
  }
}

Json names_json(const Bank& bank, const std::vector<std::size_t>& faults) {
  Json json = Json::array();
  for (const std::size_t fault : faults) json.push_back(bank.fault_names[fault]);
  return json;
}

Json matrix_json(const Eigen::MatrixXd& matrix) {
  Json rows = Json::array();
  for (Eigen::Index i = 0; i < matrix.rows(); ++i) {
    Json row = Json::array();
    for (Eigen::Index j = 0; j < matrix.cols(); ++j) row.push_back(matrix(i, j));
    rows.push_back(row);
  }
  return rows;
}

Json certificate_json(const FilterCertificate& certificate) {
  const RankCertificate& rank = certificate.rank;
  return {{"spectral_radius", certificate.spectral_radius},
          {"input_gain", certificate.input_gain},
          {"disturbance_gain", certificate.disturbance_gain},
          {"fault_gain", certificate.fault_gain},
          {"dc_gain", certificate.dc_gain},
          {"band_gain", certificate.band_gain},
          {"band_Hz", certificate.band_Hz},
          {"margin", certificate.margin},
          {"smallest_fault", certificate.smallest_fault},
          {"delay_s", certificate.delay_s},
          {"rank",
           {{"dim_w", rank.dim_w},
            {"dim_s", rank.dim_s},
            {"smallest_kept", rank.smallest_kept},
            {"largest_dropped", rank.largest_dropped},
            {"tolerance_min", rank.tolerance_min},
            {"tolerance_max", rank.tolerance_max}}}};
}

void add_filter_json(Json& json, const Bank& bank, const ResidualReport& report,
                     const ResidualFilter& filter) {
  json["responds_to"] = Json::array();
  json["transient_only"] = Json::array();
  json["margins"] = Json::object();
  json["dc_gain"] = Json::object();
  for (std::size_t j = 0; j < bank.fault_names.size(); ++j) {
    const std::string& fault = bank.fault_names[j];
    if (filter.sees[j] != Sensitivity::kNone) json["responds_to"].push_back(fault);
    if (filter.sees[j] == Sensitivity::kTransient) json["transient_only"].push_back(fault);
    json["margins"][fault] = report.margin[j];
    json["dc_gain"][fault] = report.dc_gain[j];
  }
  json["poles"] = Json::array();
  const Eigen::VectorXcd poles = eigenvalues(filter.F);
  for (const std::complex<double>& pole : poles) {
    json["poles"].push_back({pole.real(), pole.imag()});
  }
  json["threshold"] = filter.threshold;
  json["forget_samples"] = filter.forget_samples;
  json["certificate"] = certificate_json(filter.certificate);
}

Json design_json(const DesignResult& result) {
  const Bank& bank = result.bank;
  Json json{{"name", bank.name},
            {"solvable", result.is_solvable},
            {"failing", Json::array()},
            {"signatures_distinct", result.are_signatures_distinct},
            {"residuals", Json::array()}};
  for (const DesignFailure& failure : result.failing) {
    json["failing"].push_back({{"ignores", names_json(bank, failure.ignores)},
                               {"fault", bank.fault_names[failure.fault]}});
  }
  for (const ResidualReport& report : result.residuals) {
    Json residual{{"name", report.name},
                  {"decouples", names_json(bank, report.ignores)},
                  {"exists", report.exists},
                  {"dim_w", report.dim_w},
                  {"dim_s", report.dim_s},
                  {"projector_w", matrix_json(report.projector_w)},
                  {"projector_s", matrix_json(report.projector_s)},
                  {"quotient_dim", report.quotient_dim},
                  {"rows", report.rows}};
    if (!report.reason.empty()) residual["reason"] = report.reason;
    for (const ResidualFilter& filter : bank.filters) {
      if (filter.name == report.name) add_filter_json(residual, bank, report, filter);
    }
    json["residuals"].push_back(residual);
  }
  return json;
}

/// bank.toml → bank.bank.json beside it.
std::filesystem::path default_output(const std::filesystem::path& request) {
  return std::filesystem::path(request).replace_extension(".bank.json");
}

int design(const DesignArguments& arguments) {
  const BankRequest request = read_bank_request(arguments.request);
  const PlantModel plant = read_requested_plant(request);
  const DesignResult result = designed_and_certified(plant, request);
  std::FILE* out = human_output(arguments.json);
  fmt::print(out, "{}: {} for plant \"{}\"\n", result.bank.name,
             result.is_solvable ? "every residual exists and sees what it must" : "NOT SOLVABLE",
             plant.name);
  print_bank(out, result.bank);
  print_failures(out, result);
  if (!arguments.json.empty()) write_json(design_json(result), arguments.json);
  if (!result.is_solvable) return kExitNo;
  const std::filesystem::path output = arguments.output.empty()
                                           ? default_output(arguments.request)
                                           : std::filesystem::path(arguments.output);
  try {
    write_bank(result.bank, output);
  } catch (const std::system_error& error) {
    throw OutputError(error.what());
  }
  fmt::print(out, "\n  written to {}\n", output.string());
  return kExitYes;
}

}  // namespace

void add_design_command(CLI::App& program, int& exit_code) {
  CLI::App* command =
      program.add_subcommand("design", "Design the residual bank that a bank.toml asks for");
  auto arguments = std::make_shared<DesignArguments>();
  command->add_option("BANK", arguments->request, "Bank request (bank.toml)")
      ->required()
      ->check(CLI::ExistingFile);
  command->add_option("-o,--output", arguments->output,
                      "Bank file to write; default: BANK with extension .bank.json");
  add_json_option(*command, arguments->json);
  command->footer(kExitCodesHelp);
  command->callback([arguments, &exit_code] { exit_code = design(*arguments); });
}

}  // namespace faultline
