#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <unordered_set>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include "diagnosis/bank/bank_file.h"
#include "diagnosis/bank/json_cursor.h"
#include "diagnosis/bank/observer_parse.h"

namespace faultline {
namespace {

// Bound against hostile files, far above any plant: eigenvalues of one F of this order take about a
// second, and channels times order stay within the file's size anyway.
constexpr std::size_t kMaxOrder = 512;

// Likewise: an observer's course has some thousands.
constexpr std::size_t kMaxCourseRows = 100'000;

std::vector<Sensitivity> read_sensitivities(const JsonCursor& list, std::size_t fault_count) {
  constexpr std::array kSensitivities = {Sensitivity::kNone, Sensitivity::kTransient,
                                         Sensitivity::kSteady};
  std::vector<Sensitivity> sees;
  for (const JsonCursor& element : list.elements(fault_count)) {
    sees.push_back(kSensitivities[element.choice({"none", "transient", "steady"})]);
  }
  return sees;
}

void refuse_contradiction(const JsonCursor& sees, const ResidualFilter& filter) {
  for (const std::size_t j : filter.ignores) {
    if (filter.sees[j] != Sensitivity::kNone) {
      throw sees.elements()[j].expected("\"none\" for an ignored fault");
    }
  }
}

RankCertificate read_rank(const JsonCursor& object) {
  const std::vector<JsonCursor> at = object.members(
      {"dim_w", "dim_s", "smallest_kept", "largest_dropped", "tolerance_min", "tolerance_max"});
  return {at[0].count(0),       at[1].count(0),       at[2].not_negative(),
          at[3].not_negative(), at[4].not_negative(), at[5].not_negative()};
}

FilterCertificate read_certificate(const JsonCursor& object, const Bank& bank) {
  const std::vector<JsonCursor> at =
      object.members({"spectral_radius", "input_gain", "disturbance_gain", "fault_gain", "dc_gain",
                      "band_gain", "band_Hz", "margin", "smallest_fault", "delay_s", "rank"});
  const std::size_t fault_count = bank.fault_names.size();
  FilterCertificate certificate;
  certificate.spectral_radius = at[0].not_negative();
  certificate.input_gain = at[1].not_negatives(bank.input_names.size());
  certificate.disturbance_gain = at[2].not_negatives(bank.disturbances.size());
  certificate.fault_gain = at[3].not_negatives(fault_count);
  certificate.dc_gain = at[4].not_negatives(fault_count);
  certificate.band_gain = at[5].not_negatives(fault_count);
  certificate.band_Hz = at[6].not_negative();
  certificate.margin = at[7].not_negatives(fault_count);
  certificate.smallest_fault = at[8].not_negatives(fault_count);
  certificate.delay_s = at[9].not_negatives(fault_count);
  certificate.rank = read_rank(at[10]);
  return certificate;
}

void read_matrices(const std::vector<JsonCursor>& at, const Bank& bank, ResidualFilter& filter) {
  const std::size_t order = at[0].elements().size();
  if (order > kMaxOrder) {
    throw at[0].expected(fmt::format("at most {} rows", kMaxOrder));
  }
  const std::size_t rows = at[4].elements().size();
  if (rows == 0) {
    throw at[4].expected("at least one row");
  }
  const std::size_t m = bank.input_names.size();
  const std::size_t q = bank.output_names.size();
  filter.F = at[0].matrix(order, order);
  filter.E = at[1].matrix(order, q);
  filter.G = at[2].matrix(order, m);
  filter.M = at[3].matrix(rows, order);
  filter.H = at[4].matrix(rows, q);
  filter.K = at[5].matrix(rows, m);
  filter.L = at[6].matrix(order, bank.fault_names.size());
  filter.J = at[7].matrix(rows, bank.fault_names.size());
  const double radius = spectral_radius(filter.F);
  if (!(radius < 1.0)) {
    throw at[0].error(
        fmt::format("found spectral radius {:.6g}, expected a stable filter (below 1)", radius));
  }
}

SequentialTest read_test(const JsonCursor& object, std::size_t rows) {
  const std::vector<JsonCursor> at = object.members({"kind", "reference", "window", "offset"});
  SequentialTest test;
  test.kind = at[0].choice({"cusum", "glr"}) == 0 ? TestKind::kCusum : TestKind::kGlr;
  test.reference = at[1].not_negative();
  test.window = at[2].count(test.kind == TestKind::kGlr ? 1 : 0);
  if (test.kind == TestKind::kCusum && test.reference <= 0.0) {
    throw at[1].expected("a positive number");
  }
  if (test.window > kMaxGlrWindow) {
    throw at[2].expected(fmt::format("at most {}", kMaxGlrWindow));
  }
  test.offset = at[3].not_negatives(rows);
  return test;
}

ThresholdShares read_shares(const JsonCursor& object, std::size_t rows) {
  const std::vector<JsonCursor> at =
      object.members({"disturbance", "noise", "resolution", "leakage", "jitter", "gaussian"});
  return {at[0].not_negatives(rows), at[1].not_negatives(rows), at[2].not_negatives(rows),
          at[3].not_negatives(rows), at[4].not_negatives(rows), at[5].not_negatives(rows)};
}

Calibration read_calibration(const JsonCursor& object) {
  const std::vector<JsonCursor> at = object.members(
      {"hours", "exceedances", "level", "scale", "shape", "false_alarms_per_h", "rate_low_per_h",
       "rate_high_per_h", "held_out_hours", "held_out_expected", "held_out_found"});
  Calibration calibration;
  calibration.hours = at[0].positive();
  calibration.exceedances = at[1].count(1);
  calibration.level = at[2].not_negative();
  calibration.scale = at[3].positive();
  calibration.shape = at[4].number();
  calibration.false_alarms_per_h = at[5].positive();
  calibration.rate_low_per_h = at[6].not_negative();
  calibration.rate_high_per_h = at[7].positive();
  calibration.held_out_hours = at[8].positive();
  calibration.held_out_expected = at[9].not_negative();
  calibration.held_out_found = at[10].count(0);
  return calibration;
}

ThresholdBasis read_thresholds(const JsonCursor& object, const Bank& bank) {
  using Kind = ThresholdBasis::Kind;
  const std::vector<JsonCursor> at =
      object.members({"kind", "output_resolution", "jitter_s", "false_alarms_per_h"});
  constexpr std::array kKinds = {Kind::kGiven, Kind::kCertified, Kind::kCalibrated};
  ThresholdBasis basis;
  basis.kind = kKinds[at[0].choice({"given", "certified", "calibrated"})];
  if (!at[1].elements().empty()) {
    basis.output_resolution = at[1].vector(bank.output_names.size());
    for (const JsonCursor& resolution : at[1].elements()) {
      static_cast<void>(resolution.not_negative());
    }
  }
  basis.jitter_s = at[2].not_negative();
  basis.false_alarms_per_h = at[3].not_negative();
  return basis;
}

ResidualFilter read_filter(const JsonCursor& object, const Bank& bank) {
  const std::vector<JsonCursor> at =
      object.members({"F", "E", "G", "M", "H", "K", "L", "J", "name", "ignores", "sees",
                      "threshold", "forget_samples", "certificate"},
                     {"observer", "test", "shares", "calibration"});
  ResidualFilter filter;
  filter.name = at[8].string();
  filter.ignores = at[9].indices(bank.fault_names);
  filter.sees = read_sensitivities(at[10], bank.fault_names.size());
  refuse_contradiction(at[10], filter);
  read_matrices(at, bank, filter);
  filter.threshold = at[11].positive();
  filter.forget_samples = at[12].count(0);
  filter.certificate = read_certificate(at[13], bank);
  if (const std::optional<JsonCursor> observer = object.member("observer")) {
    read_observer(*observer, bank, filter);
  }
  const auto rows = static_cast<std::size_t>(filter.H.rows());
  if (const auto test = object.member("test")) {
    filter.test = read_test(*test, rows);
    if (filter.course) throw test->error("found it beside a course, expected one of the two");
  }
  if (const auto shares = object.member("shares")) filter.shares = read_shares(*shares, rows);
  if (const auto calibration = object.member("calibration")) {
    filter.calibration = read_calibration(*calibration);
  }
  return filter;
}

std::vector<BankDisturbance> read_disturbances(const JsonCursor& list) {
  using Treatment = BankDisturbance::Treatment;
  constexpr std::array kTreatments = {Treatment::kNone, Treatment::kDecoupled, Treatment::kConstant,
                                      Treatment::kWeakened};
  std::vector<BankDisturbance> disturbances;
  std::unordered_set<std::string> names;
  for (const JsonCursor& element : list.elements()) {
    const std::vector<JsonCursor> at = element.members({"name", "treatment"});
    if (!names.insert(at[0].string()).second) {
      throw at[0].expected("a name that was not there before");
    }
    disturbances.push_back(
        {at[0].string(), kTreatments[at[1].choice({"none", "decoupled", "constant", "weakened"})]});
  }
  return disturbances;
}

IsolabilityCertificate read_isolability(const JsonCursor& object, const Bank& bank) {
  const std::vector<JsonCursor> at =
      object.members({"signatures_distinct", "strongly_isolable", "list_complete", "confusable"});
  IsolabilityCertificate isolability;
  isolability.are_signatures_distinct = at[0].boolean();
  isolability.is_strongly_isolable = at[1].boolean();
  isolability.is_list_complete = at[2].boolean();
  for (const JsonCursor& element : at[3].elements()) {
    const std::vector<JsonCursor> set = element.members({"faults", "weights"});
    ConfusableFaults confusable;
    confusable.faults = set[0].indices(bank.fault_names);
    if (!set[1].elements().empty()) {
      const Eigen::VectorXd weights = set[1].vector(confusable.faults.size());
      confusable.weights.assign(weights.begin(), weights.end());
    }
    isolability.confusable.push_back(std::move(confusable));
  }
  return isolability;
}

void refuse_large_decision_table(const JsonCursor& concurrent, const Bank& bank,
                                 std::size_t filter_count) {
  const std::size_t words = filter_count / 64 + 1;
  if (fault_set_count(bank.fault_names.size(), bank.concurrent) > kMaxDecisionWords / words) {
    throw concurrent.error(fmt::format(
        "found {} of {} faults with {} filters, expected a decision table of at most {} "
        "words",
        bank.concurrent, bank.fault_names.size(), filter_count, kMaxDecisionWords));
  }
}

void read_filters(const JsonCursor& list, Bank& bank) {
  std::unordered_set<std::string> names;
  std::size_t course_rows = 0;
  for (const JsonCursor& element : list.elements()) {
    bank.filters.push_back(read_filter(element, bank));
    const std::string& name = bank.filters.back().name;
    if (!names.insert(name).second) {
      throw element.error(
          fmt::format("found a second filter \"{}\", expected different names", name));
    }
    if (const std::optional<ThresholdCourse>& course = bank.filters.back().course) {
      course_rows += static_cast<std::size_t>(course->norm.size());
    }
    if (course_rows > kMaxCourseRows) {
      throw element.error(
          fmt::format("found {} samples of thresholds up to here, expected courses of at most {} "
                      "in all filters together",
                      course_rows, kMaxCourseRows));
    }
  }
}

void read_channels(const std::vector<JsonCursor>& at, Bank& bank) {
  bank.input_names = at[0].names();
  bank.output_names = at[1].names();
  bank.fault_names = at[2].names();
  for (const JsonCursor& size : at[3].elements(bank.fault_names.size())) {
    bank.fault_sizes.push_back(size.positive());
  }
  const std::vector<JsonCursor> point = at[4].members({"u", "y"});
  bank.u_operating = point[0].vector(bank.input_names.size());
  bank.y_operating = point[1].vector(bank.output_names.size());
}

Bank read_tree(const JsonCursor& root) {
  const std::vector<JsonCursor> at =
      root.members({"inputs", "outputs", "faults", "fault_sizes", "operating_point", "schema",
                    "name", "method", "plant", "request_digest", "domain", "sample_time_s",
                    "concurrent", "disturbances", "decision", "isolability", "filters"},
                   {"thresholds"});
  Bank bank;
  if (at[5].count(0) != 1) {
    throw at[5].expected("1");
  }
  read_channels(at, bank);
  bank.name = at[6].string();
  bank.method = at[7].string();
  const std::vector<JsonCursor> plant = at[8].members({"name", "digest"});
  bank.plant_name = plant[0].string();
  bank.plant_digest = plant[1].string();
  bank.request_digest = at[9].string();
  constexpr std::array kDomains = {DesignDomain::kContinuous, DesignDomain::kSampled,
                                   DesignDomain::kEuler};
  bank.domain = kDomains[at[10].choice({"continuous", "sampled", "euler"})];
  bank.sample_time_s = at[11].positive();
  bank.concurrent = at[12].count(1);
  refuse_large_decision_table(at[12], bank, at[16].elements().size());
  bank.disturbances = read_disturbances(at[13]);
  const std::vector<JsonCursor> decision =
      at[14].members({"dwell", "settle", "window"}, {"clearing"});
  bank.decision.dwell = decision[0].count(1);
  bank.decision.settle = decision[1].count(1);
  bank.decision.window = decision[2].count(1);
  if (const auto clearing = at[14].member("clearing")) bank.decision.clearing = clearing->count(1);
  if (const auto thresholds = root.member("thresholds")) {
    bank.thresholds = read_thresholds(*thresholds, bank);
  }
  bank.isolability = read_isolability(at[15], bank);
  read_filters(at[16], bank);
  return bank;
}

}  // namespace

Bank parse_bank(std::string_view text, const std::string& source) {
  const JsonValue tree = parse_json(text, source);
  const JsonSource origin{text, source};
  return read_tree(JsonCursor(origin, tree, ""));
}

}  // namespace faultline
