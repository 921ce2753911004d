#include <algorithm>
#include <string_view>
#include <vector>

#include "drivers/dbc/dbc_overlap_check.h"
#include "drivers/dbc/dbc_parse.h"

namespace faultline {
namespace {

void sort_value_names(std::vector<DbcValueName>& names, DbcPosition position,
                      std::string_view owner, DbcWarnings& warnings) {
  const auto by_value = [](const DbcValueName& a, const DbcValueName& b) {
    return a.value < b.value;
  };
  if (!std::is_sorted(names.begin(), names.end(), by_value)) {
    std::stable_sort(names.begin(), names.end(), by_value);
  }
  const auto same = [](const DbcValueName& a, const DbcValueName& b) { return a.value == b.value; };
  const auto repeated = std::adjacent_find(names.begin(), names.end(), same);
  if (repeated == names.end()) return;
  warnings.warn(position, "{} has several names for the value {}; the first counts", shown(owner),
                repeated->value);
  names.erase(std::unique(names.begin(), names.end(), same), names.end());
}

}  // namespace

void finish_dbc(DbcParse& parse) {
  DbcDatabase& database = parse.database;
  const auto sort = [&](DbcAttributes& attributes, DbcPosition position, std::string_view owner) {
    const std::size_t dropped = attributes.sort();
    if (dropped == 0) return;
    parse.warnings.warn(position, "{} attributes of {} are given twice; the last counts", dropped,
                        shown(owner));
  };
  sort(database.attributes, {}, "the network");
  sort(database.default_attributes, {}, "the defaults");
  for (auto& [node, attributes] : database.node_attributes) sort(attributes, {}, node);
  for (DbcEnvironmentVariable& variable : database.environment_variables) {
    sort(variable.attributes, variable.position, variable.name);
    sort_value_names(variable.value_names, variable.position, variable.name, parse.warnings);
  }
  DbcOverlapCheck overlaps;
  for (DbcMessage& message : database.messages) {
    sort(message.attributes, message.position, message.name);
    for (DbcSignal& signal : message.signals) {
      sort(signal.attributes, signal.position, signal.name);
      sort_value_names(signal.value_names, signal.position, signal.name, parse.warnings);
    }
    link_multiplexers(message, parse.warnings);
    const auto index = static_cast<std::size_t>(&message - database.messages.data());
    overlaps.check(message, index, parse.warnings, database.overlaps);
  }
}

}  // namespace faultline
