#include <algorithm>
#include <array>
#include <bit>
#include <cctype>
#include <cstring>
#include <limits>
#include <string_view>
#include <utility>

#include <fmt/format.h>

#include "tools/cli.h"
#include "tools/log/replaced_file.h"
#include "tools/log/table_file.h"

namespace faultline {
namespace {

static_assert(std::endian::native == std::endian::little, "numbers are written as they are");

// Data types and array classes of the format.
enum : std::uint32_t { kInt8 = 1, kUint8 = 2, kInt32 = 5, kUint32 = 6, kDouble = 9, kInt64 = 12 };
enum : std::uint32_t { kMatrix = 14, kUtf8 = 16 };
enum : std::uint32_t { kCellClass = 1, kCharClass = 4, kDoubleClass = 6, kInt64Class = 14 };

constexpr std::size_t kTagBytes = 8;
/// Of a data element: its length is 32 bits, and some readers take them as signed.
constexpr std::size_t kLargestElement = std::numeric_limits<std::int32_t>::max();

std::size_t padded(std::size_t bytes) { return (bytes + 7) / 8 * 8; }

void append(std::string& out, const void* bytes, std::size_t count) {
  out.append(static_cast<const char*>(bytes), count);
}

void append_tag(std::string& out, std::uint32_t type, std::size_t bytes) {
  const std::array<std::uint32_t, 2> tag{type, static_cast<std::uint32_t>(bytes)};
  append(out, tag.data(), kTagBytes);
}

void append_element(std::string& out, std::uint32_t type, const void* data, std::size_t bytes) {
  append_tag(out, type, bytes);
  if (bytes > 0) append(out, data, bytes);
  out.append(padded(bytes) - bytes, '\0');
}

/// An array up to its values, of which `value_bytes` follow with their tags.
std::string array_head(std::uint32_t array_class, std::size_t rows, std::size_t columns,
                       std::string_view name, std::size_t value_bytes) {
  std::string head;
  const std::array<std::uint32_t, 2> flags{array_class, 0};
  append_element(head, kUint32, flags.data(), sizeof flags);
  const std::array<std::int32_t, 2> sizes{static_cast<std::int32_t>(rows),
                                          static_cast<std::int32_t>(columns)};
  append_element(head, kInt32, sizes.data(), sizeof sizes);
  append_element(head, kInt8, name.data(), name.size());
  std::string tag;
  append_tag(tag, kMatrix, head.size() + value_bytes);
  return tag + head;
}

/// Characters of UTF-8: what does not continue another.
std::size_t character_count(std::string_view text) {
  return static_cast<std::size_t>(std::count_if(text.begin(), text.end(), [](char c) {
    return (static_cast<unsigned char>(c) & 0xC0) != 0x80;
  }));
}

/// One column; of what kind its first value tells.
struct Column {
  std::string name;
  std::vector<double> reals;
  std::vector<std::int64_t> wholes;
  std::string texts;  ///< a cell array's elements
  std::size_t rows = 0;

  void add(const Cell& cell) {
    ++rows;
    if (const auto* text = std::get_if<std::string>(&cell)) {
      const std::size_t bytes = kTagBytes + padded(text->size());
      texts += array_head(kCharClass, text->empty() ? 0 : 1, character_count(*text), "", bytes);
      append_element(texts, kUtf8, text->data(), text->size());
    } else if (const auto* whole = std::get_if<std::int64_t>(&cell)) {
      wholes.push_back(*whole);
    } else {
      const auto* real = std::get_if<double>(&cell);
      reals.push_back(real != nullptr ? *real : std::numeric_limits<double>::quiet_NaN());
    }
  }
  [[nodiscard]] std::size_t value_bytes() const {
    return !texts.empty() ? texts.size() : kTagBytes + sizeof(double) * rows;
  }
};

/// MATLAB's names are letters, digits and underscores, up to 63, and begin with a letter.
std::string matlab_name(const std::string& name, const std::vector<Column>& taken) {
  constexpr std::size_t kLongest = 63, kLongestNumber = 12;
  std::string plain = name.substr(0, kLongest - kLongestNumber);
  for (char& c : plain) {
    if (std::isalnum(static_cast<unsigned char>(c)) == 0) c = '_';
  }
  if (plain.empty() || std::isalpha(static_cast<unsigned char>(plain[0])) == 0)
    plain.insert(0, "x");
  std::string free = plain;
  const auto is_taken = [&] {
    return std::any_of(taken.begin(), taken.end(),
                       [&](const Column& column) { return column.name == free; });
  };
  for (int n = 2; is_taken(); ++n) free = fmt::format("{}_{}", plain, n);
  return free;
}

class MatFile final : public TableFile {
 public:
  explicit MatFile(const std::filesystem::path& file) : name_(file.string()), file_(file) {}

  void add_row(std::span<const std::string> columns, std::span<const Cell> cells) override {
    for (std::size_t i = columns_.size(); i < columns.size(); ++i) {
      columns_.push_back({matlab_name(columns[i], columns_), {}, {}, {}, 0});
    }
    for (std::size_t i = 0; i < cells.size(); ++i) columns_[i].add(cells[i]);
  }

  void commit() override {
    std::string head = "MATLAB 5.0 MAT-file, written by faultline log export";
    head.resize(124, ' ');
    // Version, and what tells the order of bytes.
    head += std::string("\x00\x01IM", 4);
    file_.write(head);
    for (const Column& column : columns_) write(column);
    file_.commit();
  }

 private:
  void write(const Column& column) {
    if (column.value_bytes() > kLargestElement - 1024) {
      throw OutputError(
          fmt::format("cannot write {}: {} rows of {} are more than a MAT-file holds (--format "
                      "csv, or log cut)",
                      name_, column.rows, column.name));
    }
    const bool is_text = !column.texts.empty();
    const bool is_whole = !column.wholes.empty();
    const std::uint32_t array_class = is_text ? kCellClass : is_whole ? kInt64Class : kDoubleClass;
    file_.write(array_head(array_class, column.rows, 1, column.name, column.value_bytes()));
    if (is_text) return file_.write(column.texts);
    std::string tag;
    append_tag(tag, is_whole ? kInt64 : kDouble, sizeof(double) * column.rows);
    file_.write(tag);
    file_.write(is_whole ? static_cast<const void*>(column.wholes.data()) : column.reals.data(),
                sizeof(double) * column.rows);
  }

  std::string name_;
  ReplacedFile file_;
  std::vector<Column> columns_;
};

}  // namespace

std::unique_ptr<TableFile> open_mat_file(const std::filesystem::path& file) {
  return std::make_unique<MatFile>(file);
}

}  // namespace faultline
