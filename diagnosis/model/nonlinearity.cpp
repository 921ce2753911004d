#include "diagnosis/model/nonlinearity.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace faultline {
namespace {

// Horner's rule.
double polynomial(const std::vector<double>& coefficients, double s) noexcept {
  double sum = 0.0;
  for (auto c = coefficients.rbegin(); c != coefficients.rend(); ++c) sum = sum * s + *c;
  return sum;
}

double polynomial_slope(const std::vector<double>& coefficients, double s) noexcept {
  double sum = 0.0;
  for (std::size_t i = coefficients.size(); i-- > 1;) {
    sum = sum * s + static_cast<double>(i) * coefficients[i];
  }
  return sum;
}

double continued_polynomial(const NonlinearFunction& function, double s) noexcept {
  const double inside = std::clamp(s, function.domain_min, function.domain_max);
  const double value = polynomial(function.coefficients, inside);
  if (s == inside) return value;
  const double slope = polynomial_slope(function.coefficients, inside);
  // A level tangent is level at infinity, too: 0·∞ would say otherwise.
  return slope == 0.0 && !std::isnan(s) ? value : value + slope * (s - inside);
}

double table_value(const NonlinearFunction& function, double s) noexcept {
  const std::vector<double>& at = function.at;
  const std::vector<double>& value = function.value;
  if (!(s > at.front())) return std::isnan(s) ? s : value.front();
  if (s >= at.back()) return value.back();
  const auto i = static_cast<std::size_t>(std::upper_bound(at.begin(), at.end(), s) - at.begin());
  const double part = (s - at[i - 1]) / (at[i] - at[i - 1]);
  return value[i - 1] + part * (value[i] - value[i - 1]);
}

// Real roots of p in (low, high), increasing: between two neighbouring extrema (roots of p') and
// the ends there is at most one, which bisection finds to the last bit.
std::vector<double> roots_between(const std::vector<double>& p, double low, double high) {
  if (p.size() < 2) return {};
  std::vector<double> derivative;
  for (std::size_t i = 1; i < p.size(); ++i) derivative.push_back(static_cast<double>(i) * p[i]);
  std::vector<double> ends{low};
  for (const double s : roots_between(derivative, low, high)) ends.push_back(s);
  ends.push_back(high);
  std::vector<double> roots;
  for (std::size_t i = 0; i + 1 < ends.size(); ++i) {
    double a = ends[i], b = ends[i + 1];
    if (polynomial(p, a) * polynomial(p, b) > 0.0) continue;
    const bool is_rising = polynomial(p, b) > polynomial(p, a);
    for (double s = 0.5 * (a + b); s > a && s < b; s = 0.5 * (a + b)) {
      (polynomial(p, s) > 0.0 ? (is_rising ? b : a) : (is_rising ? a : b)) = s;
    }
    roots.push_back(a);
  }
  return roots;
}

// The slope is extreme at the ends of the domain or where the second derivative is zero.
SlopeBounds polynomial_bounds(const NonlinearFunction& function) {
  std::vector<double> curvature;
  for (std::size_t i = 2; i < function.coefficients.size(); ++i) {
    curvature.push_back(static_cast<double>(i * (i - 1)) * function.coefficients[i]);
  }
  std::vector<double> candidates =
      roots_between(curvature, function.domain_min, function.domain_max);
  candidates.push_back(function.domain_min);
  candidates.push_back(function.domain_max);
  SlopeBounds bounds{polynomial_slope(function.coefficients, candidates.front()),
                     polynomial_slope(function.coefficients, candidates.front())};
  for (const double s : candidates) {
    const double slope = polynomial_slope(function.coefficients, s);
    bounds.min = std::min(bounds.min, slope);
    bounds.max = std::max(bounds.max, slope);
  }
  return bounds;
}

SlopeBounds table_bounds(const NonlinearFunction& function) {
  SlopeBounds bounds;  // beyond the ends: 0
  for (std::size_t i = 1; i < function.at.size(); ++i) {
    const double slope =
        (function.value[i] - function.value[i - 1]) / (function.at[i] - function.at[i - 1]);
    bounds.min = std::min(bounds.min, slope);
    bounds.max = std::max(bounds.max, slope);
  }
  return bounds;
}

}  // namespace

double evaluate(const NonlinearFunction& function, double s) noexcept {
  switch (function.kind) {
    case FunctionKind::kSin:
      return std::sin(s);
    case FunctionKind::kCos:
      return std::cos(s);
    case FunctionKind::kTanh:
      return std::tanh(s);
    case FunctionKind::kAtan:
      return std::atan(s);
    case FunctionKind::kDeadZone:
      return s - std::clamp(s, -function.width, function.width);
    case FunctionKind::kSaturation:
      return std::clamp(s, -function.width, function.width);
    case FunctionKind::kPolynomial:
      return continued_polynomial(function, s);
    case FunctionKind::kTable:
      return table_value(function, s);
  }
  return 0.0;
}

SlopeBounds slope_bounds(const NonlinearFunction& function) {
  switch (function.kind) {
    case FunctionKind::kSin:
    case FunctionKind::kCos:
      return {-1.0, 1.0};
    case FunctionKind::kTanh:
    case FunctionKind::kAtan:
    case FunctionKind::kDeadZone:
    case FunctionKind::kSaturation:
      return {0.0, 1.0};
    case FunctionKind::kPolynomial:
      return polynomial_bounds(function);
    case FunctionKind::kTable:
      return table_bounds(function);
  }
  return {};
}

std::string function_name(FunctionKind kind) {
  switch (kind) {
    case FunctionKind::kSin:
      return "sin";
    case FunctionKind::kCos:
      return "cos";
    case FunctionKind::kTanh:
      return "tanh";
    case FunctionKind::kAtan:
      return "atan";
    case FunctionKind::kDeadZone:
      return "dead_zone";
    case FunctionKind::kSaturation:
      return "saturation";
    case FunctionKind::kPolynomial:
      return "polynomial";
    case FunctionKind::kTable:
      return "table";
  }
  return "";
}

}  // namespace faultline
