#include "tools/campaign/campaign_inputs.h"

#include <algorithm>
#include <array>
#include <stdexcept>
#include <string_view>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "diagnosis/model/digest.h"
#include "diagnosis/model/input_error.h"

namespace faultline {
namespace {

/// What a run cannot be made from without reading files anew.
constexpr std::array<std::string_view, 5> kFileKeys{"plant", "bank", "dbc", "signals", "rates"};

std::string quoted(const std::string& text) { return nlohmann::json(text).dump(); }

/// Values to try: of a list all, of a range its ends.
std::vector<std::string> trial_values(const SweepAxis& axis) {
  if (!axis.values.empty()) return axis.values;
  return {fmt::format("{:#}", axis.from), fmt::format("{:#}", axis.to)};
}

/// The message without the position, which is one in a text that nobody has written.
std::string without_position(const InputError& error) {
  std::string text = error.what();
  const std::string position =
      fmt::format("{}:{}:{}: ", error.source(), error.position().line, error.position().column);
  if (text.starts_with(position)) text = text.substr(position.size());
  return text;
}

}  // namespace

CampaignInputs::CampaignInputs(Sweep sweep, const std::filesystem::path& bank)
    : sweep_(std::move(sweep)), changed_(sweep_.changed_keys()) {
  if (changed_.contains("include") || changed_.contains("schema")) {
    throw InputError(sweep_.file.string(), {},
                     "axis: found one of `include` or `schema`, expected values of the scenario");
  }
  if (!bank.empty()) bank_edit_ = quoted(std::filesystem::absolute(bank).string());
  const Scenario written = read_scenario(sweep_.scenario);
  draft_.emplace(written.text, sweep_.scenario.string());
  base_.scenario = written;  // its includes are needed to load
  if (bank_edit_.empty()) {
    base_ = load_bench_inputs(written);
  } else {
    base_ = load(draft_->with({{"bank", bank_edit_}}));
  }
  is_base_shared_ = std::none_of(kFileKeys.begin(), kFileKeys.end(),
                                 [&](std::string_view key) { return changed_.contains(key); });
  std::string all = sweep_.text;
  for (const RunPart& part : base_.parts) all += part.part + text_digest(part.text);
  digest_ = text_digest(all);
  try_values();
}

BenchInputs CampaignInputs::load(const std::string& text) const {
  return load_bench_inputs(parse_scenario(text, sweep_.scenario, base_.scenario.includes));
}

std::string CampaignInputs::scenario_text(const SweepPoint& point) const {
  std::vector<TomlEdit> edits = sweep_.edits(point);
  if (!bank_edit_.empty()) edits.push_back({"bank", bank_edit_});
  return draft_->with(edits);
}

BenchInputs CampaignInputs::inputs(const SweepPoint& point) const {
  const std::string text = scenario_text(point);
  if (!is_base_shared_) return load(text);
  return vary_bench_inputs(base_, parse_scenario(text, sweep_.scenario, base_.scenario.includes),
                           changed_);
}

void CampaignInputs::try_values() const {
  const SweepPoint first = sweep_.point(0);
  const auto attempt = [&](const SweepPoint& point, const std::string& what) {
    try {
      static_cast<void>(inputs(point));
    } catch (const InputError& error) {
      throw InputError(sweep_.file.string(), {},
                       fmt::format("{}: {}, varied: {}", what, sweep_.scenario.string(),
                                   without_position(error)));
    } catch (const std::invalid_argument& error) {
      throw InputError(sweep_.file.string(), {}, fmt::format("{}: {}", what, error.what()));
    }
  };
  attempt(first, "run 0");
  for (std::size_t a = 0; a < sweep_.axes.size(); ++a) {
    for (const std::string& value : trial_values(sweep_.axes[a])) {
      SweepPoint point = first;
      point.values[a] = value;
      attempt(point, fmt::format("axis \"{}\" = {}", sweep_.axes[a].name, value));
    }
  }
}

}  // namespace faultline
