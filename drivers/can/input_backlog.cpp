#include "drivers/can/input_backlog.h"

#include <algorithm>
#include <charconv>
#include <fstream>
#include <iterator>

namespace faultline {
namespace {

/// The second column of `line`, which is hexadecimal.
std::optional<std::uint32_t> second_column(std::string_view line) {
  const std::size_t begin = line.find(' ');
  if (begin == std::string_view::npos) return {};
  std::uint32_t value = 0;
  const char* const first = line.data() + begin + 1;
  const char* const last = line.data() + line.size();
  const auto [end, error] = std::from_chars(first, last, value, 16);
  if (error != std::errc() || (end != last && *end != ' ')) return {};
  return value;
}

}  // namespace

std::optional<std::uint64_t> read_backlog_drops(std::string_view softnet_stat) {
  std::optional<std::uint64_t> sum;
  while (!softnet_stat.empty()) {
    const std::string_view line = softnet_stat.substr(0, softnet_stat.find('\n'));
    softnet_stat.remove_prefix(std::min(line.size() + 1, softnet_stat.size()));
    const std::optional<std::uint32_t> drops = second_column(line);
    if (!drops) return {};
    sum = sum.value_or(0) + *drops;
  }
  return sum;
}

std::optional<std::uint64_t> input_backlog_drops() {
  std::ifstream file("/proc/net/softnet_stat");
  return read_backlog_drops(
      std::string(std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()));
}

std::uint64_t InputBacklogWatch::drops() const {
  const std::optional<std::uint64_t> now = input_backlog_drops();
  // Less than before: one of the counters has wrapped, and how much is lost nobody knows.
  return at_start_ && now && *now > *at_start_ ? *now - *at_start_ : 0;
}

std::string backlog_drops_text(std::uint64_t drops) {
  return "the kernel dropped " + std::to_string(drops) +
         " packets of its interfaces before any socket got them, its input backlog was full: " +
         std::string(kBacklogRemedy);
}

}  // namespace faultline
