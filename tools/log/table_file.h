#pragma once

#include <filesystem>
#include <memory>
#include <span>
#include <string>

#include "tools/log/message_table.h"

namespace faultline {

/// A table on its way to a file, which is there with `commit`.
class TableFile {
 public:
  virtual ~TableFile() = default;
  /// @param columns the same for all rows. @throws OutputError
  virtual void add_row(std::span<const std::string> columns, std::span<const Cell> cells) = 0;
  /// @throws OutputError
  virtual void commit() = 0;
};

/// RFC 4180, but for the line ends of Unix: a row of names, then a line per row. Doubles are the
/// shortest text that reads back to the bit.
[[nodiscard]] std::unique_ptr<TableFile> open_csv_file(const std::filesystem::path& file);

/// MAT-file level 5, uncompressed (MATLAB's MAT-File Format, 2023): a variable per column, N×1.
/// Text is a cell array; whole numbers are int64, since stamps in ns are no doubles; where there is
/// no value is NaN. Names are made such that MATLAB takes them. Memory: the whole table. Written
/// here, since libmatio would bring HDF5 and fourteen packages for one file format.
[[nodiscard]] std::unique_ptr<TableFile> open_mat_file(const std::filesystem::path& file);

}  // namespace faultline
