#include "diagnosis/bank/bank_file.h"

#include <cerrno>
#include <cstdint>
#include <fstream>
#include <iterator>
#include <system_error>

#include <unistd.h>

#include <fmt/format.h>

namespace faultline {
namespace {

// Bound against hostile files, far above any bank.
constexpr std::uintmax_t kMaxFileBytes = std::uintmax_t{256} << 20;

std::string located(const std::string& source, int line, int column, const std::string& text) {
  return line == 0 ? fmt::format("{}: {}", source, text)
                   : fmt::format("{}:{}:{}: {}", source, line, column, text);
}

[[noreturn]] void throw_system_error(const std::filesystem::path& file) {
  throw std::system_error(errno != 0 ? errno : EIO, std::generic_category(), file.string());
}

}  // namespace

BankFileError::BankFileError(const std::string& source, int line, int column,
                             const std::string& text)
    : std::runtime_error(located(source, line, column, text)),
      source_(source),
      line_(line),
      column_(column) {}

void write_bank(const Bank& bank, const std::filesystem::path& file) {
  const std::string text = bank_text(bank);
  std::filesystem::path temporary = file;
  temporary += fmt::format(".{}.tmp", ::getpid());
  errno = 0;
  std::ofstream stream(temporary, std::ios::binary);
  stream << text;
  stream.close();
  std::error_code cause;
  if (!stream) {
    cause.assign(errno != 0 ? errno : EIO, std::generic_category());
  } else {
    std::filesystem::rename(temporary, file, cause);
  }
  if (cause) {
    std::error_code ignored;
    std::filesystem::remove(temporary, ignored);
    throw std::system_error(cause, file.string());
  }
}

Bank read_bank(const std::filesystem::path& file) {
  errno = 0;
  std::ifstream stream(file, std::ios::binary);
  if (!stream.is_open() || std::filesystem::is_directory(file)) {
    throw_system_error(file);
  }
  if (std::error_code no_size;
      std::filesystem::file_size(file, no_size) > kMaxFileBytes && !no_size) {
    throw BankFileError(file.string(), 0, 0,
                        fmt::format("found more than {} bytes, expected a bank", kMaxFileBytes));
  }
  const std::string text(std::istreambuf_iterator<char>(stream), {});
  if (stream.bad()) {
    throw_system_error(file);
  }
  return parse_bank(text, file.string());
}

}  // namespace faultline
