#include "tools/report/traffic_record.h"

#include <chrono>

#include <fmt/format.h>

namespace faultline {

void TrafficRecord::add(const FrameBatch& batch) {
  malformed_ += batch.malformed;
  for (const CanFrame& frame : batch.frames) {
    ++frames_;
    if (frame.is_error) {
      ++error_frames_;
      continue;
    }
    const auto key = std::tuple(frame.bus, frame.is_extended, frame.id);
    auto found = identifiers_.find(key);
    if (found == identifiers_.end()) {
      if (identifiers_.size() == kMostIdentifiers) {
        ++uncounted_;
        continue;
      }
      found = identifiers_
                  .emplace(key,
                           RecordedIdentifier{
                               .bus = frame.bus, .id = frame.id, .is_extended = frame.is_extended})
                  .first;
    }
    RecordedIdentifier& traffic = found->second;
    if (traffic.periods.frames() > 0 && frame.stamp >= traffic.last) {
      traffic.gaps.record(frame.stamp - traffic.last);
    }
    traffic.last = frame.stamp;
    traffic.periods.add(frame.stamp);
  }
}

std::vector<RecordedIdentifier> TrafficRecord::identifiers() const {
  std::vector<RecordedIdentifier> all;
  for (const auto& [key, traffic] : identifiers_) all.push_back(traffic);
  return all;
}

std::string message_name(const RecordedIdentifier& traffic, const DbcDatabase& dbc) {
  const DbcMessage* const message = dbc.find_message(traffic.id, traffic.is_extended);
  if (message != nullptr) return message->name;
  return fmt::format("0x{:0{}X}", traffic.id, traffic.is_extended ? 8 : 3);
}

}  // namespace faultline
