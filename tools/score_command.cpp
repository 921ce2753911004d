#include <cmath>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <CLI/App.hpp>
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "tools/campaign/campaign_database.h"
#include "tools/cli.h"
#include "tools/log/replaced_file.h"
#include "tools/score/score_page.h"
#include "tools/score/score_words.h"
#include "tools/score/scorecard.h"
#include "tools/version.h"

namespace faultline {
namespace {

using Json = nlohmann::ordered_json;

struct ScoreArguments {
  std::vector<std::string> databases;
  std::string output, json;
};

/// Infinite bounds are null.
Json estimate_json(const std::optional<Estimate>& estimate) {
  if (!estimate) return nullptr;
  const auto number = [](double value) { return std::isfinite(value) ? Json(value) : Json(); };
  return {{"value", number(estimate->value)},
          {"low", number(estimate->low)},
          {"high", number(estimate->high)}};
}

Json detectable_json(const DetectableSize& detectable) {
  using Kind = DetectableSize::Kind;
  const char* const kind = detectable.kind == Kind::kEstimated  ? "estimated"
                           : detectable.kind == Kind::kBelowAll ? "below_all"
                           : detectable.kind == Kind::kAboveAll ? "above_all"
                                                                : "undecided";
  Json json{{"kind", kind}};
  if (detectable.kind != Kind::kUndecided) json["size"] = estimate_json(detectable.size);
  return json;
}

Json card_json(const Scorecard& card) {
  Json json{{"campaign", card.campaign.name},
            {"digest", card.campaign.digest},
            {"bank", card.campaign.bank},
            {"method", card.campaign.method},
            {"runs", card.runs},
            {"run_count", card.campaign.run_count},
            {"failed", card.failed},
            {"faulty", card.faulty},
            {"TDR", estimate_json(card.TDR)},
            {"missed_detection_rate", estimate_json(card.missed_detection_rate)},
            {"FAR", estimate_json(card.FAR)},
            {"FIA", estimate_json(card.FIA)},
            {"false_alarms", card.false_alarms},
            {"faultless_h", card.faultless_h},
            {"false_alarms_per_h", estimate_json(card.false_alarms_per_h)},
            {"confusion", card.confusion}};
  for (const FaultScore& fault : card.faults) {
    json["faults"].push_back({{"truth", fault.truth},
                              {"kind", fault.kind},
                              {"runs", fault.runs},
                              {"detected", estimate_json(fault.detected)},
                              {"isolated", estimate_json(fault.isolated)},
                              {"detection_delay_median_s", estimate_json(fault.detection_median_s)},
                              {"detection_delay_p95_s", estimate_json(fault.detection_p95_s)},
                              {"isolation_delay_median_s", estimate_json(fault.isolation_median_s)},
                              {"isolation_delay_p95_s", estimate_json(fault.isolation_p95_s)},
                              {"detectable_95", detectable_json(fault.detectable)},
                              {"predicted", fault.predicted ? Json(*fault.predicted) : Json()}});
  }
  for (const ResidualScore& residual : card.residuals) {
    json["residuals"].push_back(
        {{"name", residual.name}, {"area_under_roc", estimate_json(residual.area_under_roc)}});
  }
  return json;
}

void print_card(std::FILE* out, const std::string& name, const Scorecard& card) {
  fmt::print(out, "{}: {} of {} runs, bank {} ({})\n", name, card.runs, card.campaign.run_count,
             card.campaign.bank, card.campaign.method);
  if (card.failed > 0) fmt::print(out, "  {} runs failed and are not in the scores\n", card.failed);
  fmt::print(out, "  TDR  {}\n  FAR  {}; {} alarms in {:.3g} h, {}\n  FIA  {}\n\n",
             percent_text(card.TDR), percent_text(card.FAR), card.false_alarms, card.faultless_h,
             rate_text(card.false_alarms_per_h), percent_text(card.FIA));
  fmt::print(out, "  {:<22}{:>6}  {:<24}{:<24}{:<26}{:<26}{}\n", "fault", "runs", "detected",
             "isolated", "detection delay, median", "isolation delay, median",
             "detected in 95 % from (design)");
  for (const FaultScore& fault : card.faults) {
    fmt::print(out, "  {:<22}{:>6}  {:<24}{:<24}{:<26}{:<26}{} ({})\n",
               fault.truth + " " + fault.kind, fault.runs, percent_text(fault.detected),
               percent_text(fault.isolated), delay_text(fault.detection_median_s),
               delay_text(fault.isolation_median_s), size_text(fault.detectable),
               predicted_text(fault.predicted));
  }
  fmt::print(out, "\n");
}

/// Files' names without folder and ending; where two are the same, as they were given.
std::vector<std::string> names_of(const std::vector<std::string>& files) {
  std::vector<std::string> names;
  for (const std::string& file : files) {
    names.push_back(std::filesystem::path(file).stem().string());
  }
  for (std::size_t i = 0; i < names.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      if (names[i] == names[j]) return files;
    }
  }
  return names;
}

int score(const ScoreArguments& arguments) {
  std::vector<Scorecard> cards;
  for (const std::string& file : arguments.databases) {
    cards.push_back(scorecard_of(CampaignDatabase(file)));
  }
  const std::vector<std::string> names = names_of(arguments.databases);
  std::FILE* const out = human_output(arguments.json);
  for (std::size_t i = 0; i < cards.size(); ++i) print_card(out, names[i], cards[i]);
  if (!arguments.json.empty()) {
    Json json = Json::array();
    for (const Scorecard& card : cards) json.push_back(card_json(card));
    write_json(json, arguments.json);
  }
  if (arguments.output.empty()) return kExitYes;
  const std::string page = score_page(cards, names, kVersion);
  ReplacedFile file(arguments.output);
  file.write(page.data(), page.size());
  file.commit();
  return kExitYes;
}

}  // namespace

void add_score_command(CLI::App& program, int& exit_code) {
  CLI::App* command = program.add_subcommand(
      "score", "What campaigns say of banks: rates, delays, smallest faults, with intervals");
  auto arguments = std::make_shared<ScoreArguments>();
  command
      ->add_option("DB", arguments->databases,
                   "Databases of `faultline campaign`; several stand side by side, two of the same "
                   "sweep are also compared run by run")
      ->required();
  command->add_option("-o,--output", arguments->output, "Also a page with pictures")
      ->type_name("F.html");
  add_json_option(*command, arguments->json);
  command->footer(kExitCodesHelp);
  command->callback([arguments, &exit_code] { exit_code = score(*arguments); });
}

}  // namespace faultline
