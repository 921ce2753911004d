#include "tools/lcm/log_reader.h"

#include <algorithm>
#include <bit>
#include <cerrno>
#include <cstring>
#include <stdexcept>
#include <system_error>

#include <fcntl.h>
#include <unistd.h>

#include <fmt/format.h>
#include <sys/stat.h>

namespace faultline {
namespace {

/// Magic, event number, utime, lengths of channel and data (lcm/eventlog.c), big-endian.
constexpr std::size_t kHeaderBytes = 4 + 8 + 8 + 4 + 4;
constexpr std::size_t kNumberAt = 4, kUtimeAt = 12, kChannelBytesAt = 20, kDataBytesAt = 24;
/// Read at a time, and searched for a first event.
constexpr std::size_t kChunk = std::size_t{1} << 20;

template <class Integer>
Integer load_big_endian(const std::uint8_t* bytes) noexcept {
  Integer value;
  std::memcpy(&value, bytes, sizeof value);
  if constexpr (std::endian::native == std::endian::little) {
    if constexpr (sizeof value == 8)
      return static_cast<Integer>(__builtin_bswap64(static_cast<std::uint64_t>(value)));
    return static_cast<Integer>(__builtin_bswap32(static_cast<std::uint32_t>(value)));
  }
  return value;
}

}  // namespace

std::string describe(const std::string& file, const LogDamage& damage) {
  return fmt::format("{}: byte {}: {}; {} bytes passed over{}", file, damage.offset, damage.what,
                     damage.bytes, damage.is_end ? ", the end of the log" : "");
}

std::size_t LogReader::Header::total() const noexcept {
  return kHeaderBytes + channel_bytes + data_bytes;
}

LogReader::LogReader(const std::filesystem::path& file) : name_(file.string()), buffer_(kChunk) {
  const bool is_stdin = name_ == "-";
  if (is_stdin) name_ = "stdin";
  fd_ = is_stdin ? STDIN_FILENO : ::open(file.c_str(), O_RDONLY | O_CLOEXEC);
  struct stat status {};
  if (fd_ < 0 || ::fstat(fd_, &status) != 0 || S_ISDIR(status.st_mode)) {
    const int error = fd_ < 0 || !S_ISDIR(status.st_mode) ? errno : EISDIR;
    if (fd_ > STDIN_FILENO) ::close(fd_);
    throw std::system_error(error, std::generic_category(), "cannot read " + name_);
  }
  if (S_ISREG(status.st_mode)) size_ = static_cast<std::uint64_t>(status.st_size);
  try {
    if (!is_event_at(0)) {
      has(kChunk);
      // One that is cut off is an event, too: of a log that was cut short.
      if (!find_magic(0, kChunk)) {
        throw std::invalid_argument(fmt::format("{}: found no LCM event{}, expected an LCM log",
                                                name_,
                                                held() == 0 ? " (it is empty)" : " at its start"));
      }
    }
  } catch (...) {
    if (fd_ > STDIN_FILENO) ::close(fd_);
    throw;
  }
}

LogReader::~LogReader() {
  if (fd_ > STDIN_FILENO) ::close(fd_);
}

bool LogReader::has(std::size_t count) {
  while (held() < count && !is_at_end_) {
    if (end_ == buffer_.size()) {
      // Moved only behind half a buffer of progress, and grown only by what came: neither costs
      // more than reading, whatever lengths a damaged log asks for.
      if (begin_ >= buffer_.size() / 2) {
        std::memmove(buffer_.data(), at(0), held());
        end_ -= begin_;
        begin_ = 0;
      } else {
        buffer_.resize(2 * buffer_.size());
      }
    }
    const ssize_t got = ::read(fd_, buffer_.data() + end_, buffer_.size() - end_);
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) throw std::system_error(errno, std::generic_category(), "cannot read " + name_);
    is_at_end_ = got == 0;
    end_ += static_cast<std::size_t>(got);
  }
  return held() >= count;
}

void LogReader::consume(std::size_t count) noexcept {
  begin_ += count;
  offset_ += count;
}

bool LogReader::is_magic_at(std::size_t index) const noexcept {
  return held() >= index + kLogMagic.size() &&
         std::memcmp(at(index), kLogMagic.data(), kLogMagic.size()) == 0;
}

