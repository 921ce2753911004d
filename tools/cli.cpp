#include "tools/cli.h"

#include <cerrno>
#include <cmath>
#include <cstdlib>
#include <cstring>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

namespace faultline {

using Json = nlohmann::ordered_json;

void add_json_option(CLI::App& command, std::string& target) {
  command.add_option("--json", target, "Also give the result as data: to file F, or - for stdout")
      ->type_name("F|-");
}

std::string check_finite(const std::string& text) {
  char* end = nullptr;
  const bool is_finite = std::isfinite(std::strtod(text.c_str(), &end));
  return is_finite ? "" : fmt::format("found {}, expected a finite number", text);
}

void write_to(const std::string& target, const std::function<void(std::FILE*)>& write) {
  const bool is_stdout = target == "-";
  std::FILE* file = is_stdout ? stdout : std::fopen(target.c_str(), "w");
  if (file == nullptr) {
    throw OutputError(fmt::format("cannot write {}: {}", target, std::strerror(errno)));
  }
  errno = 0;
  write(file);
  const bool is_written = std::fflush(file) == 0 && std::ferror(file) == 0;
  const int write_error = errno;
  if (!is_stdout) std::fclose(file);
  if (!is_written) {
    throw OutputError(fmt::format("cannot write {}: {}", target, std::strerror(write_error)));
  }
}

void write_json(const Json& value, const std::string& target) {
  // Names of files need not be UTF-8, JSON must.
  const std::string text = value.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
  write_to(target, [&](std::FILE* file) { std::fwrite(text.data(), 1, text.size(), file); });
}

std::FILE* human_output(const std::string& json_target) {
  return json_target == "-" ? stderr : stdout;
}

}  // namespace faultline
