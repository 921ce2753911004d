#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "diagnosis/model/toml_reader.h"
#include "tools/lcm/run_parts.h"

namespace faultline {

/// A file that a scenario includes, itself or through another.
struct IncludedText {
  std::string name;  ///< its path from the folder of the scenario, normalised
  std::string text;
};

/// Where included files come from: name (as IncludedText::name) to the text and the name that
/// messages give it; nullopt: there is none.
struct FoundText {
  std::string text, source;
};
using IncludeReader = std::function<std::optional<FoundText>(const std::string& name)>;

/// Files beside the scenario. @throws (when called) std::system_error one cannot be read.
[[nodiscard]] IncludeReader includes_beside(const std::filesystem::path& scenario_file);
/// Texts at hand, `source` before their names in messages.
[[nodiscard]] IncludeReader includes_among(std::vector<IncludedText> texts,
                                           const std::string& source);

/// Puts a scenario and all that it includes together in `root`, its own text: what an included file
/// says holds unless the including one says otherwise; lists of tables are joined, included ones
/// first. A file that comes by two ways is taken once.
/// @param file name of the scenario, for messages
/// @return the files, in the order in which they are first met
/// @throws InputError a file is not there, or includes itself.
std::vector<IncludedText> adopt_includes(TomlTable& root, const std::filesystem::path& file,
                                         const IncludeReader& read);

/// "include:NAME": the part of a log that carries an included file.
[[nodiscard]] RunPart include_part(const IncludedText& include);
/// The included files among the parts of a run.
[[nodiscard]] std::vector<IncludedText> included_texts(const std::vector<RunPart>& parts);
/// Whether the parts of a run have all that its scenario includes. A scenario that cannot be
/// understood misses nothing: reading it says what is wrong.
[[nodiscard]] bool has_all_includes(const std::vector<RunPart>& parts);

}  // namespace faultline
