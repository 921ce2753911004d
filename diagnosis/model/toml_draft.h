#pragma once

#include <memory>
#include <string>
#include <string_view>
#include <vector>

namespace faultline {

/// Another value at a place of a TOML text.
struct TomlEdit {
  enum class Kind {
    kSet,     ///< the value there; a table's keys are merged into the table that is there
    kFactor,  ///< the number there is multiplied by it
  };
  std::string place;  ///< "duration_s", "controller.kind", "fault[1].value" (the first [[fault]])
  std::string
      value;  ///< as TOML writes it; `false` for an entry of a list of tables: there is none
  Kind kind = Kind::kSet;
};

/// A TOML text to be varied: parsed once, written anew with other values in some places.
class TomlDraft {
 public:
  /// @throws InputError syntax.
  TomlDraft(std::string_view text, const std::string& source);

  /// The text with all edits, one after the other; comments are lost. Tables and lists that are not
  /// there are made; a list grows by one entry at a time. Edits within an entry that an edit has
  /// taken out are without effect.
  /// @throws std::invalid_argument a place or a value is not what it can be.
  [[nodiscard]] std::string with(const std::vector<TomlEdit>& edits) const;

  /// "" if `place` can be one, else what is wrong with it.
  [[nodiscard]] static std::string check_place(std::string_view place);

 private:
  struct Tree;
  std::shared_ptr<const Tree> tree_;
};

}  // namespace faultline
