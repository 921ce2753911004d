#include "tools/bench/scenario_include.h"

#include <algorithm>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "tools/bench/diagnosis_inputs.h"

namespace faultline {
namespace {

constexpr std::string_view kPartPrefix = "include:";
/// Files inside each other; nobody writes more, and a damaged log cannot ask for endless ones.
constexpr std::size_t kMostNested = 32;

/// Reads a scenario's includes, one inside the other.
class Inclusion {
 public:
  Inclusion(std::filesystem::path folder, const IncludeReader& read)
      : folder_(std::move(folder)), read_(&read) {}

  /// @param name of the file that `table` is, from the scenario's folder
  void complete(TomlTable& table, const std::string& name) {
    chain_.push_back(name);
    // Of several the later one holds: it is adopted first.
    std::vector<TomlTable> included;
    for (const std::string& written : table.optional_strings("include").value_or(kNone)) {
      if (auto part = open(table, name, written)) included.push_back(*std::move(part));
    }
    adopt_all(table, std::move(included));
    chain_.pop_back();
  }

  [[nodiscard]] std::vector<IncludedText> take_texts() { return std::move(texts_); }

 private:
  static inline const std::vector<std::string> kNone;

  /// The included file, complete; nullopt: it is part of the scenario already.
  std::optional<TomlTable> open(const TomlTable& table, const std::string& name,
                                const std::string& written) {
    const std::string path =
        (std::filesystem::path(name).parent_path() / written).lexically_normal().string();
    check_chain(table, path);
    const bool is_known = std::any_of(texts_.begin(), texts_.end(),
                                      [&](const IncludedText& text) { return text.name == path; });
    if (is_known) return std::nullopt;
    auto found = (*read_)(path);
    if (!found) {
      throw table.error("include", fmt::format("found no file {}, expected one",
                                               (folder_ / path).lexically_normal().string()));
    }
    TomlTable part = TomlTable::parse(found->text, found->source);
    check_is_part(part);
    texts_.push_back({path, std::move(found->text)});
    complete(part, path);
    return part;
  }

  void check_chain(const TomlTable& table, const std::string& path) const {
    if (std::find(chain_.begin(), chain_.end(), path) != chain_.end()) {
      throw table.error("include", fmt::format("found a cycle {} -> {}, expected files that do not "
                                               "include themselves",
                                               fmt::join(chain_, " -> "), path));
    }
    if (chain_.size() > kMostNested) {
      throw table.error("include", fmt::format("found more than {} files inside each other, "
                                               "expected fewer",
                                               kMostNested));
    }
  }

  /// What tells one scenario from another may not come from a common part.
  static void check_is_part(TomlTable& part) {
    if (part.has("name")) {
      throw part.error("name",
                       "found one in an included file, expected none: only the scenario "
                       "itself has a name");
    }
    if (const auto schema = part.optional_integer("schema"); schema.value_or(1) != 1) {
      throw part.error("schema", fmt::format("found {}, expected 1", *schema));
    }
  }

  /// Lists are joined in the order of the includes; of single values the last one holds.
  static void adopt_all(TomlTable& table, std::vector<TomlTable> included) {
    for (std::size_t i = 1; i < included.size(); ++i) included[i].adopt(included[i - 1]);
    if (!included.empty()) table.adopt(included.back());
  }

  std::filesystem::path folder_;
  const IncludeReader* read_;
  std::vector<std::string> chain_;
  std::vector<IncludedText> texts_;
};

const IncludedText* find_text(const std::vector<IncludedText>& texts, std::string_view name) {
  const auto found = std::find_if(texts.begin(), texts.end(),
                                  [&](const IncludedText& text) { return text.name == name; });
  return found == texts.end() ? nullptr : &*found;
}

}  // namespace

IncludeReader includes_beside(const std::filesystem::path& scenario_file) {
  return [folder = scenario_file.parent_path()](const std::string& name) {
    const std::filesystem::path file = (folder / name).lexically_normal();
    std::error_code error;
    if (!std::filesystem::exists(file, error) || std::filesystem::is_directory(file, error)) {
      return std::optional<FoundText>();
    }
    return std::optional(FoundText{read_part("include", file).text, file.string()});
  };
}

IncludeReader includes_among(std::vector<IncludedText> texts, const std::string& source) {
  return [texts = std::move(texts), source](const std::string& name) {
    const IncludedText* const text = find_text(texts, name);
    return text == nullptr ? std::optional<FoundText>()
                           : std::optional(FoundText{text->text, source + ":" + name});
  };
}

std::vector<IncludedText> adopt_includes(TomlTable& root, const std::filesystem::path& file,
                                         const IncludeReader& read) {
  Inclusion inclusion(file.parent_path(), read);
  inclusion.complete(root, file.filename().string());
  return inclusion.take_texts();
}

RunPart include_part(const IncludedText& include) {
  return {std::string(kPartPrefix) + include.name,
          std::filesystem::path(include.name).filename().string(), include.text};
}

std::vector<IncludedText> included_texts(const std::vector<RunPart>& parts) {
  std::vector<IncludedText> texts;
  for (const RunPart& part : parts) {
    if (part.part.starts_with(kPartPrefix)) {
      texts.push_back({part.part.substr(kPartPrefix.size()), part.text});
    }
  }
  return texts;
}

bool has_all_includes(const std::vector<RunPart>& parts) {
  const RunPart* const scenario = find_part(parts, "scenario");
  if (scenario == nullptr) return true;
  bool is_missing = false;
  const IncludeReader read = includes_among(included_texts(parts), "");
  try {
    TomlTable root = TomlTable::parse(scenario->text, scenario->name);
    static_cast<void>(adopt_includes(root, scenario->name, [&](const std::string& name) {
      auto found = read(name);
      is_missing = is_missing || !found;
      return found;
    }));
  } catch (const InputError&) {
    return !is_missing;
  }
  return true;
}

}  // namespace faultline
