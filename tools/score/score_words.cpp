#include "tools/score/score_words.h"

#include <cmath>

#include <fmt/format.h>

namespace faultline {
namespace {

/// A bound: infinite ones are open ends.
std::string bound(double value, double factor, const char* open) {
  return std::isfinite(value) ? fmt::format("{:.3g}", factor * value) : open;
}

}  // namespace

std::string percent_text(const std::optional<Estimate>& share) {
  if (!share) return "-";
  return fmt::format("{:.1f} % ({:.1f} .. {:.1f})", 100.0 * share->value, 100.0 * share->low,
                     100.0 * share->high);
}

std::string delay_text(const std::optional<Estimate>& delay_s) {
  if (!delay_s) return "-";
  if (!std::isfinite(delay_s->value)) return "never";
  const bool is_long = delay_s->value >= 1.0;
  const double factor = is_long ? 1.0 : 1e3;
  return fmt::format("{:.3g} {} ({} .. {})", factor * delay_s->value, is_long ? "s" : "ms",
                     bound(delay_s->low, factor, "-"), bound(delay_s->high, factor, "never"));
}

std::string rate_text(const std::optional<Estimate>& rate) {
  if (!rate) return "-";
  return fmt::format("{:.3g} per h ({:.3g} .. {:.3g})", rate->value, rate->low, rate->high);
}

std::string size_text(const DetectableSize& size) {
  switch (size.kind) {
    case DetectableSize::Kind::kEstimated:
      return fmt::format("{:.3g} ({} .. {})", size.size.value, bound(size.size.low, 1.0, "-"),
                         bound(size.size.high, 1.0, "-"));
    case DetectableSize::Kind::kBelowAll:
      return fmt::format("at most {:.3g}, the smallest tried", size.size.value);
    case DetectableSize::Kind::kAboveAll:
      return fmt::format("above {:.3g}, the largest tried", size.size.value);
    case DetectableSize::Kind::kUndecided:
      return "the runs do not say";
  }
  return "";
}

std::string predicted_text(const std::optional<double>& size) {
  return size ? fmt::format("{:.3g}", *size) : "-";
}

}  // namespace faultline
