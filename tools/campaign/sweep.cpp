#include "tools/campaign/sweep.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "diagnosis/model/toml_reader.h"
#include "tools/bench/scenario_tables.h"

namespace faultline {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::uint64_t kMost = std::numeric_limits<std::uint64_t>::max();

/// SplitMix64 (Steele, Lea, Flood 2014), one step: a bijection that leaves no trace of its order.
std::uint64_t mix(std::uint64_t x) noexcept {
  x += 0x9e3779b97f4a7c15U;
  x = (x ^ (x >> 30U)) * 0xbf58476d1ce4e5b9U;
  x = (x ^ (x >> 27U)) * 0x94d049bb133111ebU;
  return x ^ (x >> 31U);
}

std::uint64_t mix(std::uint64_t a, std::uint64_t b, std::uint64_t c) noexcept {
  return mix(mix(mix(a) ^ b) ^ c);
}

/// [0, 1), multiples of 2^-53.
double unit(std::uint64_t bits) noexcept { return static_cast<double>(bits >> 11U) * 0x1p-53; }

/// π(i) of 0 .. n-1: a Feistel network on the next even power of two, walked until it is in range.
std::uint64_t permute(std::uint64_t i, std::uint64_t n, std::uint64_t key) noexcept {
  const auto half = static_cast<unsigned>((std::bit_width(n - 1) + 1) / 2);
  const std::uint64_t mask = (std::uint64_t{1} << half) - 1;
  do {
    std::uint64_t left = i >> half, right = i & mask;
    for (std::uint64_t round = 0; round < 4; ++round) {
      const std::uint64_t next = left ^ (mix(key, round, right) & mask);
      left = right;
      right = next;
    }
    i = (left << half) | right;
  } while (i >= n);
  return i;
}

/// A number as TOML writes a floating-point one.
std::string number_text(double value) {
  std::string text = fmt::format("{}", value);
  if (text.find_first_of(".e") == std::string::npos) text += ".0";
  return text;
}

double range_value(const SweepAxis& axis, double share) {
  if (axis.is_logarithmic) return axis.from * std::pow(axis.to / axis.from, share);
  return axis.from + share * (axis.to - axis.from);
}

/// How many values a grid has on an axis.
std::uint64_t grid_size(const SweepAxis& axis) {
  return axis.values.empty() ? axis.steps : axis.values.size();
}

std::string grid_value(const SweepAxis& axis, std::uint64_t i) {
  if (!axis.values.empty()) return axis.values[i];
  if (i + 1 == axis.steps && i > 0) return number_text(axis.to);
  const double share = i == 0 ? 0.0 : static_cast<double>(i) / static_cast<double>(axis.steps - 1);
  return number_text(range_value(axis, share));
}

std::string drawn_value(const SweepAxis& axis, double share) {
  if (axis.values.empty()) return number_text(range_value(axis, share));
  const auto size = static_cast<double>(axis.values.size());
  return axis.values[static_cast<std::size_t>(std::min(share * size, size - 1.0))];
}

void read_range(TomlTable& table, Sampling sampling, SweepAxis& axis) {
  axis.from = table.number("from");
  axis.to = table.number("to");
  if (axis.from >= axis.to) {
    throw table.error("to", fmt::format("found {}, expected more than from = {}: the range is "
                                        "empty",
                                        axis.to, axis.from));
  }
  if (table.has("scale") && table.choice("scale", {"linear", "log"}) == "log") {
    axis.is_logarithmic = true;
    if (axis.from * axis.to <= 0.0) {
      throw table.error("from", fmt::format("found {} to {} with scale = \"log\", expected two "
                                            "numbers of one sign",
                                            axis.from, axis.to));
    }
  }
  if (sampling != Sampling::kGrid) {
    if (table.has("steps")) {
      throw table.error("steps", fmt::format("found it with sampling = \"{}\", expected it with "
                                             "\"grid\" only: `runs` says how many are drawn",
                                             sampling_name(sampling)));
    }
    return;
  }
  const std::int64_t steps = table.integer("steps");
  if (steps < 2) throw table.error("steps", fmt::format("found {}, expected 2 or more", steps));
  axis.steps = static_cast<std::uint64_t>(steps);
}

SweepAxis read_axis(TomlTable& table, Sampling sampling) {
  SweepAxis axis;
  axis.name = table.string("name");
  if (axis.name.empty()) throw table.error("name", "found \"\", expected a name");
  axis.is_factor = table.has("times");
  if (axis.is_factor && table.has("set")) {
    throw table.error("times", "found it beside `set`, expected one of both");
  }
  const char* const key = axis.is_factor ? "times" : "set";
  axis.place = table.string(key);
  if (const std::string wrong = TomlDraft::check_place(axis.place); !wrong.empty()) {
    throw table.error(key, wrong);
  }
  if (!table.has("values")) {
    read_range(table, sampling, axis);
    return axis;
  }
  axis.values = table.value_texts("values");
  if (axis.values.empty()) throw table.error("values", "found none, expected at least one");
  for (std::size_t i = 0; i < axis.values.size(); ++i) {
    if (std::find(axis.values.begin(), axis.values.begin() + static_cast<std::ptrdiff_t>(i),
                  axis.values[i]) != axis.values.begin() + static_cast<std::ptrdiff_t>(i)) {
      throw table.error("values",
                        fmt::format("found {} twice, expected each value once", axis.values[i]));
    }
  }
  return axis;
}

/// Of two axes, whether one sets what the other sets, or part of it.
bool is_within(const std::string& place, const std::string& other) {
  return place == other ||
         (place.starts_with(other) && (place[other.size()] == '.' || place[other.size()] == '['));
}

void check_against(const TomlTable& table, const SweepAxis& axis,
                   const std::vector<SweepAxis>& before) {
  for (const SweepAxis& other : before) {
    if (axis.name == other.name) {
      throw table.error(
          "name", fmt::format("found \"{}\" twice, expected a name for each axis", axis.name));
    }
    if (axis.is_factor || axis.place != other.place || other.is_factor) {
      if (axis.is_factor || !is_within(other.place, axis.place) || axis.place == other.place) {
        continue;
      }
      throw table.error("set", fmt::format("found \"{}\" behind \"{}\" of axis \"{}\", which lies "
                                           "in it and would be lost: expected it in front",
                                           axis.place, other.place, other.name));
    }
    throw table.error("set", fmt::format("found \"{}\", which axis \"{}\" sets, too, expected "
                                         "another place",
                                         axis.place, other.name));
  }
}

std::uint64_t saturating_product(std::uint64_t a, std::uint64_t b) {
  return b != 0 && a > kMost / b ? kMost : a * b;
}

std::uint64_t read_count(TomlTable& root, std::string_view key) {
  const std::int64_t count = root.integer(key);
  if (count < 1) throw root.error(key, fmt::format("found {}, expected 1 or more", count));
  return static_cast<std::uint64_t>(count);
}

Sampling read_sampling(TomlTable& root) {
  if (!root.has("sampling")) return Sampling::kGrid;
  const std::string name = root.choice("sampling", {"grid", "random", "latin_hypercube"});
  if (name == "grid") return Sampling::kGrid;
  return name == "random" ? Sampling::kRandom : Sampling::kLatinHypercube;
}

Sweep sweep_of(TomlTable root, const std::filesystem::path& file) {
  Sweep sweep;
  sweep.file = file;
  sweep.text = root.text();
  if (const auto schema = root.integer("schema"); schema != 1) {
    throw root.error("schema", fmt::format("found {}, expected 1", schema));
  }
  sweep.name = root.string("name");
  sweep.scenario = path_in(root, "scenario");
  std::error_code error;
  if (!std::filesystem::is_regular_file(sweep.scenario, error)) {
    throw root.error("scenario",
                     fmt::format("found no file {}, expected one", sweep.scenario.string()));
  }
  sweep.seed = root.optional_integer("seed").value_or(1);
  sweep.sampling = read_sampling(root);
  const bool is_grid = sweep.sampling == Sampling::kGrid;
  for (const char* const key : {"runs", "repeats"}) {
    const bool is_of_grid = std::string_view(key) == "repeats";
    if (root.has(key) && is_of_grid != is_grid) {
      throw root.error(key,
                       fmt::format("found it with sampling = \"{}\", expected `{}`",
                                   sampling_name(sweep.sampling), is_grid ? "repeats" : "runs"));
    }
  }
  for (TomlTable& table : root.tables("axis")) {
    SweepAxis axis = read_axis(table, sweep.sampling);
    check_against(table, axis, sweep.axes);
    sweep.axes.push_back(std::move(axis));
  }
  if (is_grid) {
    if (root.has("repeats")) sweep.repeats = read_count(root, "repeats");
    sweep.run_count = sweep.repeats;
    for (const SweepAxis& axis : sweep.axes) {
      sweep.run_count = saturating_product(sweep.run_count, grid_size(axis));
    }
  } else {
    sweep.run_count = read_count(root, "runs");
  }
  root.finish();
  return sweep;
}

/// A value as JSON, where JSON has such a one; else its text.
Json json_value(const std::string& text) {
  if (text.size() >= 2 && (text.front() == '\'' || text.front() == '"')) {
    return text.substr(1, text.size() - 2);
  }
  const Json value = Json::parse(text, nullptr, false);
  return value.is_discarded() || value.is_structured() ? Json(text) : value;
}

}  // namespace

