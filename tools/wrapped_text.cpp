#include "tools/wrapped_text.h"

#include <algorithm>

#include <fmt/format.h>

namespace faultline {

void print_wrapped(std::FILE* out, const std::string& text, std::size_t indent) {
  constexpr std::size_t kWidth = 100;
  std::string line;
  const auto flush = [&] {
    fmt::print(out, "{:{}}{}\n", "", indent, line);
    line.clear();
  };
  std::size_t begin = 0;
  while (begin < text.size()) {
    const std::size_t end = std::min(text.find(' ', begin), text.size());
    const std::string word = text.substr(begin, end - begin);
    if (!line.empty() && indent + line.size() + 1 + word.size() > kWidth) flush();
    line += line.empty() ? word : " " + word;
    begin = end + 1;
  }
  if (!line.empty()) flush();
}

}  // namespace faultline
