#include "tools/calibrate/calibration.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <span>
#include <stdexcept>

#include <fmt/format.h>

#include "diagnosis/certify/certify.h"
#include "diagnosis/certify/forgetting.h"
#include "diagnosis/runtime/residual_bank.h"
#include "tools/calibrate/tail_fit.h"

namespace faultline {
namespace {

constexpr double kSecondsPerHour = 3600.0;
constexpr double kNotANumber = std::numeric_limits<double>::quiet_NaN();
// All residuals together: a record whose parts differ by more does not stand for the future.
constexpr double kUnlikely = 1e-3;
// A level shift: blocks of so many independent samples, and means so many deviations of all blocks'
// means away, two in succession.
constexpr std::size_t kBlock = 20;
constexpr std::size_t kFewestBlocks = 20;
constexpr double kShifted = 8.0;

// What a bank makes of the record, sample by sample; NaN where it says nothing.
struct Evaluations {
  std::vector<std::vector<double>> held;      // per filter: smallest of `dwell` evaluations
  std::vector<std::vector<double>> residual;  // per filter: its largest row, signed
};

Evaluations evaluate(const PlantModel& plant, const Bank& bank,
                     const std::vector<RecordedStretch>& stretches) {
  const std::size_t count = bank.filters.size();
  Evaluations result{std::vector<std::vector<double>>(count),
                     std::vector<std::vector<double>>(count)};
  ResidualBank filters(bank);
  for (const RecordedStretch& stretch : stretches) {
    filters.reset();
    std::vector<std::size_t> begin(count);  // of the stretch, per filter
    for (std::size_t f = 0; f < count; ++f) begin[f] = result.held[f].size();
    std::vector<std::vector<double>> evaluation(count);
    const auto samples = static_cast<std::size_t>(stretch.y.cols());
    for (std::size_t k = 0; k < samples; ++k) {
      const Eigen::VectorXd y = stretch.y.col(static_cast<Eigen::Index>(k)) + plant.y_operating;
      const Eigen::VectorXd u = stretch.u.col(static_cast<Eigen::Index>(k)) + plant.u_operating;
      filters.step({y.data(), static_cast<std::size_t>(y.size())},
                   {u.data(), static_cast<std::size_t>(u.size())});
      std::vector<std::uint8_t> contaminated(count);
      std::size_t row = 0;
      for (std::size_t f = 0; f < count; ++f) {
        contaminated[f] = k < bank.filters[f].forget_samples ? 1 : 0;
        evaluation[f].push_back(contaminated[f] != 0 ? kNotANumber : filters.evaluation()[f]);
        result.residual[f].push_back(contaminated[f] != 0 ? kNotANumber : filters.residual()[row]);
        row += static_cast<std::size_t>(bank.filters[f].H.rows());
      }
      filters.restart_tests(contaminated);
    }
    const std::size_t dwell = std::max<std::size_t>(bank.decision.dwell, 1);
    for (std::size_t f = 0; f < count; ++f) {
      for (std::size_t k = 0; k < samples; ++k) {
        double smallest = k + 1 >= dwell ? evaluation[f][k] : kNotANumber;
        for (std::size_t j = 1; j < dwell && k >= j; ++j) {
          // A NaN stays one.
          const double before = evaluation[f][k - j];
          smallest = std::isnan(before) || before < smallest ? before : smallest;
        }
        result.held[f].push_back(smallest);
      }
      // A stretch ends a cluster.
      result.held[f].push_back(kNotANumber);
      result.residual[f].push_back(kNotANumber);
    }
  }
  return result;
}

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

class FilterCalibration {
 public:
  FilterCalibration(const Bank& bank, const ResidualFilter& filter,
                    const CalibrationOptions& options, std::span<const double> held,
                    std::span<const double> residual)
      : bank_(bank), filter_(filter), options_(options), held_(held), residual_(residual) {}

  struct Result {
    Calibration calibration;
    double threshold = 0.0;
    double probability = 1.0;  // of what was held out
  };

