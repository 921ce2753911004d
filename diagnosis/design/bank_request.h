#pragma once

#include <complex>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "diagnosis/bank/bank.h"
#include "diagnosis/model/input_error.h"

namespace faultline {

/// What bank.toml asks for.
struct BankRequest {
  std::string name;
  std::filesystem::path plant;  ///< resolved against the file's folder
  std::string method = "geometric";
  std::size_t concurrent = 1;  ///< p
  /// Of F: s plane in the continuous domain, z plane in the sampled one. A complex one has its
  /// conjugate directly behind it ("[-3, 4], [-3, -4]" in the file). A residual of order d takes
  /// the first d; a single one repeats where that is possible.
  std::vector<std::complex<double>> poles;
  DesignDomain domain = DesignDomain::kContinuous;
  double sample_time_s = 0.0;
  std::vector<std::string> decouple;  ///< names of disturbances that no residual may see
  bool normalise = true;
  double threshold = 0.0;  ///< τ, in fault sizes when normalised
  DecisionRule decision;
  std::string text;    ///< the file, whole
  std::string source;  ///< its name
};

/// Reads bank.toml (docs/design.md, "Files"). Strict. @throws InputError, std::system_error.
[[nodiscard]] BankRequest read_bank_request(const std::filesystem::path& file);
[[nodiscard]] BankRequest parse_bank_request(std::string_view text, const std::string& source);

/// What is wrong with `key` of the request, at its place in the request's text if that is known.
[[nodiscard]] InputError request_error(const BankRequest& request, std::string_view key,
                                       const std::string& text);

}  // namespace faultline
