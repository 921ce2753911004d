#include "tools/report/html_table.h"

#include <cassert>
#include <utility>

#include <fmt/format.h>

#include "tools/report/html_text.h"

namespace faultline {

HtmlTable::HtmlTable(std::string caption, std::vector<Column> columns)
    : caption_(std::move(caption)), columns_(std::move(columns)) {}

void HtmlTable::add(const std::vector<std::string>& cells) {
  assert(cells.size() == columns_.size());
  if (++rows_ > kMostRows) return;
  body_ += "<tr>";
  for (std::size_t i = 0; i < cells.size(); ++i) {
    const char* const css = columns_[i].is_number ? " class=\"n\"" : "";
    body_ += i == 0 ? fmt::format("<th scope=\"row\"{}>{}</th>", css, html(cells[i]))
                    : fmt::format("<td{}>{}</td>", css, html(cells[i]));
  }
  body_ += "</tr>\n";
}

std::string HtmlTable::text() const {
  std::string head;
  for (const Column& column : columns_) {
    head += fmt::format("<th scope=\"col\"{}>{}</th>", column.is_number ? " class=\"n\"" : "",
                        html(column.title));
  }
  std::string more;
  if (rows_ > kMostRows) {
    more = fmt::format("<p class=\"quiet\">and {} more rows</p>\n", rows_ - kMostRows);
  }
  return fmt::format(
      "<div class=\"scroll\"><table><caption>{}</caption>\n<thead><tr>{}</tr></thead>\n"
      "<tbody>\n{}</tbody></table></div>\n{}",
      html(caption_), head, body_, more);
}

}  // namespace faultline
