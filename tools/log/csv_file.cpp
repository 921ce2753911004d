#include <iterator>
#include <string_view>

#include <fmt/format.h>

#include "tools/log/replaced_file.h"
#include "tools/log/table_file.h"

namespace faultline {
namespace {

constexpr std::size_t kLarge = std::size_t{1} << 16;

void append(fmt::memory_buffer& out, std::string_view text) {
  out.append(text.data(), text.data() + text.size());
}

/// Quoted where it holds a comma, a quote or a line end.
void append_text(fmt::memory_buffer& out, std::string_view text) {
  if (text.find_first_of(",\"\r\n") == std::string_view::npos) return append(out, text);
  out.push_back('"');
  for (const char c : text) {
    if (c == '"') out.push_back('"');
    out.push_back(c);
  }
  out.push_back('"');
}

void append_cell(fmt::memory_buffer& out, const Cell& cell) {
  if (const auto* whole = std::get_if<std::int64_t>(&cell)) {
    fmt::format_to(std::back_inserter(out), "{}", *whole);
  } else if (const auto* real = std::get_if<double>(&cell)) {
    fmt::format_to(std::back_inserter(out), "{}", *real);
  } else if (const auto* text = std::get_if<std::string>(&cell)) {
    append_text(out, *text);
  }
}

class CsvFile final : public TableFile {
 public:
  explicit CsvFile(const std::filesystem::path& file) : file_(file) {}

  void add_row(std::span<const std::string> columns, std::span<const Cell> cells) override {
    if (is_first_) {
      for (std::size_t i = 0; i < columns.size(); ++i) {
        if (i > 0) buffer_.push_back(',');
        append_text(buffer_, columns[i]);
      }
      buffer_.push_back('\n');
      is_first_ = false;
    }
    for (std::size_t i = 0; i < cells.size(); ++i) {
      if (i > 0) buffer_.push_back(',');
      append_cell(buffer_, cells[i]);
    }
    buffer_.push_back('\n');
    if (buffer_.size() >= kLarge) flush();
  }

  void commit() override {
    flush();
    file_.commit();
  }

 private:
  void flush() {
    file_.write({buffer_.data(), buffer_.size()});
    buffer_.clear();
  }

  ReplacedFile file_;
  fmt::memory_buffer buffer_;
  bool is_first_ = true;
};

}  // namespace

std::unique_ptr<TableFile> open_csv_file(const std::filesystem::path& file) {
  return std::make_unique<CsvFile>(file);
}

}  // namespace faultline
