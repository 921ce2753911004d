#include "diagnosis/design/uio/read_uio.h"

#include <numbers>

#include <fmt/format.h>

namespace faultline {
namespace {

// A search over more is no search.
constexpr std::size_t kMostValues = 100;

std::vector<double> read_list(TomlTable& table, std::string_view key) {
  const std::vector<double> values = table.numbers(key);
  if (values.empty() || values.size() > kMostValues) {
    throw table.error(
        key, fmt::format("found {} numbers, expected 1 to {}", values.size(), kMostValues));
  }
  return values;
}

void read_alpha(TomlTable& table, ObserverRequest& request) {
  if (!table.has("alpha")) return;
  request.alpha = read_list(table, "alpha");
  for (const double alpha : request.alpha) {
    if (alpha <= 0.0 || alpha >= 1.0) {
      throw table.error("alpha",
                        fmt::format("found {}, expected numbers between 0 and 1: the decay per "
                                    "sample of the quadratic bound",
                                    alpha));
    }
  }
}

void read_observer(TomlTable& table, std::string_view faults_key, ObserverRequest& request) {
  request.carry = table.optional_strings(faults_key).value_or(std::vector<std::string>());
  read_alpha(table, request);
  if (!request.carry.empty()) {
    request.drift_per_s = table.number("drift_per_s");
    if (request.drift_per_s <= 0.0) {
      throw table.error("drift_per_s",
                        fmt::format("found {}, expected a positive number: the rate of change of "
                                    "the faults it estimates, small for smooth estimates, large "
                                    "for fast ones",
                                    request.drift_per_s));
    }
  }
  if (table.has("decoupling")) {
    const std::string choice = table.choice("decoupling", {"best", "full", "none"});
    request.decoupling = choice == "best"   ? DecouplingChoice::kBest
                         : choice == "full" ? DecouplingChoice::kFull
                                            : DecouplingChoice::kNone;
  }
}

void read_band(TomlTable& table, UioRequest& request) {
  if (!table.has("band_rad")) return;
  const Eigen::VectorXd band = table.vector("band_rad", 2);
  if (band[0] < 0.0 || band[1] > std::numbers::pi || band[0] > band[1]) {
    throw table.error("band_rad",
                      fmt::format("found [{}, {}], expected [lowest, highest] within 0 .. pi, "
                                  "radians per sample (2 pi f sample_time_s)",
                                  band[0], band[1]));
  }
  request.band_low_rad = band[0];
  request.band_high_rad = band[1];
}

void read_multipliers(TomlTable& table, UioRequest& request) {
  if (table.has("a_0")) request.a_0 = read_list(table, "a_0");
  if (table.has("v")) request.v = read_list(table, "v");
  for (const double v : request.v) {
    if (v <= 0.0) throw table.error("v", fmt::format("found {}, expected positive numbers", v));
  }
}

}  // namespace

void read_uio(TomlTable& table, UioRequest& request) {
  request.detect = table.optional_strings("detect").value_or(std::vector<std::string>());
  if (table.has("criterion")) {
    request.is_h_minus = table.choice("criterion", {"h_minus", "l_infinity"}) == "h_minus";
  }
  if (table.has("weight")) {
    request.is_weight_full = table.choice("weight", {"scalar", "full"}) == "full";
  }
  read_band(table, request);
  read_multipliers(table, request);
  read_observer(table, "carry", request.detection);
  if (std::optional<TomlTable> estimate = table.optional_table("estimate")) {
    read_observer(*estimate, "faults", request.estimation);
    if (request.estimation.carry.empty()) {
      throw estimate->error("faults", "found no fault, expected the faults to be estimated");
    }
  }
}

}  // namespace faultline
