#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <Eigen/Core>

#include "diagnosis/model/input_error.h"
#include "diagnosis/runtime/decision.h"
#include "drivers/signal/signal_map.h"
#include "sim/fault.h"
#include "sim/integration.h"
#include "sim/perturbation.h"

namespace faultline {

enum class ControllerKind {
  kLqr,   ///< u = u₀ + v - K C⁺ (y - y₀), K from Q and R
  kGain,  ///< the same with K given
  kNone,  ///< u = u₀ + v
};

struct ControllerSpec {
  ControllerKind kind = ControllerKind::kNone;
  std::optional<Eigen::MatrixXd> K;             ///< kGain: m×n
  std::optional<Eigen::MatrixXd> Q;             ///< kLqr: n×n, identity if absent
  std::optional<Eigen::MatrixXd> R;             ///< kLqr: m×m, identity if absent
  std::optional<Eigen::VectorXd> feedforward;   ///< v, m; zero if absent
  std::optional<Eigen::VectorXd> amplitude;     ///< of a sine on each input, m; zero if absent
  std::optional<Eigen::VectorXd> frequency_Hz;  ///< of these sines, m
};

/// The plant that is simulated: by default the one of the plant file.
struct SimulationSpec {
  Integration integration;
  std::string model;              ///< a plant in C++ by name; empty: none
  std::filesystem::path library;  ///< a plant in a shared library; empty: none
  std::map<std::string, double, std::less<>> parameters;  ///< of a plant in C++: other values
  /// False in a replay: what a log names is not loaded, and the log has what it did.
  bool is_library_at_hand = true;
  bool is_library_override = false;  ///< the command line named the library, not the scenario
};

/// What the diagnosis must answer at every sample from from_s to until_s, both included.
struct Expectation {
  double from_s = 0.0;
  double until_s = 0.0;
  Verdict verdict = Verdict::kHealthy;
  std::vector<std::string> faults;  ///< sorted; for verdict isolated
};

/// A scenario file as written; paths are resolved against its folder.
struct Scenario {
  std::string name;
  std::filesystem::path file, plant, bank, dbc;
  std::string bus = "loop";
  double duration_s = 0.0;
  std::int64_t seed = 1;
  std::optional<Eigen::VectorXd> initial_state;  ///< absolute; the operating point if absent
  bool is_initial_state_known = false;           ///< the bank need not forget its start
  SimulationSpec simulation;
  ControllerSpec controller;
  std::vector<Injection> injections;
  std::vector<Perturbation> disturbances, noises;
  std::vector<Expectation> expectations;
  std::map<std::string, ChannelMapping, std::less<>> signals;
  std::string text;  ///< the file, whole
};

/// Reads a scenario (docs/design.md, "Files"). Strict.
/// @throws InputError anything wrong in it, with line and column; std::system_error cannot be read.
[[nodiscard]] Scenario read_scenario(const std::filesystem::path& file);

/// The same from a text; `file` is the name used in messages, and paths are resolved against its
/// folder.
[[nodiscard]] Scenario parse_scenario(std::string_view text, const std::filesystem::path& file);

/// Where `key` of a table stands in the scenario, for messages about what only shows beside other
/// files. `table`: empty for the top level; with `entry`, that one of a list such as [[fault]].
/// A key that is absent stands where its table does.
[[nodiscard]] SourcePosition position_in(const Scenario& scenario, std::string_view table,
                                         std::string_view key,
                                         std::optional<std::size_t> entry = std::nullopt);

/// What is wrong with `key` of a table of the scenario, at its place: see position_in.
[[nodiscard]] InputError scenario_error(const Scenario& scenario, std::string_view table,
                                        std::string_view key, const std::string& text,
                                        std::optional<std::size_t> entry = std::nullopt);

}  // namespace faultline
