#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "diagnosis/bank/bank.h"
#include "diagnosis/design/bank_request.h"
#include "diagnosis/model/plant_model.h"
#include "drivers/signal/signal_map.h"
#include "sim/controller.h"
#include "sim/fault_schedule.h"
#include "sim/perturbation_schedule.h"
#include "sim/plant.h"
#include "tools/bench/diagnosis_inputs.h"
#include "tools/bench/scenario.h"

namespace faultline {

/// Make what a run begins with, each time anew.
using PlantMaker = std::function<std::unique_ptr<SimulatedPlant>()>;
using ControllerMaker = std::function<std::unique_ptr<Controller>()>;

/// Everything a run needs, read, checked and fitted together.
struct BenchInputs : DiagnosisInputs {
  Scenario scenario;
  PlantModel plant;
  FaultSchedule schedule;
  PerturbationSchedule perturbations;  ///< at its start
  PlantMaker make_plant;               ///< none where the simulated plant is not at hand (a replay)
  ControllerMaker make_controller;     ///< likewise; makes nullptr for an external one
  Eigen::VectorXd x_initial;           ///< absolute
  std::vector<std::string> warnings;   ///< about the scenario, which may yet be meant so
};

/// A bank that was asked for cannot be had: not every residual exists. A valid question with a
/// negative answer (exit code 1).
class NotSolvable : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Reads the plant that a bank request names.
/// @throws InputError the plant is wrong or not there; std::system_error it cannot be read.
[[nodiscard]] PlantModel read_requested_plant(const BankRequest& request);

/// Reads a scenario and all it refers to. A bank.toml is designed first; designs are cached by
/// digest in $XDG_CACHE_HOME/faultline (or ~/.cache/faultline).
/// @throws InputError, DbcError, BankFileError, SignalMapError bad input; NotSolvable;
/// @throws std::system_error a file cannot be read.
/// @param plant_library simulated instead of what the scenario says, unless empty. RUN says so
/// (part
///   "plant_library"), so that a replay knows that it has not got the plant.
[[nodiscard]] BenchInputs load_bench_inputs(const std::filesystem::path& scenario_file,
                                            const std::filesystem::path& plant_library = {});

/// The same of a scenario that has been read. @throws the same, but for what is wrong in it alone.
[[nodiscard]] BenchInputs load_bench_inputs(Scenario scenario,
                                            const std::filesystem::path& plant_library = {});

/// Another scenario beside the same plant, DBC, bank and signals: what of `base` still holds is not
/// made again.
/// @param changed top-level keys of the scenario that differ from those of `base`; none of them
///   `plant`, `bank`, `dbc`, `signals`, `rates`, `include`
/// @throws InputError the scenario does not fit; std::system_error a file cannot be read.
[[nodiscard]] BenchInputs vary_bench_inputs(const BenchInputs& base, Scenario scenario,
                                            const std::set<std::string, std::less<>>& changed);

/// The same from the parts that a log carries (scenario, plant, dbc, bank); `log` is its name, for
/// messages. Without a scenario (a diagnosis of nothing but a bank and a DBC) only what
/// DiagnosisInputs has is filled.
/// @throws InputError a part is missing (where: "LOG: RUN"); else as load_bench_inputs.
[[nodiscard]] BenchInputs bench_inputs_of_parts(const std::vector<RunPart>& parts,
                                                const std::string& log);

}  // namespace faultline
