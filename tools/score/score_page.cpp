#include "tools/score/score_page.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <set>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "tools/report/html_table.h"
#include "tools/report/html_text.h"
#include "tools/report/report_page.h"
#include "tools/score/score_words.h"

namespace faultline {
namespace {

// A chart is drawn on this canvas; the page scales it.
constexpr double kWidth = 420.0, kHeight = 230.0, kLeft = 44.0, kRight = 10.0, kTop = 10.0,
                 kBottom = 36.0;
constexpr std::array<const char*, 5> kColours{"--run-a", "--run-b", "--threshold", "--healthy",
                                              "--fired"};

// A cell may break before its interval, not within it.
std::string unbroken(const std::string& text) {
  std::string result;
  bool is_within = false;
  for (const char letter : text) {
    is_within = letter == '(' || (is_within && letter != ')');
    if (is_within && letter == ' ') {
      result += "\u00a0";
    } else {
      result += letter;
    }
  }
  return result;
}

std::string percent_cell(const std::optional<Estimate>& share) {
  return unbroken(percent_text(share));
}

std::string delay_cell(const std::optional<Estimate>& delay_s) {
  return unbroken(delay_text(delay_s));
}

const char* colour(std::size_t i) { return kColours.at(i % kColours.size()); }

/// An axis from `low` to `high`, logarithmic or not.
struct Scale {
  double low = 0.0, high = 1.0;
  bool is_logarithmic = false;
  [[nodiscard]] double share(double value) const {
    if (is_logarithmic) return std::log(value / low) / std::log(high / low);
    return (value - low) / (high - low);
  }
};

class Chart {
 public:
  Chart(std::string title, Scale x, const std::string& x_title, const std::string& y_title)
      : title_(std::move(title)), x_(x) {
    for (const double y : {0.0, 0.25, 0.5, 0.75, 1.0}) {
      body_ += fmt::format(
          "<line x1=\"{}\" x2=\"{}\" y1=\"{:.1f}\" y2=\"{:.1f}\" stroke=\"var(--grid)\"/>"
          "<text x=\"{}\" y=\"{:.1f}\" text-anchor=\"end\">{:.0f}</text>",
          kLeft, kWidth - kRight, at_y(y), at_y(y), kLeft - 4.0, at_y(y) + 4.0, 100.0 * y);
    }
    for (int i = 0; i <= 4; ++i) {
      const double share = i / 4.0;
      const double value = x.is_logarithmic ? x.low * std::pow(x.high / x.low, share)
                                            : x.low + share * (x.high - x.low);
      body_ +=
          fmt::format("<text x=\"{:.1f}\" y=\"{}\" text-anchor=\"middle\">{:.2g}</text>",
                      kLeft + share * (kWidth - kLeft - kRight), kHeight - kBottom + 16.0, value);
    }
    body_ += fmt::format(
        "<text x=\"{}\" y=\"{}\" text-anchor=\"middle\">{}</text>"
        "<text x=\"12\" y=\"{}\" transform=\"rotate(-90 12 {})\" text-anchor=\"middle\">{}</text>",
        (kLeft + kWidth - kRight) / 2.0, kHeight - 4.0, html(x_title), kHeight / 2.0, kHeight / 2.0,
        html(y_title));
  }

  void line(const std::vector<std::array<double, 2>>& points, std::size_t series) {
    std::string path;
    for (const auto& [x, y] : points) path += fmt::format("{:.1f},{:.1f} ", at_x(x), at_y(y));
    body_ += fmt::format(
        "<polyline points=\"{}\" fill=\"none\" stroke=\"var({})\" stroke-width=\"1.8\"/>", path,
        colour(series));
  }
  void bar(double x, const Estimate& y, std::size_t series) {
    body_ += fmt::format(
        "<line x1=\"{0:.1f}\" x2=\"{0:.1f}\" y1=\"{1:.1f}\" y2=\"{2:.1f}\" stroke=\"var({4})\"/>"
        "<circle cx=\"{0:.1f}\" cy=\"{3:.1f}\" r=\"2.5\" fill=\"var({4})\"/>",
        at_x(x), at_y(y.low), at_y(y.high), at_y(y.value), colour(series));
  }
  void mark(double x) {
    body_ += fmt::format(
        "<line x1=\"{0:.1f}\" x2=\"{0:.1f}\" y1=\"{1}\" y2=\"{2}\" stroke=\"var(--quiet)\" "
        "stroke-dasharray=\"4 3\"/>",
        at_x(x), kTop, kHeight - kBottom);
  }
  [[nodiscard]] std::string text(const std::string& legend) const {
    return fmt::format(
        "<figure><figcaption><strong>{0}</strong> {1}</figcaption>\n<svg viewBox=\"0 0 {2} {3}\" "
        "role=\"img\" aria-label=\"{0}\">{4}</svg></figure>\n",
        html(title_), legend, kWidth, kHeight, body_);
  }

