#include "tools/replay/playback_queue.h"

#include <utility>

namespace faultline {

std::optional<PlaybackChunk> PlaybackQueue::take_empty() {
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [this] { return is_stopped_ || filled_.size() < kCapacity; });
  if (is_stopped_) return std::nullopt;
  if (empty_.empty()) return PlaybackChunk{};
  PlaybackChunk chunk = std::move(empty_.back());
  empty_.pop_back();
  return chunk;
}

void PlaybackQueue::push(PlaybackChunk chunk) {
  const std::lock_guard lock(mutex_);
  filled_.push_back(std::move(chunk));
  changed_.notify_all();
}

void PlaybackQueue::finish() {
  const std::lock_guard lock(mutex_);
  is_finished_ = true;
  changed_.notify_all();
}

void PlaybackQueue::stop() {
  const std::lock_guard lock(mutex_);
  is_stopped_ = true;
  changed_.notify_all();
}

std::optional<PlaybackChunk> PlaybackQueue::next(PlaybackChunk done) {
  done.clear();
  std::unique_lock lock(mutex_);
  if (empty_.size() <= kCapacity) empty_.push_back(std::move(done));
  changed_.wait(lock, [this] { return is_stopped_ || is_finished_ || !filled_.empty(); });
  if (is_stopped_ || filled_.empty()) return std::nullopt;
  PlaybackChunk chunk = std::move(filled_.front());
  filled_.pop_front();
  changed_.notify_all();
  return chunk;
}

}  // namespace faultline
