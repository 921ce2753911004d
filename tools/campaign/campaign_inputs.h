#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "diagnosis/model/toml_draft.h"
#include "tools/bench/bench_inputs.h"
#include "tools/campaign/sweep.h"

namespace faultline {

/// What the runs of a sweep begin with. What they have in common is read, designed and planned
/// once. Safe for many threads once made.
class CampaignInputs {
 public:
  /// Reads the sweep's scenario and all it refers to, and tries each listed value and both ends of
  /// each range once, beside the values of the first run.
  /// @param bank instead of the scenario's, unless empty
  /// @throws InputError bad input; as load_bench_inputs.
  CampaignInputs(Sweep sweep, const std::filesystem::path& bank);

  [[nodiscard]] const Sweep& sweep() const noexcept { return sweep_; }
  /// Of the scenario as it stands.
  [[nodiscard]] const BenchInputs& base() const noexcept { return base_; }
  /// Of the sweep and all that its scenario is made of: campaigns with the same have the same runs.
  [[nodiscard]] const std::string& digest() const noexcept { return digest_; }

  /// The scenario of a point, as a file beside the sweep's scenario would have it.
  [[nodiscard]] std::string scenario_text(const SweepPoint& point) const;
  /// @throws InputError the point's values do not fit together.
  [[nodiscard]] BenchInputs inputs(const SweepPoint& point) const;

 private:
  [[nodiscard]] BenchInputs load(const std::string& text) const;
  void try_values() const;

  Sweep sweep_;
  std::string bank_edit_;  ///< the value of `bank` in TOML; empty: the scenario's own
  std::optional<TomlDraft> draft_;
  BenchInputs base_;
  std::set<std::string, std::less<>> changed_;
  bool is_base_shared_ = false;  ///< plant, DBC, bank and signals are the same in all runs
  std::string digest_;
};

}  // namespace faultline
