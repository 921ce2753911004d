#include "tools/bench/scenario_files.h"

#include <algorithm>
#include <array>
#include <exception>
#include <utility>

#include "diagnosis/model/input_error.h"
#include "diagnosis/model/toml_reader.h"

namespace faultline {
namespace {

bool is_hidden(const std::filesystem::path& path) {
  return path.filename().string().starts_with('.');
}

bool is_scenario(const std::filesystem::path& file) {
  if (file.extension() != ".toml" || is_hidden(file)) return false;
  try {
    return kind_of_toml(file) == TomlKind::kScenario;
  } catch (const std::exception&) {
    return true;
  }
}

std::vector<std::filesystem::path> scenarios_in(const std::filesystem::path& folder) {
  std::vector<std::filesystem::path> files;
  using Iterator = std::filesystem::recursive_directory_iterator;
  for (Iterator entry(folder); entry != Iterator(); ++entry) {
    if (entry->is_directory()) {
      if (is_hidden(entry->path())) entry.disable_recursion_pending();
    } else if (is_scenario(entry->path())) {
      files.push_back(entry->path());
    }
  }
  std::sort(files.begin(), files.end());
  return files;
}

}  // namespace

TomlKind kind_of_toml(const std::filesystem::path& file) {
  const TomlTable root = TomlTable::read_file(file);
  if (root.has("dynamics")) return TomlKind::kPlant;
  if (root.has("method")) return TomlKind::kBankRequest;
  if (root.has("name") && (root.has("duration_s") || root.has("include"))) {
    return TomlKind::kScenario;
  }
  constexpr std::array kKeysOfParts = {"plant",  "bank",       "dbc",           "bus",
                                       "seed",   "duration_s", "include",       "simulation",
                                       "fault",  "controller", "disturbance",   "noise",
                                       "expect", "signals",    "initial_state", "rates"};
  const bool is_part =
      !root.has("name") && std::any_of(kKeysOfParts.begin(), kKeysOfParts.end(),
                                       [&](const char* key) { return root.has(key); });
  return is_part ? TomlKind::kPart : TomlKind::kUnknown;
}

std::vector<std::filesystem::path> find_scenarios(const std::vector<std::string>& paths) {
  std::vector<std::filesystem::path> scenarios;
  for (const std::filesystem::path path : paths) {
    std::vector<std::filesystem::path> found = {path};
    if (std::filesystem::is_directory(path)) {
      found = scenarios_in(path);
      if (found.empty()) {
        throw InputError(path.string(), {},
                         "found no scenario in it, expected .toml files with name and duration_s");
      }
    }
    for (std::filesystem::path& file : found) {
      const bool is_known = std::any_of(scenarios.begin(), scenarios.end(), [&](const auto& known) {
        return known.lexically_normal() == file.lexically_normal();
      });
      if (!is_known) scenarios.push_back(std::move(file));
    }
  }
  return scenarios;
}

}  // namespace faultline
