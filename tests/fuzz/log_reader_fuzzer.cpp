// Fuzz target: LCM logs. Whatever comes, every byte is in an event or in a damage, once and in
// order, and a message that is measured whole decodes within its bytes.
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <stdexcept>
#include <string>
#include <vector>

#include <unistd.h>

#include <faultline/can_t.hpp>
#include <faultline/diagnosis_t.hpp>
#include <faultline/estimate_t.hpp>
#include <faultline/event_t.hpp>
#include <faultline/residual_t.hpp>
#include <faultline/run_t.hpp>
#include <faultline/sample_t.hpp>
#include <faultline/stats_t.hpp>
#include <faultline/truth_t.hpp>
#include <fmt/format.h>
#include <sys/mman.h>

#include "tools/lcm/frame_message.h"
#include "tools/lcm/log_reader.h"
#include "tools/lcm/message_type.h"

namespace {

using namespace faultline;

void require(bool holds) {
  if (!holds) std::abort();
}

/// Bytes as a file.
class MemoryFile {
 public:
  MemoryFile(const std::uint8_t* data, std::size_t size) : fd_(::memfd_create("log", 0)) {
    require(fd_ >= 0 && ::write(fd_, data, size) == static_cast<ssize_t>(size));
  }
  ~MemoryFile() { ::close(fd_); }
  MemoryFile(const MemoryFile&) = delete;
  MemoryFile& operator=(const MemoryFile&) = delete;
  [[nodiscard]] std::string name() const { return fmt::format("/proc/self/fd/{}", fd_); }

 private:
  int fd_;
};

/// A message that decodes takes as many bytes again as were measured.
template <class Message>
void check_message(const MessageType& type, std::span<const std::uint8_t> data) {
  // On the heap and just as long: a read beyond shows.
  const std::vector<std::uint8_t> alone(data.begin(), data.end());
  Message message;
  const bool is_decoded = decode_message(alone, type.layout, message);
  MessageHead head;
  const MessageStatus status = read_head(type, alone, head);
  if (status != MessageStatus::kWhole) return;
  require(is_decoded);
  require(message.utime == head.utime && message.sequence == head.sequence);
}

void check_frames(std::span<const std::uint8_t> data) {
  const std::vector<std::uint8_t> alone(data.begin(), data.end());
  FrameBatch batch;
  if (!decode_frames(alone, batch)) return;
  require(batch.frames.size() + batch.malformed == static_cast<std::size_t>(batch.frame_count));
  for (const CanFrame& frame : batch.frames) {
    require(is_well_formed(frame) && frame.bus == batch.bus);
    require(to_message(frame).length == frame.length);
  }
  can_t decoded;
  require(decode_message(alone, layout::kCan, decoded));
  require(decoded.first_frame == batch.first_frame && decoded.frame_count == batch.frame_count);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const MemoryFile file(data, size);
  std::uint64_t at = 0;
  std::size_t damage = 0;
  try {
    LogReader log(file.name());
    const auto pass_damages = [&] {
      for (; damage < log.damages().size(); ++damage) {
        require(log.damages()[damage].offset == at && log.damages()[damage].bytes > 0);
        at += log.damages()[damage].bytes;
      }
    };
    while (const LogEvent* event = log.next()) {
      pass_damages();
      require(event->offset == at && at + event->bytes.size() <= size);
      require(std::equal(event->bytes.begin(), event->bytes.end(), data + at));
      require(!event->channel.empty());
      at += event->bytes.size();
      const auto types = message_types();
      check_message<run_t>(types[0], event->data);
      check_message<can_t>(types[1], event->data);
      check_message<sample_t>(types[2], event->data);
      check_message<residual_t>(types[3], event->data);
      check_message<diagnosis_t>(types[4], event->data);
      check_message<estimate_t>(types[5], event->data);
      check_message<truth_t>(types[6], event->data);
      check_message<event_t>(types[7], event->data);
      check_message<stats_t>(types[8], event->data);
      check_frames(event->data);
    }
    pass_damages();
    require(at == size);
  } catch (const std::invalid_argument&) {
    require(at == 0);  // no log
  }
  return 0;
}