 private:
  [[nodiscard]] double at_x(double x) const {
    return kLeft + std::clamp(x_.share(x), 0.0, 1.0) * (kWidth - kLeft - kRight);
  }
  [[nodiscard]] static double at_y(double y) {
    return kTop + (1.0 - std::clamp(y, 0.0, 1.0)) * (kHeight - kTop - kBottom);
  }

  std::string title_, body_;
  Scale x_;
};

std::string legend(const std::vector<std::string>& names) {
  if (names.size() < 2) return "";
  std::string text;
  for (std::size_t i = 0; i < names.size(); ++i) {
    text += fmt::format("<span class=\"swatch\" style=\"border-color:var({})\"></span>{} ",
                        colour(i), html(names[i]));
  }
  return text;
}

/// Detection over size, in bins of equal numbers of runs.
void draw_detection(Chart& chart, std::vector<Trial> trials, std::size_t series) {
  std::sort(trials.begin(), trials.end(),
            [](const Trial& a, const Trial& b) { return a.size < b.size; });
  const std::size_t bins = std::clamp<std::size_t>(trials.size() / 20, 1, 12);
  std::vector<std::array<double, 2>> line;
  for (std::size_t bin = 0; bin < bins; ++bin) {
    const std::size_t from = bin * trials.size() / bins, until = (bin + 1) * trials.size() / bins;
    if (from == until) continue;
    std::uint64_t found = 0;
    double logarithms = 0.0;
    for (std::size_t i = from; i < until; ++i) {
      found += trials[i].is_found ? 1U : 0U;
      logarithms += std::log(trials[i].size);
    }
    const double middle = std::exp(logarithms / static_cast<double>(until - from));
    const Estimate share = proportion(found, until - from);
    chart.bar(middle, share, series);
    line.push_back({middle, share.value});
  }
  chart.line(line, series);
}

const FaultScore* find_fault(const Scorecard& card, const std::string& truth,
                             const std::string& kind) {
  for (const FaultScore& fault : card.faults) {
    if (fault.truth == truth && fault.kind == kind) return &fault;
  }
  return nullptr;
}

std::string fault_charts(const std::vector<Scorecard>& cards,
                         const std::vector<std::string>& names) {
  std::set<std::pair<std::string, std::string>> keys;
  for (const Scorecard& card : cards) {
    for (const FaultScore& fault : card.faults) {
      if (fault.trials.size() >= 20) keys.insert({fault.truth, fault.kind});
    }
  }
  std::string text;
  for (const auto& [truth, kind] : keys) {
    Scale scale{std::numeric_limits<double>::infinity(), 0.0, true};
    for (const Scorecard& card : cards) {
      if (const FaultScore* fault = find_fault(card, truth, kind)) {
        for (const Trial& trial : fault->trials) {
          scale.low = std::min(scale.low, trial.size);
          scale.high = std::max(scale.high, trial.size);
        }
      }
    }
    if (!(scale.high > scale.low)) continue;
    Chart chart(fmt::format("{} {}: detected, over its size", truth, kind), scale,
                "size, in the fault's unit", "detected, %");
    std::string note = legend(names);
    for (std::size_t i = 0; i < cards.size(); ++i) {
      const FaultScore* fault = find_fault(cards[i], truth, kind);
      if (fault == nullptr) continue;
      draw_detection(chart, fault->trials, i);
      if (fault->predicted && i == 0) {
        chart.mark(*fault->predicted);
        note += "(dashed: isolated from there on, says the design)";
      }
    }
    text += chart.text(note);
  }
  return text;
}

std::string roc_chart(const std::vector<Scorecard>& cards, const std::vector<std::string>& names) {
  Chart chart("ROC of the bank: all thresholds larger or smaller", {0.0, 1.0, false},
              "runs with a false alarm", "faults detected, %");
  bool has_any = false;
  for (std::size_t i = 0; i < cards.size(); ++i) {
    std::vector<std::array<double, 2>> line;
    for (const RocPoint& point : cards[i].roc) {
      line.push_back({point.false_alarms, point.detections});
    }
    has_any = has_any || !line.empty();
    if (!line.empty()) chart.line(line, i);
  }
  return has_any ? chart.text(legend(names)) : "";
}

std::string delay_chart(const std::vector<Scorecard>& cards,
                        const std::vector<std::string>& names) {
  double longest = 0.0;
  for (const Scorecard& card : cards) {
    for (const ScoredRun& run : card.all)
      longest = std::max(longest, run.detection_delay_s.value_or(0));
  }
  if (longest == 0.0) return "";
  Chart chart("Detection delay: faults detected by then", {0.0, longest, false}, "s from the onset",
              "of all faults, %");
  for (std::size_t i = 0; i < cards.size(); ++i) {
    std::vector<double> delays;
    std::size_t faulty = 0;
    for (const ScoredRun& run : cards[i].all) {
      faulty += run.has_fault() ? 1U : 0U;
      if (run.has_fault() && run.detection_delay_s) delays.push_back(*run.detection_delay_s);
    }
    std::sort(delays.begin(), delays.end());
    std::vector<std::array<double, 2>> line{{0.0, 0.0}};
    const std::size_t step = std::max<std::size_t>(1, delays.size() / 300);
    for (std::size_t n = 0; n < delays.size(); n += step) {
      const auto all = static_cast<double>(faulty);
      line.push_back({delays[n], static_cast<double>(n) / all});
      line.push_back({delays[n], static_cast<double>(n + 1) / all});
    }
    chart.line(line, i);
  }
  return chart.text(legend(names));
}

std::string metrics_table(const std::vector<Scorecard>& cards,
                          const std::vector<std::string>& names) {
  std::vector<HtmlTable::Column> columns{{"Metric", false}};
  for (const std::string& name : names) columns.push_back({name, true});
  HtmlTable table("With intervals that hold the truth with 95 %", columns);
  const auto row = [&](const std::string& title, auto&& value) {
    std::vector<std::string> cells{title};
    for (const Scorecard& card : cards) cells.push_back(value(card));
    table.add(cells);
  };
  row("Runs", [](const Scorecard& c) {
    return fmt::format("{} of {}{}", c.runs, c.campaign.run_count,
                       c.failed > 0 ? fmt::format(", {} failed", c.failed) : "");
  });
  row("Runs with a fault", [](const Scorecard& c) { return fmt::format("{}", c.faulty); });
  row("True detection rate (TDR)", [](const Scorecard& c) { return percent_cell(c.TDR); });
  row("Missed-detection rate",
      [](const Scorecard& c) { return percent_cell(c.missed_detection_rate); });
  row("False-alarm rate (FAR)", [](const Scorecard& c) { return percent_cell(c.FAR); });
  row("False alarms", [](const Scorecard& c) { return unbroken(rate_text(c.false_alarms_per_h)); });
  row("Fault-free time", [](const Scorecard& c) { return fmt::format("{:.3g} h", c.faultless_h); });
  row("Fault isolation accuracy (FIA)", [](const Scorecard& c) { return percent_cell(c.FIA); });
  row("Method", [](const Scorecard& c) { return c.campaign.method; });
  row("Bank", [](const Scorecard& c) { return c.campaign.bank; });
  return "<div class=\"scroll\">" + table.text() + "</div>\n";
}

std::string fault_table(const Scorecard& card, const std::string& name) {
  HtmlTable table(name, {{"Fault", false},
                         {"Runs", true},
                         {"Detected", true},
                         {"Isolated", true},
                         {"Detection delay, median", true},
                         {"95 % by", true},
                         {"Isolation delay, median", true},
                         {"95 % by", true},
                         {"Detected in 95 % from size", true},
                         {"Design: isolated from", true}});
  for (const FaultScore& fault : card.faults) {
    table.add({fmt::format("{} {}", fault.truth, fault.kind), fmt::format("{}", fault.runs),
               percent_cell(fault.detected), percent_cell(fault.isolated),
               delay_cell(fault.detection_median_s), delay_cell(fault.detection_p95_s),
               delay_cell(fault.isolation_median_s), delay_cell(fault.isolation_p95_s),
               unbroken(size_text(fault.detectable)), predicted_text(fault.predicted)});
  }
  return "<div class=\"scroll\">" + table.text() + "</div>\n";
}

/// The share of a row as the background of its cell, the number in it.
std::string confusion_table(const Scorecard& card, const std::string& name) {
  std::set<std::string> verdicts;
  for (const auto& [truth, row] : card.confusion) {
    for (const auto& [verdict, count] : row) verdicts.insert(verdict);
  }
  std::string text = fmt::format(
      "<div class=\"scroll\"><table><caption>{}: runs by truth and the verdict at the end of the "
      "fault</caption><thead><tr><th scope=\"col\">Truth</th>",
      html(name));
  for (const std::string& verdict : verdicts) {
    text += fmt::format("<th scope=\"col\" class=\"n\">{}</th>", html(verdict));
  }
  text += "</tr></thead><tbody>";
  for (const auto& [truth, row] : card.confusion) {
    std::uint64_t sum = 0;
    for (const auto& [verdict, count] : row) sum += count;
    text += fmt::format("<tr><th scope=\"row\">{}</th>", html(truth));
    for (const std::string& verdict : verdicts) {
      const auto found = row.find(verdict);
      const std::uint64_t count = found == row.end() ? 0 : found->second;
      const double share = static_cast<double>(count) / static_cast<double>(sum);
      const bool is_right = truth == "none" ? verdict == "healthy" : verdict == "isolated " + truth;
      text += fmt::format(
          "<td class=\"n\" style=\"background:color-mix(in srgb,var({}) {:.0f}%,transparent)\">{}"
          "</td>",
          is_right ? "--healthy" : "--fired", 70.0 * share, count);
    }
    text += "</tr>";
  }
  return text + "</tbody></table></div>\n";
}

std::string residual_table(const std::vector<Scorecard>& cards,
                           const std::vector<std::string>& names) {
  std::string text;
  for (std::size_t i = 0; i < cards.size(); ++i) {
    HtmlTable table(names[i], {{"Residual", false}, {"Area under its ROC curve", true}});
    for (const ResidualScore& residual : cards[i].residuals) {
      const auto& area = residual.area_under_roc;
      table.add({residual.name,
                 area ? fmt::format("{:.3f} ({:.3f} .. {:.3f})", area->value, area->low, area->high)
                      : "-"});
    }
    if (!table.is_empty()) text += "<div class=\"scroll\">" + table.text() + "</div>\n";
  }
  return text;
}

std::string comparison_section(const Scorecard& a, const Scorecard& b,
                               const std::vector<std::string>& names) {
  const Comparison c = compare(a, b);
  if (c.pairs == 0) return "";
  const auto points = [](const std::optional<Estimate>& difference) {
    if (!difference) return std::string("-");
    return fmt::format("{:+.1f} points ({:+.1f} .. {:+.1f})", 100.0 * difference->value,
                       100.0 * difference->low, 100.0 * difference->high);
  };
  HtmlTable table(
      fmt::format("{} less {}, on the same {} runs, {} with a fault", names[1], names[0], c.pairs,
                  c.faulty),
      {{"", false}, {"Difference", true}, {"Only " + names[0], true}, {"Only " + names[1], true}});
  table.add({"Faults detected", points(c.detected_difference),
             fmt::format("{} runs", c.only_a_detects), fmt::format("{} runs", c.only_b_detects)});
  table.add({"Faults isolated", points(c.isolated_difference),
             fmt::format("{} runs", c.only_a_isolates), fmt::format("{} runs", c.only_b_isolates)});
  table.add(
      {"Detection delay, median of the differences",
       c.delay_difference_s ? fmt::format("{:+.3g} ms", 1e3 * c.delay_difference_s->value) : "-",
       "", ""});
  return "<div class=\"scroll\">" + table.text() + "</div>\n";
}

// Cards of one sweep, which stand side by side.
struct Group {
  std::string title;
  std::vector<Scorecard> cards;
  std::vector<std::string> names;
};

std::vector<Group> groups_of(const std::vector<Scorecard>& cards,
                             const std::vector<std::string>& names) {
  std::vector<Group> groups;
  for (std::size_t i = 0; i < cards.size(); ++i) {
    const CampaignIdentity& campaign = cards[i].campaign;
    const std::string title = fmt::format("{}, plant {}", campaign.name, campaign.plant);
    auto group = std::find_if(groups.begin(), groups.end(),
                              [&](const Group& one) { return one.title == title; });
    if (group == groups.end()) group = groups.insert(groups.end(), Group{title, {}, {}});
    group->cards.push_back(cards[i]);
    group->names.push_back(names[i]);
  }
  return groups;
}

// A part of the page with its heading, below the group's where there are several.
class Outline {
 public:
  explicit Outline(bool has_groups) : tag_(has_groups ? "h3" : "h2") {}
  [[nodiscard]] std::string section(const std::string& title, const std::string& body) const {
    return body.empty() ? ""
                        : fmt::format("<section><{0}>{1}</{0}>{2}</section>\n", tag_, title, body);
  }

