#pragma once

#include <cstdio>
#include <filesystem>
#include <string>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "diagnosis/bank/bank.h"

namespace faultline {

/// What the rounding of the bus makes of one residual: half an LSB off in every sample of every
/// signal, in the worst order.
struct QuantisationError {
  std::string residual;
  double threshold = 0.0;
  double total = 0.0;  ///< largest error of its evaluation
  /// Share of each signal alone, outputs then inputs. An input counts as if the plant acted on the
  /// value before it was rounded.
  std::vector<double> per_signal;
};

/// The part of the threshold that rounding may use up before it is worth a warning.
inline constexpr double kMuchQuantisation = 0.2;

/// Per filter of `bank`, with the signals that bear the channels' names in the DBC.
/// @throws DbcError, SignalMapError, std::system_error; std::invalid_argument a filter that does
///   not forget.
[[nodiscard]] std::vector<QuantisationError> quantisation_errors(const Bank& bank,
                                                                 const std::filesystem::path& dbc);

void print_quantisation(std::FILE* out, const Bank& bank,
                        const std::vector<QuantisationError>& errors);
[[nodiscard]] nlohmann::ordered_json quantisation_json(
    const Bank& bank, const std::vector<QuantisationError>& errors);

}  // namespace faultline
