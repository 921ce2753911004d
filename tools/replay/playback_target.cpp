#include "tools/replay/playback_target.h"

#include <exception>
#include <span>
#include <system_error>
#include <utility>

#include <fmt/format.h>

#include "drivers/can/open_bus.h"
#include "tools/lcm/message_sink.h"

namespace faultline {
namespace {

class BusTarget final : public PlaybackTarget {
 public:
  explicit BusTarget(std::unique_ptr<CanBus> bus) : bus_(std::move(bus)) {
    // It only sends: what others send must not fill its queue.
    bus_->set_filters(kNothing);
  }
  std::size_t send(const PlaybackChunk& chunk, const PlaybackItem& item) noexcept override {
    return bus_->send_batch(std::span(chunk.frames).subspan(item.begin, item.count));
  }
  [[nodiscard]] std::string refusal() const override {
    if (bus_->counters().send_errors == 0) return "";
    const int error = bus_->last_error();
    return fmt::format(
        "{}: {}", bus_->name(),
        error == 0 ? "a frame that this bus cannot carry" : std::generic_category().message(error));
  }

 private:
  /// A filter lets at least one identifier through; nobody uses this one.
  static constexpr IdFilter kNothing[] = {{.id = kMaxExtendedId, .is_extended = true}};
  std::unique_ptr<CanBus> bus_;
};

class LcmTarget final : public PlaybackTarget {
 public:
  explicit LcmTarget(std::unique_ptr<MessageSink> sink) : sink_(std::move(sink)) {}
  std::size_t send(const PlaybackChunk& chunk, const PlaybackItem& item) noexcept override {
    try {
      const auto* const channel = reinterpret_cast<const char*>(chunk.bytes.data() + item.channel);
      sink_->publish(channel, 0, std::span(chunk.bytes).subspan(item.begin, item.count));
      return 1;
    } catch (const std::exception& error) {
      if (refusal_.empty()) refusal_ = error.what();
      return 0;
    }
  }
  [[nodiscard]] std::string refusal() const override { return refusal_; }

 private:
  std::unique_ptr<MessageSink> sink_;
  std::string refusal_;
};

}  // namespace

std::unique_ptr<PlaybackTarget> open_bus_target(const std::string& buses) {
  return std::make_unique<BusTarget>(open_bus(buses));
}

std::unique_ptr<PlaybackTarget> open_lcm_target(const std::string& url) {
  return std::make_unique<LcmTarget>(open_live(url));
}

}  // namespace faultline