std::string_view sampling_name(Sampling sampling) noexcept {
  switch (sampling) {
    case Sampling::kGrid:
      return "grid";
    case Sampling::kRandom:
      return "random";
    case Sampling::kLatinHypercube:
      return "latin_hypercube";
  }
  return "";
}

Sweep Sweep::read(const std::filesystem::path& file) {
  return sweep_of(TomlTable::read_file(file), file);
}

Sweep Sweep::parse(std::string_view text, const std::filesystem::path& file) {
  return sweep_of(TomlTable::parse(text, file.string()), file);
}

SweepPoint Sweep::point(std::uint64_t run) const {
  SweepPoint point{.run = run, .values = std::vector<std::string>(axes.size())};
  const auto key = static_cast<std::uint64_t>(seed);
  point.seed = static_cast<std::int64_t>(mix(key, run, kMost) >> 1U);
  std::uint64_t rest = run / repeats;
  for (std::size_t a = axes.size(); a-- > 0;) {
    if (sampling == Sampling::kGrid) {
      point.values[a] = grid_value(axes[a], rest % grid_size(axes[a]));
      rest /= grid_size(axes[a]);
      continue;
    }
    double share = unit(mix(key, run, a));
    if (sampling == Sampling::kLatinHypercube) {
      const auto n = static_cast<double>(run_count);
      const auto stratum = static_cast<double>(permute(run, run_count, mix(key, a, kMost - 1)));
      share = std::min((stratum + share) / n, std::nextafter(1.0, 0.0));
    }
    point.values[a] = drawn_value(axes[a], share);
  }
  return point;
}

