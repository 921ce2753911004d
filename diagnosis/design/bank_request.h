#pragma once

#include <complex>
#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "diagnosis/bank/bank.h"
#include "diagnosis/design/eigenstructure/eigenstructure_request.h"
#include "diagnosis/design/uio/uio_request.h"
#include "diagnosis/model/input_error.h"

namespace faultline {

/// Which residuals a bank has.
enum class StructureChoice {
  kAll,        ///< one per set of p faults, which it ignores (p = 1: the generalised scheme)
  kDedicated,  ///< one per fault, the only one that it sees
  kSmallest,   ///< as few as still isolate; some may ignore more than p faults
  kGiven,      ///< one per set of `ignored_sets`
};

/// What bank.toml asks for.
struct BankRequest {
  std::string name;
  std::filesystem::path plant;  ///< resolved against the file's folder
  std::string method = "geometric";
  std::size_t concurrent = 1;  ///< p
  /// Of F: s plane in the continuous domain, z plane in the sampled one. A complex one has its
  /// conjugate directly behind it ("[-3, 4], [-3, -4]" in the file). A residual of order d takes
  /// the first d; a single one repeats where that is possible. Empty: `decay_rate_per_s` instead.
  std::vector<std::complex<double>> poles;
  /// All poles decay at least this fast: Re λ <= -rate, |z| <= exp(-rate·sample_time_s).
  std::optional<double> decay_rate_per_s;
  DesignDomain domain = DesignDomain::kContinuous;
  double sample_time_s = 0.0;
  std::vector<std::string> decouple;  ///< names of disturbances that no residual may see
  /// Names of disturbances that no residual may see while they are constant (a bias, a load).
  std::vector<std::string> decouple_constant;
  StructureChoice structure = StructureChoice::kAll;
  std::vector<std::vector<std::string>> ignored_sets;  ///< names of faults, for kGiven
  bool normalise = true;
  double threshold = 0.0;  ///< τ, in fault sizes when normalised; uio: from the plant's bounds
  /// ThresholdBasis; its resolution is per output, by name.
  ThresholdBasis::Kind threshold_kind = ThresholdBasis::Kind::kGiven;
  std::map<std::string, double> resolution;
  double jitter_s = 0.0;
  double false_alarms_per_h = 0.0;
  TestKind test = TestKind::kComparison;
  /// Size of fault, in fault sizes, that a sequential test is tuned to; absent: half a standard
  /// deviation of its white residual.
  std::optional<double> tuned_for;
  /// Samples of a GLR test; absent: as many as a fault of that size takes.
  std::optional<std::uint32_t> glr_window;
  UioRequest uio;                        ///< method "uio" only
  EigenstructureRequest eigenstructure;  ///< method "eigenstructure" only
  DecisionRule decision;
  /// DecisionRule::window; absent: five time constants of the slowest filter.
  std::optional<std::uint32_t> window;
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