std::optional<LogReader::Header> LogReader::header_at(std::size_t index) {
  if (!has(index + kHeaderBytes) || !is_magic_at(index)) return std::nullopt;
  const auto channel_bytes = load_big_endian<std::int32_t>(at(index + kChannelBytesAt));
  const auto data_bytes = load_big_endian<std::int32_t>(at(index + kDataBytesAt));
  if (channel_bytes <= 0 || data_bytes < 0) return std::nullopt;
  const Header header{static_cast<std::size_t>(channel_bytes),
                      static_cast<std::size_t>(data_bytes)};
  if (header.channel_bytes > kLongestChannel || header.data_bytes > kLongestMessage) {
    return std::nullopt;
  }
  return header;
}

bool LogReader::is_event_at(std::size_t index) {
  const auto header = header_at(index);
  if (!header) return false;
  const std::size_t end = index + header->total();
  if (has(end + kLogMagic.size())) return is_magic_at(end);
  // The log ends with it, or in the first bytes of the next.
  return held() >= end && std::memcmp(at(end), kLogMagic.data(), held() - end) == 0;
}

bool LogReader::is_plausible_at(std::size_t index, const Header& header) {
  if (!has(index + header.total())) return false;
  const std::uint8_t* const name = at(index + kHeaderBytes);
  return std::all_of(name, name + header.channel_bytes,
                     [](std::uint8_t byte) { return byte >= ' ' && byte != 0x7F; });
}

std::optional<std::size_t> LogReader::find_magic(std::size_t from, std::size_t until) {
  for (std::size_t index = from; index < std::min(until, held()); ++index) {
    const void* const found = std::memchr(at(index), static_cast<unsigned char>(kLogMagic[0]),
                                          std::min(until, held()) - index);
    if (found == nullptr) return std::nullopt;
    index = static_cast<std::size_t>(static_cast<const std::uint8_t*>(found) - at(0));
    if (has(index + kLogMagic.size()) && is_magic_at(index)) return index;
  }
  return std::nullopt;
}

std::optional<std::size_t> LogReader::find_event(std::size_t from, std::size_t until) {
  for (auto index = find_magic(from, until); index; index = find_magic(*index + 1, until)) {
    if (is_event_at(*index)) return index;
  }
  return std::nullopt;
}

/// From the position, where no whole event begins, to the next one or to the end. Every byte is
/// looked at once, and every magic costs one look at its lengths and at what they lead to.
void LogReader::skip_damage() {
  const std::uint64_t from = offset_;
  const char* const what =
      is_magic_at(0) ? "an event that is cut off" : "no event where one should begin";
  // A whole event that damage follows: taken if no event that is surely one begins inside it.
  struct {
    std::size_t begin = 0, end = 0;
  } lone;
  bool is_end = false;
  for (std::size_t searched = 1;;) {
    if (lone.end == 0 && searched >= kChunk) {
      consume(searched);
      searched = 0;
    }
    const std::size_t until = lone.end > 0 ? lone.end : searched + kChunk;
    has(until);
    const auto index = find_magic(searched, until);
    if (!index && lone.end > 0) {
      consume(lone.begin);
      break;
    }
    if (!index) {
      is_end = held() <= until && is_at_end_;
      consume(std::min(until, held()));
      searched = 0;
      if (is_end) break;
      continue;
    }
    if (is_event_at(*index)) {
      consume(*index);
      break;
    }
    if (const auto header = header_at(*index); header && is_plausible_at(*index, *header)) {
      const std::size_t end = *index + header->total();
      if (lone.end == 0 || end < lone.end) lone = {*index, end};
    }
    searched = *index + 1;
  }
  damages_.push_back({from, offset_ - from, what, is_end});
}

const LogEvent* LogReader::next() {
  consume(event_bytes_);
  event_bytes_ = 0;
  for (;;) {
    if (!has(1)) return nullptr;
    const auto header = header_at(0);
    if (!header || !has(header->total())) {
      skip_damage();
      continue;
    }
    const std::size_t total = header->total();
    // Lengths that do not lead to the next event: either bytes are missing here, and an event
    // begins inside, or what follows is damaged.
    if (has(total + 1) && !is_event_at(0)) {
      if (const auto inside = find_event(1, total)) {
        damages_.push_back({offset_, *inside, "an event that is cut off", false});
        consume(*inside);
        continue;
      }
    }
    event_.offset = offset_;
    event_.number = load_big_endian<std::int64_t>(at(kNumberAt));
    event_.utime = load_big_endian<std::int64_t>(at(kUtimeAt));
    event_.channel = {reinterpret_cast<const char*>(at(kHeaderBytes)), header->channel_bytes};
    event_.data = {at(kHeaderBytes + header->channel_bytes), header->data_bytes};
    event_.bytes = {at(0), total};
    event_bytes_ = total;
    return &event_;
  }
}

}  // namespace faultline
