#pragma once

namespace faultline {

/// The decimal number a DBC text gave for a double: the shortest one that reads back as that double
/// (15 digits or fewer always survive the way through a double). It is value + rest, to 1e-31 of
/// it.
struct ExactDecimal {
  double value = 0.0;
  double rest = 0.0;
};

/// @pre `value` is finite. Outside 1e-200 .. 1e200 the rest is taken as zero.
[[nodiscard]] ExactDecimal exact_decimal(double value);

/// The whole number r with r·factor + offset = 0 in decimals, if there is one below 2^53 in size.
/// @return false if there is none.
[[nodiscard]] bool find_decimal_root(double factor, double offset, double& root);

}  // namespace faultline
