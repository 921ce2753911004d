#include "drivers/dbc/dbc_attributes.h"

#include <algorithm>
#include <stdexcept>

namespace faultline {
namespace {

bool is_before(const DbcAttributes::value_type& entry, std::string_view name) noexcept {
  return entry.first < name;
}

}  // namespace

DbcAttributes::const_iterator DbcAttributes::find(std::string_view name) const noexcept {
  const auto found = std::lower_bound(entries_.begin(), entries_.end(), name, is_before);
  return found != entries_.end() && found->first == name ? found : entries_.end();
}

const DbcAttributeValue& DbcAttributes::at(std::string_view name) const {
  const auto found = find(name);
  if (found == end()) throw std::out_of_range("no attribute " + std::string(name));
  return found->second;
}

DbcAttributeValue& DbcAttributes::operator[](std::string_view name) {
  const auto found = std::lower_bound(entries_.begin(), entries_.end(), name, is_before);
  if (found != entries_.end() && found->first == name) return found->second;
  return entries_.emplace(found, std::string(name), DbcAttributeValue{})->second;
}

std::size_t DbcAttributes::sort() {
  if (entries_.size() < 2) return 0;
  const auto by_name = [](const value_type& a, const value_type& b) { return a.first < b.first; };
  if (!std::is_sorted(entries_.begin(), entries_.end(), by_name)) {
    std::stable_sort(entries_.begin(), entries_.end(), by_name);
  }
  // Walk backwards, so that the last of each name is the one that stays.
  const auto kept =
      std::unique(entries_.rbegin(), entries_.rend(),
                  [](const value_type& a, const value_type& b) { return a.first == b.first; });
  const auto dropped = static_cast<std::size_t>(entries_.rend() - kept);
  entries_.erase(entries_.begin(), kept.base());
  return dropped;
}

}  // namespace faultline