  [[nodiscard]] Result run() const {
    refuse_still();
    const std::size_t gap = decorrelation(held_) + bank_.decision.dwell;
    refuse_shifted(gap);
    const auto fitted_end =
        static_cast<std::size_t>((1.0 - options_.held_out) * static_cast<double>(held_.size()));
    const std::span<const double> fitted = held_.first(fitted_end);
    const std::span<const double> rest = held_.subspan(fitted_end);
    const std::optional<TailFit> fit = fit_tail(fitted, gap);
    const double share_per_h =
        options_.false_alarms_per_h / static_cast<double>(bank_.filters.size());
    refuse_short(fit, fitted, gap, share_per_h);
    Result result;
    const double per_sample = share_per_h * bank_.sample_time_s / kSecondsPerHour;
    result.threshold = fit->threshold(per_sample);
    const RateInterval interval = rate_interval(fitted, gap, result.threshold);
    const double per_h = kSecondsPerHour / bank_.sample_time_s;
    Calibration& found = result.calibration;
    found.hours = fit->samples / per_h;
    found.exceedances = static_cast<std::uint32_t>(fit->clusters);
    found.level = fit->level;
    found.scale = fit->scale;
    found.shape = fit->shape;
    found.false_alarms_per_h = fit->rate(result.threshold) * per_h;
    found.rate_low_per_h = interval.low * per_h;
    found.rate_high_per_h = interval.high * per_h;
    const auto rest_samples = static_cast<double>(
        std::count_if(rest.begin(), rest.end(), [](double x) { return !std::isnan(x); }));
    if (rest_samples == 0.0) {
      refuse(
          "the record's end, which is held out, has no sample that says anything; expected longer "
          "stretches without bad samples");
    }
    found.held_out_hours = rest_samples / per_h;
    found.held_out_expected = static_cast<double>(fit->clusters) / fit->samples * rest_samples;
    found.held_out_found = static_cast<std::uint32_t>(cluster_peaks(rest, fit->level, gap).size());
    result.probability =
        same_rate_probability(found.held_out_found, rest_samples, fit->clusters, fit->samples);
    return result;
  }

 private:
  [[noreturn]] void refuse(const std::string& text) const {
    throw std::invalid_argument(fmt::format("{}: {}", filter_.name, text));
  }

  void refuse_still() const {
    double first = kNotANumber;
    for (const double value : residual_) {
      if (std::isnan(value)) continue;
      if (std::isinf(value)) refuse("found a residual that is not finite in the record");
      if (std::isnan(first)) first = value;
      if (value != first) return;
    }
    refuse(
        std::isnan(first)
            ? fmt::format("no sample of the record says anything of it: it forgets a start for {} "
                          "samples; expected longer stretches without bad samples",
                          filter_.forget_samples)
            : fmt::format("found a residual that is {:g} in every sample; expected a record with "
                          "the noise of the real thing",
                          first));
  }

  // A stretch of the record in which it stands elsewhere.
  void refuse_shifted(std::size_t gap) const {
    const std::size_t length = kBlock * gap;
    std::vector<double> means;
    std::vector<std::size_t> places;
    double sum = 0.0;
    std::size_t count = 0;
    for (std::size_t k = 0; k < residual_.size(); ++k) {
      if (std::isnan(residual_[k])) continue;
      sum += residual_[k];
      if (++count == length) {
        means.push_back(sum / static_cast<double>(length));
        places.push_back(k + 1 - length);
        sum = 0.0;
        count = 0;
      }
    }
    if (means.size() < kFewestBlocks) return;
    const double middle = median(means);
    std::vector<double> away;
    for (const double mean : means) away.push_back(std::abs(mean - middle));
    const double deviation = 1.4826 * median(away);
    for (std::size_t i = 1; i < means.size(); ++i) {
      const double shift = means[i] - middle;
      if (std::abs(shift) <= kShifted * deviation ||
          std::abs(means[i - 1] - middle) <= kShifted * deviation ||
          std::signbit(shift) != std::signbit(means[i - 1] - middle)) {
        continue;
      }
      std::size_t last = i;
      while (last + 1 < means.size() && std::abs(means[last + 1] - middle) > kShifted * deviation) {
        ++last;
      }
      refuse(fmt::format(
          "found it at {:.4g} from {:.2f} s to {:.2f} s of the record, but at {:.4g} ± {:.2g} "
          "otherwise (means of {} samples); expected a record without any fault",
          means[i], bank_.sample_time_s * static_cast<double>(places[i - 1]),
          bank_.sample_time_s * static_cast<double>(places[last] + length), middle, deviation,
          length));
    }
  }

