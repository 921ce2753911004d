#pragma once

#include <filesystem>

#include "diagnosis/model/toml_reader.h"
#include "tools/bench/scenario.h"

namespace faultline {

// The tables of a scenario file, one function each; `folder` is what paths in them are relative to.
// @throws InputError what is wrong in the table.

[[nodiscard]] SimulationSpec read_simulation(TomlTable table, const std::filesystem::path& folder);
[[nodiscard]] Injection read_injection(TomlTable table, double duration_s);
[[nodiscard]] ControllerSpec read_controller(TomlTable table, const std::filesystem::path& folder);
/// [[reference]], which only a controller that follows one may have.
[[nodiscard]] ReferenceStepSpec read_reference_step(TomlTable table,
                                                    const ControllerSpec& controller);
[[nodiscard]] Perturbation read_perturbation(TomlTable table, const std::filesystem::path& folder);
/// [rates]: cycles per frame, by message.
[[nodiscard]] std::map<std::string, std::uint32_t, std::less<>> read_rates(TomlTable table);
[[nodiscard]] Expectation read_expectation(TomlTable table, double duration_s);

/// Whether no verdict can meet both: they overlap in time, and what one allows the other forbids.
[[nodiscard]] bool contradict(const Expectation& a, const Expectation& b);

/// The folder of the file in which `key` really stands: what paths there are relative to.
[[nodiscard]] std::filesystem::path folder_of(const TomlTable& table, std::string_view key);
/// The path that `key` names, from that folder.
[[nodiscard]] std::filesystem::path path_in(TomlTable& table, std::string_view key);
/// A number that must be positive.
[[nodiscard]] double read_positive(TomlTable& table, std::string_view key);
/// `value`, which `key` has, if it is a time.
double require_time(const TomlTable& table, std::string_view key, double value);

}  // namespace faultline
