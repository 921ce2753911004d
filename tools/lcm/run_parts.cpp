#include "tools/lcm/run_parts.h"

#include <algorithm>

#include "diagnosis/model/digest.h"

namespace faultline {

bool RunParts::Part::is_complete() const noexcept {
  return chunk_count > 0 && chunks.size() == static_cast<std::size_t>(chunk_count);
}

std::string RunParts::Part::text() const {
  std::string whole;
  for (const auto& [index, bytes] : chunks) whole += bytes;
  return whole;
}

bool RunParts::Part::is_whole() const { return is_complete() && text_digest(text()) == digest; }

bool RunParts::take(const run_t& chunk) {
  const bool is_other_run = !parts_.empty() && chunk.run_id != run_id_;
  if (is_other_run) parts_.clear();
  run_id_ = chunk.run_id;
  auto part = std::find_if(parts_.begin(), parts_.end(),
                           [&](const Part& known) { return known.part == chunk.part; });
  // Another text under the same name (a list of buses that grew) replaces the one before.
  if (part != parts_.end() && part->digest != chunk.digest) {
    *part = {chunk.part, chunk.name, chunk.digest, chunk.chunk_count, {}};
  }
  if (part == parts_.end()) {
    part = parts_.insert(part, {chunk.part, chunk.name, chunk.digest, chunk.chunk_count, {}});
  }
  if (chunk.chunk < 0 || chunk.chunk >= part->chunk_count) return is_other_run;
  // lcm-gen's decoder leaves an array alone whose count is zero.
  part->chunks[chunk.chunk] =
      chunk.byte_count > 0 ? std::string(chunk.data.begin(), chunk.data.end()) : std::string();
  return is_other_run;
}

const RunParts::Part* RunParts::find(std::string_view part) const noexcept {
  const auto found = std::find_if(parts_.begin(), parts_.end(),
                                  [&](const Part& known) { return known.part == part; });
  return found == parts_.end() ? nullptr : &*found;
}

std::vector<RunPart> RunParts::whole_parts() const {
  std::vector<RunPart> whole;
  for (const Part& part : parts_) {
    if (part.is_whole()) whole.push_back({part.part, part.name, part.text()});
  }
  return whole;
}

}  // namespace faultline