std::string Sweep::point_json(const SweepPoint& point) const {
  Json json = Json::object();
  for (std::size_t a = 0; a < axes.size(); ++a) json[axes[a].name] = json_value(point.values[a]);
  return json.dump(-1, ' ', false, Json::error_handler_t::replace);
}

std::vector<TomlEdit> Sweep::edits(const SweepPoint& point) const {
  std::vector<TomlEdit> edits{{"seed", fmt::format("{}", point.seed)}};
  for (const bool is_factor : {false, true}) {
    for (std::size_t a = 0; a < axes.size(); ++a) {
      if (axes[a].is_factor != is_factor) continue;
      edits.push_back({axes[a].place, point.values[a],
                       is_factor ? TomlEdit::Kind::kFactor : TomlEdit::Kind::kSet});
    }
  }
  return edits;
}

std::set<std::string, std::less<>> Sweep::changed_keys() const {
  std::set<std::string, std::less<>> keys{"seed"};
  for (const SweepAxis& axis : axes) {
    keys.insert(axis.place.substr(0, axis.place.find_first_of(".[")));
  }
  return keys;
}

std::string Sweep::axis_json(const SweepAxis& axis) {
  Json json;
  json[axis.is_factor ? "times" : "set"] = axis.place;
  if (axis.values.empty()) {
    json["from"] = axis.from;
    json["to"] = axis.to;
    json["scale"] = axis.is_logarithmic ? "log" : "linear";
    if (axis.steps > 0) json["steps"] = axis.steps;
  } else {
    for (const std::string& value : axis.values) json["values"].push_back(json_value(value));
  }
  return json.dump(-1, ' ', false, Json::error_handler_t::replace);
}

}  // namespace faultline
