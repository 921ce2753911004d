#include "tools/threshold_print.h"

#include <algorithm>
#include <string>

#include <fmt/format.h>

namespace faultline {
namespace {

// Of a residual of several rows: "r12[2]".
std::string row_name(const ResidualFilter& filter, std::size_t row) {
  return filter.H.rows() == 1 ? filter.name : fmt::format("{}[{}]", filter.name, row + 1);
}

std::string rate_text(double per_h) {
  if (per_h >= 1.0) return fmt::format("{:.3g} an hour", per_h);
  if (per_h * 24.0 * 30.0 >= 1.0) return fmt::format("one in {:.3g} hours", 1.0 / per_h);
  return fmt::format("one in {:.3g} days", 1.0 / (24.0 * per_h));
}

void print_certified(std::FILE* out, const Bank& bank) {
  fmt::print(out, "\n  certified thresholds: what a row can be without a fault, in its unit\n");
  fmt::print(out, "  {:<10} {:>9} = {:>11} {:>9} {:>9} {:>9} {:>9} {:>9}\n", "row", "in the end",
             "disturbance", "noise", "rounding", "leakage", "jitter", "Gaussian");
  for (const ResidualFilter& filter : bank.filters) {
    if (!filter.shares || filter.test || !filter.course) continue;
    const ThresholdShares& shares = *filter.shares;
    const auto last = filter.course->component.bottomRows(1);
    for (std::size_t i = 0; i < shares.noise.size(); ++i) {
      fmt::print(out,
                 "  {:<10} {:>10.4g} = {:>11.3g} {:>9.3g} {:>9.3g} {:>9.3g} {:>9.3g} {:>9.3g}\n",
                 row_name(filter, i), last(0, static_cast<Eigen::Index>(i)), shares.disturbance[i],
                 shares.noise[i], shares.resolution[i], shares.leakage[i], shares.jitter[i],
                 shares.gaussian[i]);
    }
  }
  fmt::print(
      out, "\n  never crossed {}, from the first sample on for every start in the states' range\n",
      bank.thresholds.false_alarms_per_h > 0.0
          ? fmt::format("by what is bounded; by Gaussian noise at most {} (all residuals "
                        "together, {} samples in a row)",
                        rate_text(bank.thresholds.false_alarms_per_h), bank.decision.dwell)
          : "while every source keeps to its bound");
}

void print_tests(std::FILE* out, const Bank& bank) {
  fmt::print(out, "\n  {:<10} {:>6} {:>12} {:>9} {:>9} {:>14}\n", "test", "kind", "reference",
             "window", "h", "bounded adds");
  for (const ResidualFilter& filter : bank.filters) {
    if (!filter.test) continue;
    const SequentialTest& test = *filter.test;
    fmt::print(out, "  {:<10} {:>6} {:>12.3g} {:>9} {:>9.4g} {:>14.2g}\n", filter.name,
               test.kind == TestKind::kCusum ? "cusum" : "glr", test.reference,
               test.kind == TestKind::kGlr ? fmt::to_string(test.window) : "-", filter.threshold,
               *std::max_element(test.offset.begin(), test.offset.end()));
  }
  fmt::print(out, "\n  on white residuals, in standard deviations of their noise");
  if (bank.thresholds.kind == ThresholdBasis::Kind::kCertified) {
    fmt::print(out, "; false alarms by noise: {}, all residuals together",
               rate_text(bank.thresholds.false_alarms_per_h));
  }
  fmt::print(out, "\n");
}

void print_calibrated(std::FILE* out, const Bank& bank) {
  const bool is_calibrated =
      std::any_of(bank.filters.begin(), bank.filters.end(),
                  [](const ResidualFilter& f) { return f.calibration.has_value(); });
  if (!is_calibrated) {
    fmt::print(
        out,
        "\n  thresholds NOT CALIBRATED: they are provisional. Record fault-free runs with this "
        "bank, then\n  faultline calibrate LOG.. --far 1e-3/h -o BANK\n");
    return;
  }
  fmt::print(out, "\n  calibrated thresholds\n  {:<10} {:>9} {:>12} {:>23} {:>8} {:>8} {:>16}\n",
             "residual", "threshold", "alarms/h", "95 % interval", "hours", "peaks",
             "held out: found");
  for (const ResidualFilter& filter : bank.filters) {
    if (!filter.calibration) continue;
    const Calibration& c = *filter.calibration;
    fmt::print(
        out, "  {:<10} {:>9.4g} {:>12.3g} {:>10.2g} .. {:<9.2g} {:>8.3g} {:>8} {:>6} of {:<6.1f}\n",
        filter.name, filter.threshold, c.false_alarms_per_h, c.rate_low_per_h, c.rate_high_per_h,
        c.hours, c.exceedances, c.held_out_found, c.held_out_expected);
  }
}

}  // namespace

void print_thresholds(std::FILE* out, const Bank& bank) {
  using Kind = ThresholdBasis::Kind;
  const auto has = [&bank](auto&& is) {
    return std::any_of(bank.filters.begin(), bank.filters.end(), is);
  };
  if (has([](const ResidualFilter& f) { return f.test.has_value(); })) print_tests(out, bank);
  if (has([](const ResidualFilter& f) { return f.shares && !f.test; })) print_certified(out, bank);
  if (bank.thresholds.kind == Kind::kCalibrated) print_calibrated(out, bank);
}

}  // namespace faultline
