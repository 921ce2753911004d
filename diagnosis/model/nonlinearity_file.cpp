#include "diagnosis/model/nonlinearity_file.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <string>

#include <fmt/format.h>

namespace faultline {
namespace {

// Beyond it powers of s say nothing in double precision.
constexpr std::size_t kMostCoefficients = 32;

// Bounds of the slope that a file gives in so many decimals may miss the ones of the function by
// their rounding, relative to the largest slope; the wider of both are taken.
constexpr double kSlopeRounding = 1e-12;

// What is proved about a plant is proved at all 2^l combinations of extreme slopes.
constexpr std::size_t kMostNonlinearities = 8;

std::vector<double> read_numbers(TomlTable& table, std::string_view key, std::size_t at_least) {
  const Eigen::VectorXd numbers = table.vector(key, -1);
  if (static_cast<std::size_t>(numbers.size()) < at_least) {
    throw table.error(
        key, fmt::format("found {} numbers, expected at least {}", numbers.size(), at_least));
  }
  return {numbers.begin(), numbers.end()};
}

void read_polynomial(TomlTable& table, NonlinearFunction& function) {
  function.coefficients = read_numbers(table, "coefficients", 1);
  if (function.coefficients.size() > kMostCoefficients) {
    throw table.error("coefficients",
                      fmt::format("found {} numbers, expected at most {}: a table is better for "
                                  "such a function",
                                  function.coefficients.size(), kMostCoefficients));
  }
  const Eigen::VectorXd domain = table.vector("domain", 2);
  if (domain[0] >= domain[1]) {
    throw table.error("domain", fmt::format("found [{}, {}], expected [smallest, largest]",
                                            domain[0], domain[1]));
  }
  function.domain_min = domain[0];
  function.domain_max = domain[1];
  for (const double s : domain) {
    if (!std::isfinite(evaluate(function, s))) {
      throw table.error("coefficients",
                        fmt::format("found a polynomial that is beyond all numbers at {}, an end "
                                    "of its domain, expected one that can be evaluated",
                                    s));
    }
  }
}

void read_table(TomlTable& table, NonlinearFunction& function) {
  function.at = read_numbers(table, "at", 2);
  function.value = read_numbers(table, "value", 2);
  if (function.value.size() != function.at.size()) {
    throw table.error("value", fmt::format("found {} numbers, expected {}, one per number of `at`",
                                           function.value.size(), function.at.size()));
  }
  const auto fall = std::adjacent_find(function.at.begin(), function.at.end(),
                                       [](double a, double b) { return a >= b; });
  if (fall != function.at.end()) {
    throw table.error("at", fmt::format("found {} behind {}, expected increasing numbers",
                                        *std::next(fall), *fall));
  }
  for (const std::vector<double>* numbers : {&function.at, &function.value}) {
    const auto [least, most] = std::minmax_element(numbers->begin(), numbers->end());
    if (!std::isfinite(*most - *least)) {
      throw table.error(
          numbers == &function.at ? "at" : "value",
          fmt::format("found {} and {}, expected numbers whose difference is one", *least, *most));
    }
  }
}

NonlinearFunction read_function(TomlTable& table) {
  using enum FunctionKind;
  constexpr std::array kKinds = {kSin,      kCos,        kTanh,       kAtan,
                                 kDeadZone, kSaturation, kPolynomial, kTable};
  NonlinearFunction function;
  const std::string name = table.choice(
      "function", {"sin", "cos", "tanh", "atan", "dead_zone", "saturation", "polynomial", "table"});
  function.kind = *std::find_if(kKinds.begin(), kKinds.end(),
                                [&](FunctionKind kind) { return function_name(kind) == name; });
  if (function.kind == kDeadZone || function.kind == kSaturation) {
    function.width = table.number("width");
    if (function.width <= 0.0) {
      throw table.error("width",
                        fmt::format("found {}, expected a positive number", function.width));
    }
  } else if (function.kind == kPolynomial) {
    read_polynomial(table, function);
  } else if (function.kind == kTable) {
    read_table(table, function);
  }
  return function;
}

// Bounds no narrower than those of the function itself.
SlopeBounds read_slopes(TomlTable& table, const NonlinearFunction& function) {
  const SlopeBounds own = slope_bounds(function);
  if (!std::isfinite(own.min) || !std::isfinite(own.max)) {
    throw table.error("function", fmt::format("found a \"{}\" with slopes from {} to {}, expected "
                                              "finite ones",
                                              function_name(function.kind), own.min, own.max));
  }
  const auto slope = table.optional_vector("slope", 2);
  if (!slope) return own;
  const double slack = kSlopeRounding * std::max(std::abs(own.min), std::abs(own.max));
  if ((*slope)[0] > own.min + slack || (*slope)[1] < own.max - slack) {
    throw table.error(
        "slope",
        fmt::format("found [{}, {}], expected bounds of the slopes of \"{}\", which "
                    "are {} to {}; without `slope` these are taken",
                    (*slope)[0], (*slope)[1], function_name(function.kind), own.min, own.max));
  }
  return {std::min((*slope)[0], own.min), std::max((*slope)[1], own.max)};
}

Eigen::VectorXd read_nonzero(TomlTable& table, std::string_view key, Eigen::Index n) {
  Eigen::VectorXd direction = table.vector(key, n);
  if (direction.isZero(0.0)) {
    throw table.error(key, "found zeros only, expected a nonzero direction");
  }
  return direction;
}

Nonlinearity read_nonlinearity(TomlTable& table, Eigen::Index n) {
  Nonlinearity nonlinearity;
  nonlinearity.function = read_function(table);
  nonlinearity.gain = table.optional_number("gain").value_or(1.0);
  if (nonlinearity.gain == 0.0) throw table.error("gain", "found 0, expected a nonzero factor");
  nonlinearity.E_o = read_nonzero(table, "E_o", n);
  nonlinearity.E_i = read_nonzero(table, "E_i", n);
  const SlopeBounds slopes = read_slopes(table, nonlinearity.function);
  nonlinearity.slope_min = slopes.min;
  nonlinearity.slope_max = slopes.max;
  return nonlinearity;
}

}  // namespace

std::vector<Nonlinearity> read_nonlinearities(TomlTable& root, Eigen::Index n) {
  std::vector<Nonlinearity> nonlinearities;
  for (TomlTable& table : root.tables("nonlinearity")) {
    if (nonlinearities.size() == kMostNonlinearities) {
      throw table.error("", fmt::format("found one more, expected at most {}: designs and proofs "
                                        "go through all 2^{} combinations of their slopes",
                                        kMostNonlinearities, kMostNonlinearities));
    }
    nonlinearities.push_back(read_nonlinearity(table, n));
  }
  return nonlinearities;
}

}  // namespace faultline
