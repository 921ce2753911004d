#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include <faultline/run_t.hpp>

namespace faultline {

/// A text a run was made from; goes into the log (RUN).
struct RunPart {
  std::string part;  ///< scenario, include:NAME, plant, bank_request, bank, dbc, buses
  std::string name;  ///< file name
  std::string text;
};

/// Puts the parts of a run together again from the chunks of its RUN messages, in any order and
/// however often they come.
class RunParts {
 public:
  struct Part {
    std::string part, name, digest;
    std::int32_t chunk_count = 0;
    std::map<std::int32_t, std::string> chunks;

    /// All chunks are there.
    [[nodiscard]] bool is_complete() const noexcept;
    /// The text of the chunks that are there.
    [[nodiscard]] std::string text() const;
    /// Complete, and its text has the digest that the run gave it.
    [[nodiscard]] bool is_whole() const;
  };

  /// A chunk of another run (another run_id) forgets the one before.
  /// @return true if it does.
  bool take(const run_t& chunk);

  /// Empty before the first chunk.
  [[nodiscard]] const std::string& run_id() const noexcept { return run_id_; }
  /// In the order in which they first came.
  [[nodiscard]] const std::vector<Part>& parts() const noexcept { return parts_; }
  /// nullptr if no chunk of it came.
  [[nodiscard]] const Part* find(std::string_view part) const noexcept;
  /// The whole parts.
  [[nodiscard]] std::vector<RunPart> whole_parts() const;

 private:
  std::string run_id_;
  std::vector<Part> parts_;
};

}  // namespace faultline
