#include <map>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include <CLI/App.hpp>
#include <CLI/Validators.hpp>
#include <fmt/format.h>
#include <fmt/ranges.h>

#include "diagnosis/model/plant_text.h"
#include "sim/linearisation.h"
#include "sim/plant_library.h"
#include "sim/plants/catalogue.h"
#include "tools/cli.h"

namespace faultline {
namespace {

struct LineariseArguments {
  std::string plant, library, output = "-";
  std::vector<std::string> hold, set;
  bool is_list = false;
};

// Beyond it a Jacobian's entry is no slope: the function has a kink within reach of its
// differences.
constexpr double kDoubtfulError = 1e-6;

int list_catalogue() {
  for (const faultline_plant_table* plant : plant_catalogue()) {
    fmt::print("{:<16}  {}\n{:<16}  {}\n", plant->name, plant->description, "", plant->source);
  }
  return kExitYes;
}

/// NAME=VALUE, each name once.
std::map<std::string, double, std::less<>> read_values(const char* option,
                                                       const std::vector<std::string>& texts) {
  std::map<std::string, double, std::less<>> values;
  for (const std::string& text : texts) {
    const std::size_t equals = text.find('=');
    const std::string number = equals == std::string::npos ? "" : text.substr(equals + 1);
    if (equals == 0 || number.empty() || !check_finite(number).empty()) {
      throw std::invalid_argument(
          fmt::format("{}: found \"{}\", expected NAME=NUMBER", option, text));
    }
    if (!values.emplace(text.substr(0, equals), std::stod(number)).second) {
      throw std::invalid_argument(
          fmt::format("{}: found \"{}\" twice, expected it once", option, text.substr(0, equals)));
    }
  }
  return values;
}

std::shared_ptr<const faultline_plant_table> open_plant(const LineariseArguments& arguments) {
  if (arguments.plant.empty() == arguments.library.empty()) {
    throw std::invalid_argument(fmt::format(
        "found {}, expected either PLANT or --plant-lib",
        arguments.plant.empty() ? "neither PLANT nor --plant-lib" : "PLANT and --plant-lib"));
  }
  if (!arguments.library.empty()) return load_plant_library(arguments.library);
  return {std::shared_ptr<void>(), &catalogue_plant(arguments.plant)};
}

/// "-1.2", "-0.3 ± 2i"; one of each conjugate pair.
std::vector<std::string> eigenvalue_texts(const Linearisation& linearisation) {
  std::vector<std::string> texts;
  for (const std::complex<double>& value : linearisation.eigenvalues) {
    if (value.imag() < 0.0) continue;
    texts.push_back(value.imag() == 0.0
                        ? fmt::format("{:.6g}", value.real())
                        : fmt::format("{:.6g} ± {:.6g}i", value.real(), value.imag()));
  }
  return texts;
}

std::vector<std::string> head_of(const faultline_plant_table& table,
                                 const LineariseArguments& arguments,
                                 const Linearisation& linearisation) {
  std::vector<std::string> head{
      fmt::format("{}: {}", table.name, table.description), table.source,
      fmt::format(
          "Made by faultline linearise {}{}{}",
          arguments.library.empty() ? arguments.plant : "--plant-lib " + arguments.library,
          arguments.hold.empty() ? "" : fmt::format(" --hold {}", fmt::join(arguments.hold, " ")),
          arguments.set.empty() ? "" : fmt::format(" --set {}", fmt::join(arguments.set, " "))),
      fmt::format("Largest estimated error of a slope: {:.1e} sizes per size{}",
                  linearisation.largest_error,
                  linearisation.worst_entry.empty() ? "" : ", " + linearisation.worst_entry),
      fmt::format("Eigenvalues (per second): {}",
                  fmt::join(eigenvalue_texts(linearisation), ", "))};
  if (!linearisation.unseen.empty()) {
    head.push_back(fmt::format("In no equation at this point, and left out: {}",
                               fmt::join(linearisation.unseen, ", ")));
  }
  return head;
}

void print_warnings(const Linearisation& linearisation) {
  std::vector<std::string> unstable;
  for (const std::complex<double>& value : linearisation.eigenvalues) {
    if (value.real() > 0.0 && value.imag() >= 0.0) {
      unstable.push_back(fmt::format("{:.3g}", value.real()));
    }
  }
  if (!unstable.empty()) {
    fmt::print(stderr, "faultline: warning: unstable there: eigenvalues with real part {}\n",
               fmt::join(unstable, ", "));
  }
  if (linearisation.largest_error > kDoubtfulError) {
    fmt::print(
        stderr,
        "faultline: warning: {} is only known to {:.1e} sizes per size: the equations have a "
        "kink near\n",
        linearisation.worst_entry, linearisation.largest_error);
  }
  if (!linearisation.unseen.empty()) {
    fmt::print(stderr, "faultline: warning: in no equation at this point, and left out: {}\n",
               fmt::join(linearisation.unseen, ", "));
  }
}

int run_linearise(const LineariseArguments& arguments) {
  if (arguments.is_list) return list_catalogue();
  const auto table = open_plant(arguments);
  try {
    const Linearisation linearisation =
        linearise(*table, {.parameters = read_values("--set", arguments.set),
                           .hold = read_values("--hold", arguments.hold)});
    const std::string text =
        plant_text(linearisation.model, head_of(*table, arguments, linearisation));
    write_to(arguments.output, [&text](std::FILE* out) { fmt::print(out, "{}", text); });
    print_warnings(linearisation);
  } catch (const NoLinearisation& none) {
    fmt::print(stderr, "faultline: plant \"{}\": {}\n", table->name, none.what());
    return kExitNo;
  }
  return kExitYes;
}

}  // namespace

void add_linearise_command(CLI::App& program, int& exit_code) {
  CLI::App* command = program.add_subcommand(
      "linearise",
      "Write the plant file of a plant in C++, about the equilibrium nearest to its "
      "nominal point");
  auto arguments = std::make_shared<LineariseArguments>();
  command->add_option("PLANT", arguments->plant, "A plant that ships with Faultline: see --list");
  command->add_option("--plant-lib", arguments->library, "A plant in a shared library (my.so)");
  command->add_option("-o,--output", arguments->output, "Plant file to write; default: stdout");
  command->add_option("--hold", arguments->hold,
                      "A state or an input that keeps the given value: NAME=VALUE");
  command->add_option("--set", arguments->set, "Another value of a parameter: NAME=VALUE");
  command->add_flag("--list", arguments->is_list, "List the plants that ship with Faultline");
  command->footer(kExitCodesHelp);
  command->callback([arguments, &exit_code] { exit_code = run_linearise(*arguments); });
}

}  // namespace faultline
