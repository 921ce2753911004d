#include <algorithm>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "tools/report/certificate_text.h"
#include "tools/report/html_table.h"
#include "tools/report/html_text.h"
#include "tools/report/page_sections.h"

namespace faultline {
namespace {

constexpr std::size_t kMostSignatures = 8;

/// A stretch of which the observed signature is told: of the truth, else of the verdict.
struct ObservedStretch {
  CycleRange cycles;
  std::string words;
};

std::vector<ObservedStretch> observed_stretches(const ReportedRun& run) {
  std::vector<ObservedStretch> stretches;
  if (run.record.has_truth) {
    for (const TruthStretch& stretch : run.truth) {
      stretches.push_back(
          {stretch.cycles, stretch.faults.empty()
                               ? std::string("no fault")
                               : fmt::format("{}", fmt::join(stretch.faults, ", "))});
    }
  } else {
    for (const VerdictStretch& stretch : run.record.verdicts) {
      stretches.push_back({stretch.cycles, verdict_words(stretch)});
    }
  }
  if (stretches.size() > kMostSignatures) stretches.resize(kMostSignatures);
  return stretches;
}

/// Share of the cycles in which the residual fired.
double fired_share(const std::vector<CycleRange>& fired, const CycleRange& cycles) {
  std::int64_t count = 0;
  for (const CycleRange& range : fired) {
    const std::int64_t from = std::max(range.from, cycles.from);
    count += std::max<std::int64_t>(std::min(range.until, cycles.until) - from, 0);
  }
  const std::int64_t whole = cycles.until - cycles.from;
  return whole > 0 ? static_cast<double>(count) / static_cast<double>(whole) : 0.0;
}

const char* sensitivity_text(Sensitivity sensitivity) {
  switch (sensitivity) {
    case Sensitivity::kNone:
      return "·";
    case Sensitivity::kTransient:
      return "~";
    case Sensitivity::kSteady:
      break;
  }
  return "■";
}

std::string structure_table(const ReportedRun& run) {
  const RunRecord& record = run.record;
  const Bank* const bank = record.bank ? &*record.bank : nullptr;
  const std::vector<ObservedStretch> stretches = observed_stretches(run);
  std::vector<HtmlTable::Column> columns{{"residual"}};
  if (bank != nullptr) {
    for (const std::string& fault : bank->fault_names) columns.push_back({fault});
  }
  for (const ObservedStretch& stretch : stretches) {
    columns.push_back(
        {fmt::format("fired: {}, {:.4g} to {:.4g} s", stretch.words,
                     record.time_s(stretch.cycles.from), record.time_s(stretch.cycles.until)),
         true});
  }
  HtmlTable table(
      fmt::format("Structure matrix{} (■ sees, ~ sees only while it changes, · ignores) and the "
                  "observed signature: share of each stretch in which the residual fired{}",
                  run.of_run(), stretches.size() == kMostSignatures ? "; the first stretches" : ""),
      columns);
  for (std::size_t i = 0; i < record.residuals.size(); ++i) {
    const LoggedResidual& residual = record.residuals[i];
    std::vector<std::string> cells{residual.name};
    if (bank != nullptr) {
      const bool is_of_bank = bank->filters.size() == record.residuals.size();
      for (std::size_t j = 0; j < bank->fault_names.size(); ++j) {
        cells.emplace_back(is_of_bank ? sensitivity_text(bank->filters[i].sees[j]) : "?");
      }
    }
    for (const ObservedStretch& stretch : stretches) {
      const double share = fired_share(residual.fired, stretch.cycles);
      cells.push_back(share > 0.0 ? fmt::format("■ {:.3g} %", 100.0 * share) : "·");
    }
    table.add(cells);
  }
  return table.is_empty() ? std::string() : table.text();
}

std::string certificates(const ReportedRun& run) {
  if (!run.record.bank) {
    return fmt::format(
        "<p>The log{} carries no bank, so what was proved of it cannot be told."
        "</p>\n",
        run.of_run());
  }
  const Bank& bank = *run.record.bank;
  std::string page = fmt::format(
      "<h3>Certificate{}</h3>\n<p>Bank “{}”, method {}, designed in the {} domain for up to {} "
      "concurrent fault{} at a sample time of {:.6g} s. Of the filters as they run it was proved:"
      "</p>\n<ul>\n",
      html(run.of_run()), html(bank.name), html(bank.method), domain_name(bank.domain),
      bank.concurrent, bank.concurrent == 1 ? "" : "s", bank.sample_time_s);
  for (const ResidualFilter& filter : bank.filters) {
    page += fmt::format("<li>{}</li>\n", html(certificate_text(bank, filter)));
  }
  page += "</ul>\n";
  const IsolabilityCertificate& isolability = bank.isolability;
  page += fmt::format("<p>Signatures of all sets of up to {} faults {}. {}</p>\n", bank.concurrent,
                      isolability.are_signatures_distinct ? "differ" : "do not all differ",
                      isolability.is_strongly_isolable
                          ? "They can be told apart whatever their courses."
                          : "For some courses of faults, sets cannot be told apart by any bank:");
  if (!isolability.confusable.empty()) {
    page += "<ul>\n";
    for (const ConfusableFaults& set : isolability.confusable) {
      std::vector<std::string> names;
      for (const std::size_t fault : set.faults) names.push_back(bank.fault_names[fault]);
      std::string weights;
      if (!set.weights.empty()) {
        weights = fmt::format(", in the proportions {:.3g}", fmt::join(set.weights, " : "));
      }
      page += fmt::format("<li>{}: one part looks like the other{}</li>\n",
                          html(names_in_words(names)), weights);
    }
    page += "</ul>\n";
  }
  return page;
}

}  // namespace

std::string bank_section(const std::vector<ReportedRun>& runs) {
  std::string page =
      "<section id=\"bank\" aria-labelledby=\"bank-h\"><h2 id=\"bank-h\">Structure and "
      "certificate</h2>\n";
  for (const ReportedRun& run : runs) page += structure_table(run);
  const auto digest = [](const ReportedRun& run) -> std::string {
    for (const RunParts::Part& part : run.record.parts) {
      if (part.part == "bank") return part.digest;
    }
    return {};
  };
  page += certificates(runs.front());
  for (std::size_t i = 1; i < runs.size(); ++i) {
    page += digest(runs[i]) == digest(runs.front()) && !digest(runs[i]).empty()
                ? fmt::format("<p>Run {} ran the same bank.</p>\n", runs[i].label)
                : certificates(runs[i]);
  }
  return page + "</section>\n";
}

}  // namespace faultline
