#include "tools/lcm/lcm_source.h"

#include <cerrno>
#include <exception>
#include <utility>

#include <fmt/format.h>
#include <lcm/lcm.h>

#include "tools/lcm/lcm_url.h"

namespace faultline {
namespace {

/// A socket's own default holds some 100 messages of a bench. The kernel grants what
/// net.core.rmem_max allows.
constexpr int kReceiveBuffer = 4 << 20;

/// With a larger receive buffer where the URL is silent about it.
std::string with_receive_buffer(const std::string& url) {
  if (!url.starts_with("udpm://") || url.find("recv_buf_size=") != std::string::npos) return url;
  const char separator = url.find('?') == std::string::npos ? '?' : '&';
  return fmt::format("{}{}recv_buf_size={}", url, separator, kReceiveBuffer);
}

}  // namespace

struct LcmSource::State {
  std::string url;
  lcm_t* lcm = nullptr;
  const std::function<void(const LiveMessage&)>* on_message = nullptr;
  std::exception_ptr error;

  ~State() {
    if (lcm != nullptr) lcm_destroy(lcm);
  }

  /// Called by liblcm, which is C: no exception may pass.
  static void on_event(const lcm_recv_buf_t* buffer, const char* channel, void* user) {
    auto& state = *static_cast<State*>(user);
    try {
      const auto* const bytes = static_cast<const std::uint8_t*>(buffer->data);
      (*state.on_message)({.channel = channel,
                           .utime = buffer->recv_utime,
                           .data = {bytes, static_cast<std::size_t>(buffer->data_size)}});
    } catch (...) {
      state.error = std::current_exception();
    }
  }
};

LcmSource::LcmSource(const std::string& url, const std::string& channels, int queue)
    : state_(std::make_unique<State>()) {
  check_live_lcm_url(url);
  state_->url = url;
  state_->lcm = lcm_create(with_receive_buffer(url).c_str());
  if (state_->lcm == nullptr) throw MessageSourceError(lcm_refusal_text(url));
  lcm_subscription_t* const subscription =
      lcm_subscribe(state_->lcm, channels.c_str(), &State::on_event, state_.get());
  if (subscription == nullptr) throw MessageSourceError(lcm_refusal_text(url));
  lcm_subscription_set_queue_capacity(subscription, queue);
}

LcmSource::~LcmSource() = default;

std::size_t LcmSource::receive(std::chrono::milliseconds timeout,
                               const std::function<void(const LiveMessage&)>& on_message) {
  state_->on_message = &on_message;
  std::size_t count = 0;
  auto wait = static_cast<int>(timeout.count());
  for (; count < kBatch; ++count, wait = 0) {
    errno = 0;
    const int handled = lcm_handle_timeout(state_->lcm, wait);
    if (state_->error) std::rethrow_exception(std::exchange(state_->error, nullptr));
    if (handled < 0 && errno == EINTR) break;  // a signal: the caller looks which
    if (handled < 0) {
      throw MessageSourceError(fmt::format("LCM {}: cannot receive any more", state_->url));
    }
    if (handled == 0) break;
  }
  return count;
}

}  // namespace faultline
