#include "diagnosis/design/bank_request.h"

#include <limits>
#include <utility>

#include <fmt/format.h>

#include "diagnosis/design/eigenstructure/read_eigenstructure.h"
#include "diagnosis/design/uio/read_uio.h"
#include "diagnosis/model/toml_reader.h"

namespace faultline {
namespace {

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
    throw decision.error("threshold", fmt::format("found \"{}\", expected a positive number",
                                                  decision.string("threshold")));
  }
  request.threshold = read_positive(decision, "threshold");
}

void read_decision(TomlTable decision, BankRequest& request) {
  read_threshold(decision, request);
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
