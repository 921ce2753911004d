#include "tools/report/figure_page.h"

#include <algorithm>
#include <array>

#include <fmt/format.h>

#include "diagnosis/model/toml_reader.h"
#include "tools/report/chart_data.h"
#include "tools/report/html_text.h"
#include "tools/report/page_sections.h"
#include "tools/report/report_page.h"

namespace faultline {

FigureList read_figures(const std::filesystem::path& file) {
  TomlTable root = TomlTable::read_file(file);
  FigureList list;
  list.title = root.string("title");
  list.introduction = root.string("introduction");
  for (TomlTable table : root.tables("figure")) {
    Figure figure;
    figure.title = table.string("title");
    figure.log = table.string("log");
    figure.residuals = table.optional_strings("residuals").value_or(std::vector<std::string>());
    figure.claim = table.string("claim");
    figure.truth = table.string("truth");
    list.figures.push_back(std::move(figure));
  }
  if (list.figures.empty()) throw root.error("figure", "found no [[figure]], expected one or more");
  root.finish();
  return list;
}

std::string figure_page(const FigureList& list, const std::filesystem::path& folder,
                        const std::string& version) {
  ChartData charts;
  std::string body = fmt::format(
      "<a class=\"skip\" href=\"#main\">Skip to the figures</a>\n<header><h1>{}</h1></header>\n"
      "<main id=\"main\"><p>{}</p>\n<p class=\"quiet\"><span class=\"swatch\"></span>residual "
      "<span "
      "class=\"swatch t\"></span>threshold <span class=\"swatch f\"></span>fired <span "
      "class=\"swatch w\"></span>a fault acts. Drag to zoom, double-click for all.</p>\n",
      html(list.title), html(list.introduction));
  double until_s = 0.0;
  for (const Figure& figure : list.figures) {
    const ReportedRun run = evaluated(read_run_record({(folder / figure.log).string()}));
    if (run.record.cycles) until_s = std::max(until_s, run.record.time_s(run.record.cycles->until));
    body += fmt::format(
        "<section><h2>{}</h2>\n<div class=\"figure\"><div><h3>The paper says</h3><p>{}</p></div>"
        "<div><h3>What is true</h3><p>{}</p></div></div>\n{}{}</section>\n",
        html(figure.title), html(figure.claim), html(figure.truth), run_timeline(run),
        residual_charts(run, figure.residuals, charts));
  }
  body += fmt::format(
      "</main><footer><p class=\"quiet\">Made by faultline {} from runs of the "
      "scenarios beside it; charts by dygraphs 2 (MIT licence).</p></footer>\n",
      html(version));
  return html_page(list.title, body, charts.json({0.0, std::max(until_s, 1e-9)}, {}));
}

}  // namespace faultline
