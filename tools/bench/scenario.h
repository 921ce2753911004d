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
#include "diagnosis/model/toml_reader.h"
#include "drivers/signal/signal_map.h"
#include "sim/fault.h"
#include "sim/integration.h"
#include "sim/perturbation.h"
#include "sim/pid.h"
#include "sim/reference.h"
#include "tools/bench/expectation.h"
#include "tools/bench/scenario_include.h"

namespace faultline {

enum class ControllerKind {
  kLqr,       ///< u = u₀ + v - K C⁺ (y - y_ref), K from Q and R
  kGain,      ///< the same with K given
  kObserver,  ///< u = u₀ + v + u_ref - K (x̂ - x_ref), x̂ by an observer with gain L
  kPid,       ///< loops from an output to an input
  kRecorded,  ///< from a CSV file
  kExternal,  ///< not ours: a real unit on the bus answers
  kNone,      ///< u = u₀ + v
};
/// "lqr", "gain", "observer", "pid", "recorded", "external", "none".
[[nodiscard]] std::string_view controller_kind_name(ControllerKind kind) noexcept;

/// [[controller.loop]]: see PidLoop.
struct PidLoopSpec {
  std::string output, input;
  PidLoop loop;  ///< its channels not yet known
};

/// [[reference]]: see ReferenceStep.
struct ReferenceStepSpec {
  std::string output;
  ReferenceStep step;  ///< its output not yet known
};

struct ControllerSpec {
  ControllerKind kind = ControllerKind::kNone;
  std::optional<Eigen::MatrixXd> K;         ///< kGain: m×n; kObserver: by Q and R if absent
  std::optional<Eigen::MatrixXd> Q;         ///< kLqr, kObserver: n×n, identity if absent
  std::optional<Eigen::MatrixXd> R;         ///< kLqr, kObserver: m×m, identity if absent
  std::optional<Eigen::MatrixXd> L;         ///< kObserver: n×q; by Q_w and R_v if absent
  std::optional<Eigen::MatrixXd> Q_w, R_v;  ///< kObserver: n×n, q×q; by the plant file if absent
  std::vector<PidLoopSpec> loops;           ///< kPid
  std::filesystem::path commands;           ///< kRecorded: the CSV file
  std::optional<Eigen::VectorXd> feedforward;   ///< v, m; zero if absent
  std::optional<Eigen::VectorXd> amplitude;     ///< of a sine on each input, m; zero if absent
  std::optional<Eigen::VectorXd> frequency_Hz;  ///< of these sines, m
  std::map<std::string, double, std::less<>> reference;  ///< by output, absolute; y₀ if absent
  std::vector<ReferenceStepSpec> reference_steps;        ///< in the file's order
  std::map<std::string, Eigen::Vector2d, std::less<>> limits;  ///< by input: smallest, largest
};

/// The plant that is simulated: by default the one of the plant file.
struct SimulationSpec {
  Integration integration;
  std::string model;              ///< a plant in C++ by name; empty: none
  std::filesystem::path library;  ///< a plant in a shared library; empty: none
  std::map<std::string, double, std::less<>> parameters;  ///< of a plant in C++: other values
  /// Of a plant by its file: where in its uncertainties the simulated one lies, a number of the
  /// range for a parameter, a share per plant for a list of plants.
  std::map<std::string, std::vector<double>, std::less<>> uncertainty;
  /// False in a replay: what a log names is not loaded, and the log has what it did.
  bool is_library_at_hand = true;
  bool is_library_override = false;  ///< the command line named the library, not the scenario
};

/// A scenario file as written; paths are resolved against its folder.
struct Scenario {
  std::string name;
  std::filesystem::path file, plant, bank, dbc;
  std::string bus = "loop";
  double duration_s = 0.0;
  std::int64_t seed = 1;
  std::optional<Eigen::VectorXd> initial_state;  ///< absolute; the operating point if absent
  std::map<std::string, double, std::less<>> initial_states;  ///< the same of some states, by name
  bool is_initial_state_known = false;  ///< the bank need not forget its start
  SimulationSpec simulation;
  ControllerSpec controller;
  std::vector<Injection> injections;
  std::vector<Perturbation> disturbances, noises;
  std::vector<Expectation> expectations;
  std::map<std::string, ChannelMapping, std::less<>> signals;
  std::map<std::string, std::uint32_t, std::less<>> rates;  ///< message: cycles per frame
  std::string text;                                         ///< the file, whole
  std::vector<IncludedText> includes;  ///< the files that it includes, at whatever depth
  std::optional<TomlTable> tables;     ///< file and includes in one, to point at what is wrong
};

/// Reads a scenario (docs/design.md, "Files") and the files that it includes. Strict.
/// @throws InputError anything wrong in it, with line and column; std::system_error cannot be read.
[[nodiscard]] Scenario read_scenario(const std::filesystem::path& file);

/// The same from a text and those it includes; `file` is the name used in messages, and paths are
/// resolved against its folder.
[[nodiscard]] Scenario parse_scenario(std::string_view text, const std::filesystem::path& file,
                                      const std::vector<IncludedText>& includes = {});

/// What is wrong with `key` of a table of the scenario, for what only shows beside other files:
/// at its place in the file where it really stands. `table`: empty for the top level; with `entry`,
/// that one of a list such as [[fault]], included ones first. A key that is absent stands where its
/// table does, and a table that is absent where the scenario does.
[[nodiscard]] InputError scenario_error(const Scenario& scenario, std::string_view table,
                                        std::string_view key, const std::string& text,
                                        std::optional<std::size_t> entry = std::nullopt);

/// Sets MappedMessage::cycles_per_frame of the messages in [rates].
/// @throws InputError no sensor message of `map` (the nearest name); all of them slower than the
///   cycle.
void set_rates(const Scenario& scenario, SignalMap& map);

}  // namespace faultline
