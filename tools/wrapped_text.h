#pragma once

#include <cstddef>
#include <cstdio>
#include <string>

namespace faultline {

/// Prints a text in lines of terminal width, broken between words, each behind `indent` spaces.
void print_wrapped(std::FILE* out, const std::string& text, std::size_t indent = 8);

}  // namespace faultline
