#include "drivers/dbc/exact_decimal.h"

#include <array>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <string_view>

namespace faultline {
namespace {

constexpr double kSmallest = 1e-200;
constexpr double kLargest = 1e200;

/// ±digits·10^exponent, with at most 17 digits.
struct Decimal {
  std::int64_t digits = 0;
  int exponent = 0;
};

Decimal shortest_decimal(double value) {
  std::array<char, 32> text{};  // "-1.2345678901234567e-308" has 24
  const auto written =
      std::to_chars(text.data(), text.data() + text.size(), value, std::chars_format::scientific);
  Decimal decimal;
  const char* at = text.data();
  const bool is_negative = *at == '-';
  if (is_negative) ++at;
  bool is_fraction = false;
  for (; *at != 'e'; ++at) {
    if (*at == '.') {
      is_fraction = true;
      continue;
    }
    decimal.digits = 10 * decimal.digits + (*at - '0');
    if (is_fraction) --decimal.exponent;
  }
  if (is_negative) decimal.digits = -decimal.digits;
  ++at;
  if (*at == '+') ++at;  // from_chars knows no plus sign
  int exponent = 0;
  std::from_chars(at, written.ptr, exponent);
  decimal.exponent += exponent;
  return decimal;
}

/// The sum high + low of two doubles, |low| <= ulp(high)/2 (T. J. Dekker, "A floating-point
/// technique for extending the available precision", Numer. Math. 18, 1971).
struct Double2 {
  double high = 0.0;
  double low = 0.0;
};

Double2 sum_of(double a, double b) noexcept {
  const double sum = a + b;
  const double b_part = sum - a;
  return {sum, (a - (sum - b_part)) + (b - b_part)};
}

Double2 product_of(Double2 a, Double2 b) noexcept {
  const double high = a.high * b.high;
  const double low = std::fma(a.high, b.high, -high) + (a.high * b.low + a.low * b.high);
  return sum_of(high, low);
}

Double2 quotient_of(Double2 a, Double2 b) noexcept {
  const double high = a.high / b.high;
  const Double2 part = product_of({high, 0.0}, b);
  const double rest = ((a.high - part.high) - part.low) + a.low;
  const double middle = rest / b.high;
  const Double2 two = sum_of(high, middle);
  // A second correction: one division leaves some units of 2^-104.
  const Double2 whole = product_of(two, b);
  const double left = ((a.high - whole.high) - whole.low) + a.low;
  const Double2 last = sum_of(two.high, two.low + left / b.high);
  return last;
}

/// 10^exponent, exponent >= 0.
Double2 power_of_ten(int exponent) noexcept {
  constexpr double kLargestExact = 1e22;
  Double2 power{1.0, 0.0};
  for (; exponent >= 22; exponent -= 22) power = product_of(power, {kLargestExact, 0.0});
  double rest = 1.0;
  for (; exponent > 0; --exponent) rest *= 10.0;
  return product_of(power, {rest, 0.0});
}

/// `digits` as a sum of two doubles: more than 53 bits do not fit one.
Double2 to_double2(std::int64_t digits) noexcept {
  const auto high = static_cast<double>(digits);
  return {high, static_cast<double>(digits - static_cast<std::int64_t>(high))};
}

}  // namespace

ExactDecimal exact_decimal(double value) {
  const double size = std::abs(value);
  if (!(size > kSmallest) || !(size < kLargest)) return {value, 0.0};
  const Decimal decimal = shortest_decimal(value);
  const Double2 digits = to_double2(decimal.digits);
  const Double2 power = power_of_ten(std::abs(decimal.exponent));
  const Double2 exact =
      decimal.exponent >= 0 ? product_of(digits, power) : quotient_of(digits, power);
  return {value, (exact.high - value) + exact.low};
}

bool find_decimal_root(double factor, double offset, double& root) {
  root = std::nearbyint(-offset / factor);
  if (!(std::abs(root) < 0x1p53)) return false;
  const Decimal f = shortest_decimal(factor);
  const Decimal o = shortest_decimal(offset);
  __extension__ using Wide = __int128;
  // 17 digits times 16 fit 38 digits; more powers of ten only if they do not overflow.
  Wide left = static_cast<Wide>(f.digits) * static_cast<std::int64_t>(root);
  Wide right = -static_cast<Wide>(o.digits);
  if (left == 0 || right == 0) return left == right;
  for (int n = f.exponent; n < o.exponent; ++n) {
    if (__builtin_mul_overflow(right, static_cast<Wide>(10), &right)) return false;
  }
  for (int n = o.exponent; n < f.exponent; ++n) {
    if (__builtin_mul_overflow(left, static_cast<Wide>(10), &left)) return false;
  }
  return left == right;
}

}  // namespace faultline
