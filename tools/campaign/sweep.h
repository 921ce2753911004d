#pragma once

#include <cstdint>
#include <filesystem>
#include <set>
#include <string>
#include <vector>

#include "diagnosis/model/toml_draft.h"
#include "tools/bench/scenario.h"

namespace faultline {

/// How the points of a sweep are chosen.
enum class Sampling {
  kGrid,            ///< all combinations of the axes' values
  kRandom,          ///< each axis drawn independently for each run
  kLatinHypercube,  ///< likewise, but of n runs one lies in each n-th of each axis
};
/// "grid", "random", "latin_hypercube".
[[nodiscard]] std::string_view sampling_name(Sampling sampling) noexcept;

/// What a sweep varies at one place of its scenario: listed values, or numbers of a range.
struct SweepAxis {
  std::string name;
  std::string place;                ///< see TomlEdit
  bool is_factor = false;           ///< multiplies what is there
  std::vector<std::string> values;  ///< as TOML writes them; empty: a range
  double from = 0.0, to = 0.0;
  bool is_logarithmic = false;
  std::uint64_t steps = 0;  ///< of a grid: equally spaced numbers, both ends among them
};

/// One run of a sweep.
struct SweepPoint {
  std::uint64_t run = 0;
  std::vector<std::string> values;  ///< per axis, as TOML writes them
  std::int64_t seed = 0;            ///< of the scenario, unless an axis sets it
};

/// A scenario with ranges. Every run is a function of the sweep and its number alone: the same on
/// every machine, in whatever order and by whomever it is done.
///
/// Run r draws u_a in [0, 1) for axis a from SplitMix64, seeded by the sweep's seed, r and a; in a
/// Latin hypercube u_a = (π_a(r) + u_a') / n with π_a a permutation of the n runs (a Feistel
/// network, so that no run needs to know of another). A range then gives from + u (to - from), or
/// from·(to / from)^u, a list its entry number floor(u·size). In a grid the first axis varies
/// slowest, and the repeats of a point follow each other.
class Sweep {
 public:
  /// @throws InputError anything wrong in it, with line and column; std::system_error cannot be
  /// read.
  [[nodiscard]] static Sweep read(const std::filesystem::path& file);
  [[nodiscard]] static Sweep parse(std::string_view text, const std::filesystem::path& file);

  std::filesystem::path file;
  std::string text;  ///< whole
  std::string name;
  std::filesystem::path scenario;
  Sampling sampling = Sampling::kGrid;
  std::uint64_t repeats = 1;  ///< of each point of a grid, each with a seed of its own
  std::int64_t seed = 1;
  std::vector<SweepAxis> axes;
  /// How many runs it has; the largest number if there are more.
  std::uint64_t run_count = 0;

  [[nodiscard]] SweepPoint point(std::uint64_t run) const;
  /// {"size": 0.5, "fault": "{ target = .. }"}: names of axes and values.
  [[nodiscard]] std::string point_json(const SweepPoint& point) const;
  /// Changes to the scenario that make it that of a point.
  [[nodiscard]] std::vector<TomlEdit> edits(const SweepPoint& point) const;
  /// Top-level keys of the scenario that the runs differ in.
  [[nodiscard]] std::set<std::string, std::less<>> changed_keys() const;
  /// What the sweep says of an axis, as JSON.
  [[nodiscard]] static std::string axis_json(const SweepAxis& axis);
};

}  // namespace faultline
