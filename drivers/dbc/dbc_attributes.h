#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

namespace faultline {

/// Value of an attribute (BA_): integer and hex kinds as integer, enumerations as their text.
using DbcAttributeValue = std::variant<std::int64_t, double, std::string>;

/// Attributes of one object by name. Reads like a std::map, but is one block of memory, because a
/// vehicle's file has many thousands of sets of one to five.
class DbcAttributes {
 public:
  using value_type = std::pair<std::string, DbcAttributeValue>;
  using const_iterator = std::vector<value_type>::const_iterator;

  /// Ascending by name.
  [[nodiscard]] const_iterator begin() const noexcept { return entries_.begin(); }
  [[nodiscard]] const_iterator end() const noexcept { return entries_.end(); }
  [[nodiscard]] std::size_t size() const noexcept { return entries_.size(); }
  [[nodiscard]] bool empty() const noexcept { return entries_.empty(); }

  /// end() if there is none.
  [[nodiscard]] const_iterator find(std::string_view name) const noexcept;
  [[nodiscard]] bool contains(std::string_view name) const noexcept { return find(name) != end(); }
  /// @throws std::out_of_range there is none.
  [[nodiscard]] const DbcAttributeValue& at(std::string_view name) const;
  /// Value to set; made if there is none. Linear in size().
  DbcAttributeValue& operator[](std::string_view name);

  /// Adds an entry without looking for its name: for many at once, with `sort` behind them.
  void append(std::string name, DbcAttributeValue value) {
    entries_.emplace_back(std::move(name), std::move(value));
  }
  /// Puts in order what `append` added. Of several with one name the last counts.
  /// @return how many were dropped for that.
  std::size_t sort();

  friend bool operator==(const DbcAttributes&, const DbcAttributes&) = default;

 private:
  std::vector<value_type> entries_;  ///< ascending by name, each name once
};

}  // namespace faultline
