#pragma once

#include <algorithm>
#include <cstddef>
#include <initializer_list>
#include <iterator>
#include <string>
#include <string_view>

namespace faultline {

/// A list of names (receivers, transmitters), to be walked from the front. All stand in one string,
/// because in a vehicle's file such lists are many and most hold one short name. Names hold no NUL.
class DbcNames {
 public:
  class const_iterator {  // NOLINT(readability-identifier-naming): as the standard library names it
   public:
    using iterator_category = std::input_iterator_tag;
    using value_type = std::string_view;
    using difference_type = std::ptrdiff_t;
    using pointer = const std::string_view*;
    using reference = std::string_view;

    const_iterator() = default;
    explicit const_iterator(const char* at) noexcept : at_(at) {}
    std::string_view operator*() const noexcept { return {at_}; }
    const_iterator& operator++() noexcept {
      at_ += std::string_view(at_).size() + 1;
      return *this;
    }
    const_iterator operator++(int) noexcept {
      const const_iterator before = *this;
      ++*this;
      return before;
    }
    friend bool operator==(const const_iterator&, const const_iterator&) = default;

   private:
    const char* at_ = nullptr;
  };

  DbcNames() = default;
  DbcNames(std::initializer_list<std::string_view> names) {
    for (const std::string_view name : names) push_back(name);
  }

  /// Names as views, valid until the list changes.
  [[nodiscard]] const_iterator begin() const noexcept { return const_iterator(names_.data()); }
  [[nodiscard]] const_iterator end() const noexcept {
    return const_iterator(names_.data() + names_.size());
  }
  [[nodiscard]] bool empty() const noexcept { return names_.empty(); }
  /// Linear in the list.
  [[nodiscard]] std::size_t size() const noexcept {
    return static_cast<std::size_t>(std::count(names_.begin(), names_.end(), '\0'));
  }
  /// Linear in the list.
  [[nodiscard]] bool contains(std::string_view name) const noexcept {
    return std::find(begin(), end(), name) != end();
  }
  void push_back(std::string_view name) { names_.append(name).push_back('\0'); }

  friend bool operator==(const DbcNames&, const DbcNames&) = default;

 private:
  std::string names_;  ///< each followed by a NUL
};

}  // namespace faultline
