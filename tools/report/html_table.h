#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace faultline {

/// A table for people and screen readers: it has a caption, and its first cell of a row names it.
class HtmlTable {
 public:
  struct Column {
    std::string title;
    bool is_number = false;
  };

  HtmlTable(std::string caption, std::vector<Column> columns);

  /// A row of texts, which are escaped here; as many as there are columns. Of more rows than
  /// kMostRows the first are shown and the others counted.
  void add(const std::vector<std::string>& cells);

  [[nodiscard]] bool is_empty() const noexcept { return rows_ == 0; }
  [[nodiscard]] std::string text() const;

  static constexpr std::size_t kMostRows = 200;

 private:
  std::string caption_;
  std::vector<Column> columns_;
  std::string body_;
  std::size_t rows_ = 0;
};

}  // namespace faultline
