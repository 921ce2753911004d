#include "diagnosis/design/bank_request.h"

#include <limits>
#include <utility>

#include <fmt/format.h>

#include "diagnosis/design/eigenstructure/read_eigenstructure.h"
#include "diagnosis/design/uio/read_uio.h"
#include "diagnosis/model/toml_reader.h"

namespace faultline {
namespace {

// Of "certified" and "calibrated", until they are.
constexpr double kProvisionalThreshold = 1.0;
// More alarms than one in so many samples are no false alarms any more.
constexpr double kMostAlarms = 1e-3;
// One in 100,000 years.
constexpr double kFewestAlarmsPerHour = 1e-9;

void read_structure(TomlTable& root, BankRequest& request) {
  if (!root.has("structure")) {
    return;
  }
  if (!root.is_string("structure")) {
    request.structure = StructureChoice::kGiven;
    request.ignored_sets = root.string_lists("structure");
    return;
  }
  const std::string word = root.choice("structure", {"all", "dedicated", "smallest"});
  request.structure = word == "all"         ? StructureChoice::kAll
                      : word == "dedicated" ? StructureChoice::kDedicated
                                            : StructureChoice::kSmallest;
}

double read_positive(TomlTable& table, std::string_view key) {
  const double value = table.number(key);
  if (value <= 0.0) {
    throw table.error(key, fmt::format("found {}, expected a positive number", value));
  }
  return value;
}

void read_poles(TomlTable& root, BankRequest& request) {
  if (!root.has("decay_rate_per_s")) {
    request.poles = root.complex_numbers("poles");
    return;
  }
  if (root.has("poles")) {
    throw root.error("decay_rate_per_s", "found it beside \"poles\", expected one of the two");
  }
  request.decay_rate_per_s = read_positive(root, "decay_rate_per_s");
}

std::uint32_t read_count(TomlTable& table, std::string_view key, std::uint32_t otherwise) {
  const std::int64_t value = table.optional_integer(key).value_or(otherwise);
  if (value < 1 || value > std::numeric_limits<std::uint32_t>::max()) {
    throw table.error(key, fmt::format("found {}, expected a whole number from 1", value));
  }
  return static_cast<std::uint32_t>(value);
}

// An observer's thresholds come from the plant's bounds, a linear filter's is a number.
void read_threshold(TomlTable& decision, BankRequest& request) {
  if (request.method == "uio") {
    if (decision.has("threshold") && !decision.is_string("threshold")) {
      throw decision.error(
          "threshold",
          "found a number, expected \"certified\" or \"quadratic\": the thresholds "
          "of method \"uio\" are computed from the bounds in the plant file");
    }
    request.uio.is_threshold_quadratic =
        decision.has("threshold") &&
        decision.choice("threshold", {"certified", "quadratic"}) == "quadratic";
    return;
  }
  if (decision.is_string("threshold")) {
    request.threshold_kind =
        decision.choice("threshold", {"certified", "calibrated"}) == "certified"
            ? ThresholdBasis::Kind::kCertified
            : ThresholdBasis::Kind::kCalibrated;
    request.threshold = kProvisionalThreshold;
    return;
  }
  request.threshold = read_positive(decision, "threshold");
}

// What certified thresholds reckon with beyond the plant file.
void read_threshold_basis(TomlTable& decision, BankRequest& request) {
  const bool is_uio = request.method == "uio";
  const bool is_certified = request.threshold_kind == ThresholdBasis::Kind::kCertified;
  const auto refuse = [&](std::string_view key, std::string_view expected) {
    if (decision.has(key)) {
      throw decision.error(key, fmt::format("found it, expected it only {}", expected));
    }
  };
  if (!is_certified) {
    for (const std::string_view key : {"jitter_s", "false_alarms_per_h"}) {
      refuse(key, is_uio ? "for methods \"geometric\" and \"eigenstructure\"; method \"uio\" "
                           "takes bounds: give what is late as a [[disturbance]]"
                         : "with threshold = \"certified\"");
    }
    if (!is_uio) refuse("resolution", "with threshold = \"certified\"");
  }
  if (std::optional<TomlTable> resolution = decision.optional_table("resolution")) {
    for (const std::string& name : resolution->keys()) {
      request.resolution[name] = read_positive(*resolution, name);
    }
  }
  if (decision.has("jitter_s")) {
    request.jitter_s = read_positive(decision, "jitter_s");
    if (request.jitter_s > request.sample_time_s) {
      throw decision.error("jitter_s", fmt::format("found {}, expected at most the sample time, {}",
                                                   request.jitter_s, request.sample_time_s));
    }
  }
  if (decision.has("false_alarms_per_h")) {
    request.false_alarms_per_h = read_positive(decision, "false_alarms_per_h");
    if (request.false_alarms_per_h < kFewestAlarmsPerHour) {
      throw decision.error("false_alarms_per_h",
                           fmt::format("found {}, expected at least {:g}: no noise is known so far "
                                       "out; without the key thresholds are for bounds",
                                       request.false_alarms_per_h, kFewestAlarmsPerHour));
    }
    if (const double samples = 3600.0 / request.sample_time_s;
        request.false_alarms_per_h > kMostAlarms * samples) {
      throw decision.error(
          "false_alarms_per_h",
          fmt::format("found {}, expected at most {} (one in 1000 of the {} samples "
                      "of an hour)",
                      request.false_alarms_per_h, kMostAlarms * samples, samples));
    }
  }
}

void read_test(TomlTable& decision, BankRequest& request) {
  if (decision.has("test")) {
    const std::string test = decision.choice("test", {"comparison", "cusum", "glr"});
    request.test = test == "cusum" ? TestKind::kCusum
                   : test == "glr" ? TestKind::kGlr
                                   : TestKind::kComparison;
  }
  if (request.test == TestKind::kComparison) {
    for (const std::string_view key : {"tuned_for", "glr_window"}) {
      if (decision.has(key)) {
        throw decision.error(key, "found it, expected it only with test = \"cusum\" or \"glr\"");
      }
    }
    return;
  }
  if (request.method == "uio") {
    throw decision.error(
        "test",
        "found a sequential test, expected \"comparison\": the residuals of method "
        "\"uio\" have bounds, not a distribution");
  }
  const bool has_rate = request.threshold_kind == ThresholdBasis::Kind::kCertified &&
                        request.false_alarms_per_h > 0.0;
  if (!has_rate && request.threshold_kind != ThresholdBasis::Kind::kCalibrated) {
    throw decision.error("test",
                         "found a sequential test, expected threshold = \"certified\" with "
                         "false_alarms_per_h beside it, or \"calibrated\"");
  }
  if (decision.has("tuned_for")) request.tuned_for = read_positive(decision, "tuned_for");
  if (decision.has("glr_window")) {
    if (request.test != TestKind::kGlr) {
      throw decision.error("glr_window", "found it, expected it only with test = \"glr\"");
    }
    request.glr_window = read_count(decision, "glr_window", 1);
    if (*request.glr_window > kMaxGlrWindow) {
      throw decision.error("glr_window", fmt::format("found {}, expected at most {}",
                                                     *request.glr_window, kMaxGlrWindow));
    }
  }
}

void read_decision(TomlTable decision, BankRequest& request) {
  read_threshold(decision, request);
  read_threshold_basis(decision, request);
  read_test(decision, request);
  request.decision.dwell = read_count(decision, "dwell", DecisionRule().dwell);
  request.decision.settle = read_count(decision, "settle", DecisionRule().settle);
  if (decision.has("clearing")) {
    request.decision.clearing = read_count(decision, "clearing", 1);
  }
  if (decision.has("window")) {
    request.window = read_count(decision, "window", DecisionRule().window);
  }
}

void read_domain(TomlTable& root, BankRequest& request) {
  if (!root.has("domain")) {
    request.domain = request.method == "uio" ? DesignDomain::kSampled : DesignDomain::kContinuous;
    return;
  }
  const std::string domain = root.choice("domain", {"continuous", "sampled", "euler"});
  request.domain = domain == "continuous" ? DesignDomain::kContinuous
                   : domain == "sampled"  ? DesignDomain::kSampled
                                          : DesignDomain::kEuler;
  if (request.method == "uio" && request.domain == DesignDomain::kContinuous) {
    throw root.error("domain",
                     "found \"continuous\", expected \"sampled\" or \"euler\": the bounds of "
                     "method \"uio\" are bounds from sample to sample");
  }
}

BankRequest read_request(TomlTable root) {
  if (const std::int64_t schema = root.integer("schema"); schema != 1) {
    throw root.error("schema", fmt::format("found {}, expected 1", schema));
  }
  BankRequest request;
  request.source = root.source();
  request.text = root.text();
  request.name = root.string("name");
  request.plant = std::filesystem::path(request.source).parent_path() / root.string("plant");
  request.method = root.choice("method", {"geometric", "eigenstructure", "uio"});
  request.concurrent = read_count(root, "concurrent", 1);
  read_domain(root, request);
  request.sample_time_s = read_positive(root, "sample_time_s");
  request.decouple = root.optional_strings("decouple").value_or(std::vector<std::string>());
  if (request.method == "uio") {
    if (std::optional<TomlTable> uio = root.optional_table("uio")) {
      read_uio(*uio, request.uio);
    }
  } else {
    read_poles(root, request);
    request.decouple_constant =
        root.optional_strings("decouple_constant").value_or(std::vector<std::string>());
    read_structure(root, request);
    request.normalise = root.optional_boolean("normalise").value_or(true);
    if (request.method == "eigenstructure") {
      if (std::optional<TomlTable> options = root.optional_table("eigenstructure")) {
        read_eigenstructure(*options, request.eigenstructure);
      }
    }
  }
  read_decision(root.table("decision"), request);
  root.finish();
  return request;
}

}  // namespace

BankRequest read_bank_request(const std::filesystem::path& file) {
  return read_request(TomlTable::read_file(file));
}

BankRequest parse_bank_request(std::string_view text, const std::string& source) {
  return read_request(TomlTable::parse(text, source));
}

InputError request_error(const BankRequest& request, std::string_view key,
                         const std::string& text) {
  const std::string source = request.source.empty() ? "bank request" : request.source;
  if (request.text.empty()) {
    return {source, {}, fmt::format("{}: {}", key, text)};
  }
  return TomlTable::parse(request.text, source).error(key, text);
}

}  // namespace faultline
