#include "diagnosis/model/input_error.h"

#include <fmt/format.h>

namespace faultline {
namespace {

std::string located(const std::string& source, SourcePosition position, const std::string& text) {
  if (position.line == 0) {
    return fmt::format("{}: {}", source, text);
  }
  return fmt::format("{}:{}:{}: {}", source, position.line, position.column, text);
}

}  // namespace

InputError::InputError(const std::string& source, SourcePosition position, const std::string& text)
    : std::runtime_error(located(source, position, text)), source_(source), position_(position) {}

}  // namespace faultline
