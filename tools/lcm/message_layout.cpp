#include "tools/lcm/message_layout.h"

namespace faultline {
namespace {

// The members up to the matching ')' of the first, which stands at layout[0] == '('.
std::string_view inner_layout(std::string_view layout) {
  std::size_t depth = 0;
  for (std::size_t i = 0; i < layout.size(); ++i) {
    depth += layout[i] == '(' ? 1U : 0U;
    depth -= layout[i] == ')' ? 1U : 0U;
    if (depth == 0) return layout.substr(1, i - 1);
  }
  return layout.substr(1);
}

class LayoutReader {
 public:
  explicit LayoutReader(std::span<const std::uint8_t> bytes) : bytes_(bytes) {}

  [[nodiscard]] std::size_t used() const { return used_; }

  bool read(std::string_view layout) {
    std::size_t count = 0;
    for (std::size_t i = 0; i < layout.size(); ++i) {
      bool is_there = true;
      switch (layout[i]) {
        case 'q':
          is_there = skip(1, 8);
          break;
        case 'i':
          is_there = skip(1, 4);
          break;
        case 'c':
          is_there = skip(1, 1);
          break;
        case 's':
          is_there = skip_string();
          break;
        case 'N':
          is_there = read_count(4, count);
          break;
        case 'L':
          is_there = read_count(1, count);
          break;
        case 'Q':
          is_there = skip(count, 8);
          break;
        case 'B':
          is_there = skip(count, 1);
          break;
        case 'S':
          is_there = repeat(count, "s");
          break;
        default: {  // '('
          const std::string_view inner = inner_layout(layout.substr(i));
          is_there = repeat(count, inner);
          i += inner.size() + 1;
        }
      }
      if (!is_there) return false;
    }
    return true;
  }

 private:
  [[nodiscard]] std::size_t left() const { return bytes_.size() - used_; }

  bool skip(std::size_t count, std::size_t size) {
    if (count > left() / size) return false;
    used_ += count * size;
    return true;
  }

  // Big-endian, as all of LCM.
  bool read_count(std::size_t size, std::size_t& count) {
    if (left() < size) return false;
    std::uint32_t value = 0;
    for (std::size_t i = 0; i < size; ++i) value = value << 8 | bytes_[used_ + i];
    used_ += size;
    count = value;
    return (value >> (8 * size - 1)) == 0;  // not negative
  }

  bool skip_string() {
    std::size_t length = 0;
    return read_count(4, length) && length > 0 && skip(length, 1) && bytes_[used_ - 1] == 0;
  }

  // Ends early: every member takes at least a byte.
  bool repeat(std::size_t count, std::string_view layout) {
    for (std::size_t i = 0; i < count; ++i) {
      if (!read(layout)) return false;
    }
    return true;
  }

  std::span<const std::uint8_t> bytes_;
  std::size_t used_ = 0;
};

}  // namespace

std::optional<std::size_t> laid_out_size(std::string_view layout,
                                         std::span<const std::uint8_t> bytes) {
  LayoutReader reader(bytes);
  if (!reader.read(layout)) return std::nullopt;
  return reader.used();
}

}  // namespace faultline