 private:
  const char* tag_;
};

std::string group_text(const Group& group, const Outline& outline) {
  const auto& [title, cards, names] = group;
  std::string text = outline.section("Metrics", metrics_table(cards, names));
  if (cards.size() == 2) {
    text += outline.section("Run by run", comparison_section(cards[0], cards[1], names));
  }
  std::string faults;
  for (std::size_t i = 0; i < cards.size(); ++i) faults += fault_table(cards[i], names[i]);
  text += outline.section("Faults",
                          faults + "<div class=\"grid\">" + fault_charts(cards, names) + "</div>");
  text += outline.section(
      "Delays and false alarms",
      "<div class=\"grid\">" + delay_chart(cards, names) + roc_chart(cards, names) + "</div>");
  std::string confusion;
  for (std::size_t i = 0; i < cards.size(); ++i) confusion += confusion_table(cards[i], names[i]);
  text += outline.section("Confusion", confusion);
  return text + outline.section("Residuals", residual_table(cards, names));
}

// The banks of all groups in one table.
std::string overview(const std::vector<Group>& groups) {
  HtmlTable table("All banks", {{"Bank", false},
                                {"Method", false},
                                {"Plant", false},
                                {"Faults detected", true},
                                {"Faults isolated", true},
                                {"Detection delay, median", true},
                                {"False-alarm rate (FAR)", true},
                                {"Isolation accuracy (FIA)", true}});
  for (const Group& group : groups) {
    for (std::size_t i = 0; i < group.cards.size(); ++i) {
      const Scorecard& card = group.cards[i];
      std::uint64_t runs = 0, detected = 0, isolated = 0;
      std::vector<double> delays;
      for (const ScoredRun& run : card.all) {
        if (!run.has_fault()) continue;
        ++runs;
        detected += run.is_detected ? 1U : 0U;
        isolated += run.isolation_delay_s ? 1U : 0U;
        if (run.detection_delay_s) delays.push_back(*run.detection_delay_s);
      }
      std::string median = "-";
      if (2 * delays.size() > runs) {
        const auto middle = delays.begin() + static_cast<std::ptrdiff_t>(runs / 2);
        std::nth_element(delays.begin(), middle, delays.end());
        median = *middle >= 1.0 ? fmt::format("{:.3g} s", *middle)
                                : fmt::format("{:.3g} ms", 1e3 * *middle);
      }
      const auto share = [runs](std::uint64_t count) {
        return runs == 0 ? std::string("-") : percent_cell(proportion(count, runs));
      };
      table.add({group.names[i], card.campaign.method, card.campaign.plant, share(detected),
                 share(isolated), median, percent_cell(card.FAR), percent_cell(card.FIA)});
    }
  }
  return "<div class=\"scroll\">" + table.text() + "</div>\n";
}

std::string origin_text(const std::vector<Scorecard>& cards,
                        const std::vector<std::string>& names) {
  std::string text;
  for (std::size_t i = 0; i < cards.size(); ++i) {
    const CampaignIdentity& campaign = cards[i].campaign;
    text += fmt::format(
        "<p><strong>{}</strong>: campaign \"{}\" ({}), digest <code>{}</code>, plant {}, bank {}, "
        "faultline {}</p>\n",
        html(names[i]), html(campaign.name), html(campaign.sampling), html(campaign.digest),
        html(campaign.plant), html(campaign.bank), html(campaign.version));
  }
  return text;
}

}  // namespace

std::string score_page(const std::vector<Scorecard>& cards, const std::vector<std::string>& names,
                       const std::string& version) {
  const std::vector<Group> groups = groups_of(cards, names);
  const std::string title = fmt::format("{}: scorecard", fmt::join(names, ", "));
  std::string body = fmt::format(
      "<a class=\"skip\" href=\"#main\">Skip to the scores</a>\n<header><h1>{}</h1>\n<p "
      "class=\"quiet\">What the banks find, how fast, and how often they are wrong</p></header>\n"
      "<main id=\"main\">\n",
      html(groups.size() > 1 ? "Scorecard" : title));
  const Outline top(false), inner(groups.size() > 1);
  if (groups.size() > 1) body += top.section("Overview", overview(groups));
  for (const Group& group : groups) {
    if (groups.size() > 1) body += fmt::format("<h2 class=\"group\">{}</h2>\n", html(group.title));
    body += group_text(group, inner);
  }
  body += top.section("How to repeat it", origin_text(cards, names));
  body += fmt::format("</main><footer><p class=\"quiet\">Made by faultline {}.</p></footer>\n",
                      html(version));
  return html_page(title, body, "");
}

}  // namespace faultline