  void refuse_short(const std::optional<TailFit>& fit, std::span<const double> fitted,
                    std::size_t gap, double share_per_h) const {
    const auto samples = static_cast<double>(
        std::count_if(fitted.begin(), fitted.end(), [](double x) { return !std::isnan(x); }));
    const double hours = samples * bank_.sample_time_s / kSecondsPerHour;
    if (!fit) {
      const double needed =
          40.0 * kFewestClusters * static_cast<double>(gap) * bank_.sample_time_s / kSecondsPerHour;
      refuse(
          fmt::format("{:.3g} h are fitted, whose samples depend on each other for {} samples: too "
                      "few peaks; expected at least {:.3g} h of record (with what is held out)",
                      hours, gap, needed / (1.0 - options_.held_out)));
    }
    if (share_per_h * hours * kFurthest < 1.0) {
      const double needed = 1.0 / (share_per_h * kFurthest) / (1.0 - options_.held_out);
      const double carried = static_cast<double>(bank_.filters.size()) / (hours * kFurthest);
      refuse(
          fmt::format("{:.3g} h are fitted: they carry {:.2g} false alarms an hour for the whole "
                      "bank, found {:.2g} "
                      "asked for; expected at least {:.3g} h of record, or a larger rate",
                      hours, carried, options_.false_alarms_per_h, needed));
    }
    const double most = static_cast<double>(fit->clusters) / fit->samples;
    if (share_per_h * bank_.sample_time_s / kSecondsPerHour > most) {
      refuse(
          fmt::format("found a rate of {:.3g} an hour asked for the whole bank, expected at most "
                      "{:.3g}: more often "
                      "than the tail of the record there is no threshold worth the name",
                      options_.false_alarms_per_h,
                      most * kSecondsPerHour / bank_.sample_time_s *
                          static_cast<double>(bank_.filters.size())));
    }
  }

  const Bank& bank_;
  const ResidualFilter& filter_;
  const CalibrationOptions& options_;
  std::span<const double> held_, residual_;
};

void refuse_proved(const Bank& bank) {
  const bool is_proved = bank.thresholds.kind == ThresholdBasis::Kind::kCertified ||
                         std::any_of(bank.filters.begin(), bank.filters.end(),
                                     [](const ResidualFilter& filter) { return filter.course; });
  if (is_proved) {
    throw std::invalid_argument(
        fmt::format("bank \"{}\" has thresholds that are proved from bounds and need no record; "
                    "expected one with "
                    "threshold = \"calibrated\", or a number, in [decision]",
                    bank.name));
  }
  if (bank.filters.empty()) throw std::invalid_argument("the bank has no residual");
}

}  // namespace

void calibrate(const PlantModel& plant, const std::vector<RecordedStretch>& stretches,
               const CalibrationOptions& options, Bank& bank) {
  refuse_proved(bank);
  const Evaluations evaluations = evaluate(plant, bank, stretches);
  std::vector<FilterCalibration::Result> results;
  for (std::size_t f = 0; f < bank.filters.size(); ++f) {
    results.push_back(FilterCalibration(bank, bank.filters[f], options, evaluations.held[f],
                                        evaluations.residual[f])
                          .run());
  }
  for (std::size_t f = 0; f < bank.filters.size(); ++f) {
    const Calibration& found = results[f].calibration;
    if (results[f].probability * static_cast<double>(bank.filters.size()) < kUnlikely) {
      throw std::invalid_argument(fmt::format(
          "{}: found {} peaks above {:.4g} in the part of the record that was held out ({:.3g} h), "
          "expected {:.1f} as in the part before: the record changes in time; expected a longer "
          "one, "
          "or one in which nothing changes but the noise",
          bank.filters[f].name, found.held_out_found, found.level, found.held_out_hours,
          found.held_out_expected));
    }
  }
  bank.thresholds.kind = ThresholdBasis::Kind::kCalibrated;
  bank.thresholds.false_alarms_per_h = options.false_alarms_per_h;
  for (std::size_t f = 0; f < bank.filters.size(); ++f) {
    ResidualFilter& filter = bank.filters[f];
    filter.threshold = results[f].threshold;
    filter.calibration = results[f].calibration;
    filter.forget_samples = samples_to_forget(plant, filter);
  }
  certify(plant, bank);
}

}  // namespace faultline
