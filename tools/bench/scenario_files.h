#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace faultline {

/// What a TOML file of the bench is, told from its keys.
enum class TomlKind {
  kPlant,        ///< has `dynamics`
  kBankRequest,  ///< has `method`
  kScenario,     ///< has `name` and, itself or by `include`, `duration_s`
  kPart,         ///< has no `name`, but other keys of scenarios, which include it
  kUnknown,
};
/// @throws InputError not TOML; std::system_error it cannot be read.
[[nodiscard]] TomlKind kind_of_toml(const std::filesystem::path& file);

/// The scenarios that `paths` name: files as they are given, and of a folder all that are in it or
/// below, sorted by path; each once. A .toml file in a folder that cannot be understood counts as
/// one: running it says what is wrong. Hidden files and folders do not count.
/// @throws InputError a folder without scenarios; std::system_error a folder cannot be read.
[[nodiscard]] std::vector<std::filesystem::path> find_scenarios(
    const std::vector<std::string>& paths);

}  // namespace faultline
