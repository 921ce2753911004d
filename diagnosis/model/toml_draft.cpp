#include "diagnosis/model/toml_draft.h"

#include <charconv>
#include <cstddef>
#include <optional>
#include <sstream>
#include <stdexcept>
#include <utility>

#include <fmt/format.h>
#include <toml++/toml.h>

#include "diagnosis/model/input_error.h"

namespace faultline {
namespace {

/// More entries than this nobody writes; a slip of the pen does.
constexpr std::size_t kMostEntries = 4096;

/// One step on the way to a place: a key, and the number of an entry of the list there.
struct Step {
  std::string key;
  std::optional<std::size_t> entry;  ///< from 1
};

bool is_key_character(char c) {
  return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' ||
         c == '-';
}

std::invalid_argument wrong_place(std::string_view place) {
  return std::invalid_argument(
      fmt::format("found \"{}\", expected the place of a value, e.g. \"duration_s\", "
                  "\"controller.kind\", \"fault[1].value\"",
                  place));
}

std::vector<Step> steps_of(std::string_view place) {
  std::vector<Step> steps;
  std::size_t at = 0;
  for (;;) {
    const std::size_t begin = at;
    while (at < place.size() && is_key_character(place[at])) ++at;
    if (at == begin) throw wrong_place(place);
    Step step{std::string(place.substr(begin, at - begin)), std::nullopt};
    if (at < place.size() && place[at] == '[') {
      std::size_t entry = 0;
      const char* const end = place.data() + place.size();
      const auto [next, error] = std::from_chars(place.data() + at + 1, end, entry);
      if (error != std::errc() || next == end || *next != ']' || entry == 0 ||
          entry > kMostEntries) {
        throw wrong_place(place);
      }
      step.entry = entry;
      at = static_cast<std::size_t>(next - place.data()) + 1;
    }
    steps.push_back(std::move(step));
    if (at == place.size()) return steps;
    if (place[at] != '.') throw wrong_place(place);
    ++at;
  }
}

/// Something that is no longer there, until all edits are done.
bool is_taken_out(const toml::node& entry) { return entry.is_boolean(); }

/// The list of tables under `key`, made if there is none.
toml::array& list_at(toml::table& table, const std::string& key, std::string_view place) {
  if (table.get(key) == nullptr) table.insert(key, toml::array{});
  toml::array* const list = table.get(key)->as_array();
  if (list == nullptr) {
    throw std::invalid_argument(fmt::format("{}: found no list at {}, expected one", place, key));
  }
  return *list;
}

/// The entry that `step` names; it may be one behind the last.
toml::node& entry_at(toml::table& table, const Step& step, std::string_view place) {
  toml::array& list = list_at(table, step.key, place);
  if (*step.entry == list.size() + 1) list.push_back(toml::table{});
  if (*step.entry > list.size()) {
    throw std::invalid_argument(fmt::format("{}: found {} entries of {}, expected at least {}",
                                            place, list.size(), step.key, *step.entry - 1));
  }
  return list[*step.entry - 1];
}

/// The table in which the last step lies; null: it is within something that was taken out.
toml::table* parent_of(toml::table& root, const std::vector<Step>& steps, std::string_view place) {
  toml::table* table = &root;
  for (std::size_t i = 0; i + 1 < steps.size(); ++i) {
    const Step& step = steps[i];
    toml::node* next = nullptr;
    if (step.entry) {
      next = &entry_at(*table, step, place);
      if (is_taken_out(*next)) return nullptr;
    } else {
      if (table->get(step.key) == nullptr) table->insert(step.key, toml::table{});
      next = table->get(step.key);
    }
    table = next->as_table();
    if (table == nullptr) {
      throw std::invalid_argument(
          fmt::format("{}: found no table at {}, expected one", place, step.key));
    }
  }
  return table;
}

void merge(toml::table& table, const toml::table& other) {
  for (auto&& [key, value] : other) table.insert_or_assign(key, value);
}

double number_of(const toml::node* node, std::string_view what) {
  const auto number = node != nullptr && node->is_number() ? node->value<double>() : std::nullopt;
  if (!number) throw std::invalid_argument(fmt::format("{}: found no number, expected one", what));
  return *number;
}

void set_entry(toml::array& list, std::size_t index, const toml::node& value,
               std::string_view place) {
  if (value.is_boolean() && !value.as_boolean()->get()) {
    list.replace(list.cbegin() + static_cast<std::ptrdiff_t>(index), false);
    return;
  }
  if (!value.is_table()) {
    throw std::invalid_argument(
        fmt::format("{}: found a value, expected a table, or false for no entry", place));
  }
  if (!is_taken_out(list[index])) merge(*list[index].as_table(), *value.as_table());
}

void set_key(toml::table& table, const std::string& key, const toml::node& value) {
  toml::node* const present = table.get(key);
  if (present != nullptr && present->is_table() && value.is_table()) {
    merge(*present->as_table(), *value.as_table());
  } else {
    table.insert_or_assign(key, value);
  }
}

/// The list in which an entry was taken out.
void apply(toml::table& root, const TomlEdit& edit) {
  const std::vector<Step> steps = steps_of(edit.place);
  toml::table parsed;
  try {
    parsed = toml::parse(fmt::format("v = {}\n", edit.value));
  } catch (const toml::parse_error& error) {
    throw std::invalid_argument(fmt::format("{}: found {}, expected a value: {}", edit.place,
                                            edit.value, error.description()));
  }
  const toml::node& value = *parsed.get("v");
  toml::table* const parent = parent_of(root, steps, edit.place);
  if (parent == nullptr) return;
  const Step& last = steps.back();
  if (edit.kind == TomlEdit::Kind::kFactor) {
    const double factor = number_of(&value, edit.place);
    if (last.entry) throw wrong_place(edit.place);
    parent->insert_or_assign(last.key, number_of(parent->get(last.key), edit.place) * factor);
  } else if (last.entry) {
    static_cast<void>(entry_at(*parent, last, edit.place));
    set_entry(*parent->get(last.key)->as_array(), *last.entry - 1, value, edit.place);
  } else {
    set_key(*parent, last.key, value);
  }
}

/// Takes out what set_entry marked.
void sweep_out(toml::table& table) {
  std::vector<std::string> empty;
  for (auto&& [key, value] : table) {
    toml::array* const list = value.as_array();
    if (list == nullptr || list->empty()) continue;
    bool has_tables = false, has_marks = false;
    for (const toml::node& entry : *list) {
      has_tables = has_tables || entry.is_table();
      has_marks = has_marks || is_taken_out(entry);
    }
    if (!has_marks) continue;
    for (std::size_t i = list->size(); i-- > 0;) {
      if (is_taken_out((*list)[i])) list->erase(list->cbegin() + static_cast<std::ptrdiff_t>(i));
    }
    if (!has_tables) empty.emplace_back(key.str());
  }
  for (const std::string& key : empty) table.erase(key);
}

}  // namespace

struct TomlDraft::Tree {
  toml::table root;
};

TomlDraft::TomlDraft(std::string_view text, const std::string& source) {
  try {
    tree_ = std::make_shared<const Tree>(Tree{toml::parse(text, source)});
  } catch (const toml::parse_error& error) {
    const toml::source_position& at = error.source().begin;
    throw InputError(source, {static_cast<int>(at.line), static_cast<int>(at.column)},
                     std::string(error.description()));
  }
}

std::string TomlDraft::with(const std::vector<TomlEdit>& edits) const {
  toml::table root = tree_->root;
  for (const TomlEdit& edit : edits) apply(root, edit);
  sweep_out(root);
  std::ostringstream text;
  text << root << '\n';
  return text.str();
}

std::string TomlDraft::check_place(std::string_view place) {
  try {
    static_cast<void>(steps_of(place));
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "";
}

}  // namespace faultline
