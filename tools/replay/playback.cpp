#include "tools/replay/playback.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <condition_variable>
#include <exception>
#include <limits>
#include <mutex>
#include <thread>
#include <utility>

#include "tools/bench/realtime_thread.h"
#include "tools/bench/stop_signal.h"
#include "tools/replay/playback_queue.h"

namespace faultline {
namespace {

using std::chrono::steady_clock;
using Nanoseconds = std::chrono::nanoseconds;

/// A chunk is handed over when it holds so much.
constexpr std::size_t kItemsPerChunk = 512;
constexpr std::size_t kBytesPerChunk = std::size_t{1} << 20;
/// The first deadline is so far ahead: all threads are up by then, and the first chunks are read.
constexpr auto kLead = std::chrono::milliseconds(100);
/// Longest sleep of the sender before it looks whether it shall stop.
constexpr auto kLongestSleep = std::chrono::milliseconds(50);
constexpr auto kProgressPeriod = std::chrono::milliseconds(100);
constexpr std::int64_t kFarthest_ns = std::numeric_limits<std::int64_t>::max() / 2;
/// Below the diagnosis of a bench on the same machine.
constexpr int kPriority = 60;

double to_s(std::int64_t ns) { return static_cast<double>(ns) * 1e-9; }

/// Reads a log into a queue, pass after pass, on a thread of its own.
class ReadAhead {
 public:
  ReadAhead(const PlaybackLog& log, std::uint64_t passes)
      : log_(&log), passes_(passes), thread_([this] { run(); }) {}
  ~ReadAhead() {
    queue_.stop();
    thread_.join();
  }
  ReadAhead(const ReadAhead&) = delete;
  ReadAhead& operator=(const ReadAhead&) = delete;

  PlaybackQueue& queue() noexcept { return queue_; }
  /// What ended the reading early. @pre `next` of the queue has returned nothing
  void rethrow() const {
    if (error_) std::rethrow_exception(error_);
  }

 private:
  void run() {
    try {
      bool goes_on = begin_chunk();
      const std::int64_t period = log_->period_ns();
      std::int64_t offset = 0;
      for (std::uint64_t pass = 0; goes_on && (passes_ == 0 || pass < passes_); ++pass) {
        log_->read({.on_frame =
                        [&](std::int64_t at_ns, const CanFrame& frame) {
                          return goes_on = add_frame(offset + at_ns - log_->from_ns(), frame);
                        },
                    .on_message =
                        [&](std::int64_t at_ns, std::string_view channel,
                            std::span<const std::uint8_t> data) {
                          return goes_on =
                                     add_message(offset + at_ns - log_->from_ns(), channel, data);
                        }});
        // Another pass would end beyond what times can say, centuries from here.
        if (offset > kFarthest_ns - period) break;
        offset += period;
      }
      if (goes_on) queue_.push(std::move(chunk_));
    } catch (...) {
      error_ = std::current_exception();
    }
    queue_.finish();
  }

  bool begin_chunk() {
    auto chunk = queue_.take_empty();
    if (chunk) chunk_ = std::move(*chunk);
    return chunk.has_value();
  }

  bool make_room() {
    const bool is_full =
        chunk_.items.size() >= kItemsPerChunk ||
        chunk_.bytes.size() + chunk_.frames.size() * sizeof(CanFrame) >= kBytesPerChunk;
    if (!is_full) return true;
    queue_.push(std::move(chunk_));
    return begin_chunk();
  }

  bool add_frame(std::int64_t at_ns, const CanFrame& frame) {
    if (!make_room()) return false;
    if (chunk_.items.empty() || chunk_.items.back().at_ns != at_ns) {
      chunk_.items.push_back(
          {.at_ns = at_ns, .begin = static_cast<std::uint32_t>(chunk_.frames.size())});
    }
    chunk_.frames.push_back(frame);
    ++chunk_.items.back().count;
    return true;
  }

  bool add_message(std::int64_t at_ns, std::string_view channel,
                   std::span<const std::uint8_t> data) {
    if (!make_room()) return false;
    std::vector<std::uint8_t>& bytes = chunk_.bytes;
    PlaybackItem item{.at_ns = at_ns, .channel = static_cast<std::uint32_t>(bytes.size())};
    bytes.insert(bytes.end(), channel.begin(), channel.end());
    bytes.push_back(0);
    item.begin = static_cast<std::uint32_t>(bytes.size());
    item.count = static_cast<std::uint32_t>(data.size());
    bytes.insert(bytes.end(), data.begin(), data.end());
    chunk_.items.push_back(item);
    return true;
  }

  const PlaybackLog* log_;
  std::uint64_t passes_;
  PlaybackQueue queue_;
  PlaybackChunk chunk_;
  std::exception_ptr error_;
  std::thread thread_;  // last: it uses the others
};

std::size_t units_in(const PlaybackItem& item, bool is_as_messages) {
  return is_as_messages ? 1 : item.count;
}

/// The time in the log and the pass that a time of the playback belongs to.
PlaybackProgress progress_at(const PlaybackLog& log, std::int64_t at_ns, std::uint64_t passes) {
  const std::int64_t period = std::max<std::int64_t>(log.period_ns(), 1);
  const std::int64_t pass = passes == 1 ? 0 : at_ns / period;
  return {.at_s = to_s(log.from_ns() + at_ns - pass * period),
          .pass = static_cast<std::uint64_t>(pass) + 1};
}

/// Passes that came to their end, by what was sent of each.
std::uint64_t passes_done(const PlaybackLog& log, const PlaybackResult& result) {
  return (result.sent + result.refused) / log.outline().units;
}

void complete(const PlaybackLog& log, PlaybackResult& result, steady_clock::time_point begin) {
  result.passes = passes_done(log, result);
  result.wall_s = std::chrono::duration<double>(steady_clock::now() - begin).count();
}

/// Sends at deadlines on a thread of its own while the calling one watches.
class Player {
 public:
  Player(const PlaybackLog& log, PlaybackTarget& target, const PlaybackOptions& options)
      : log_(&log), target_(&target), options_(options), ahead_(log, options.passes) {}

  PlaybackResult run(const std::function<void(const PlaybackProgress&)>& on_progress) {
    StopSignal stop;
    std::optional<RealtimeProcess> process;
    if (options_.speed > 0.0) process.emplace();
    start_ = steady_clock::now();
    if (options_.speed > 0.0) start_ += kLead;
    std::thread sender([this] { send_all(); });
    try {
      watch(stop, on_progress);
    } catch (...) {
      // Join before unwinding: the thread uses what is about to be destroyed.
      must_stop_ = true;
      ahead_.queue().stop();
      sender.join();
      throw;
    }
    sender.join();
    if (result_.signal == 0) ahead_.rethrow();
    complete(*log_, result_, start_);
    if (process) add_problems(process->problems());
    return std::move(result_);
  }

 private:
  void watch(StopSignal& stop, const std::function<void(const PlaybackProgress&)>& on_progress) {
    std::unique_lock lock(mutex_);
    while (!over_.wait_for(lock, kProgressPeriod, [this] { return is_over_; })) {
      result_.signal = stop.poll();
      if (result_.signal != 0) {
        must_stop_ = true;
        ahead_.queue().stop();
      }
      PlaybackProgress progress = progress_at(*log_, at_ns_, options_.passes);
      progress.sent = sent_;
      progress.silence_s = silence_s();
      on_progress(progress);
    }
    if (result_.signal == 0) result_.signal = stop.poll();
  }

  void add_problems(const std::vector<RealtimeProblem>& problems) {
    for (const RealtimeProblem& problem : problems) {
      result_.realtime_problems.push_back(to_text(problem));
    }
  }

  [[nodiscard]] double silence_s() const {
    const auto left = next_deadline_.load() - steady_clock::now().time_since_epoch();
    return std::max(std::chrono::duration<double>(left).count(), 0.0);
  }

  void send_all() {
    if (options_.speed > 0.0) {
      add_problems(make_thread_realtime("play", kPriority, std::nullopt));
    }
    std::optional<PlaybackChunk> chunk = ahead_.queue().next({});
    while (chunk && send(*chunk)) chunk = ahead_.queue().next(std::move(*chunk));
    const std::lock_guard lock(mutex_);
    is_over_ = true;
    over_.notify_all();
  }

  /// @return false if it shall stop.
  bool send(const PlaybackChunk& chunk) {
    for (const PlaybackItem& item : chunk.items) {
      if (options_.speed > 0.0) {
        const auto deadline = deadline_of(item.at_ns);
        if (!wait_until(deadline)) return false;
        const Nanoseconds late = steady_clock::now() - deadline;
        send(chunk, item);
        result_.lateness.record(late);
        if (late > PlaybackResult::kLate) ++result_.late;
      } else {
        if (must_stop_) return false;
        send(chunk, item);
      }
      at_ns_ = item.at_ns;
    }
    return true;
  }

  void send(const PlaybackChunk& chunk, const PlaybackItem& item) {
    const std::size_t taken = target_->send(chunk, item);
    result_.sent += taken;
    result_.refused += units_in(item, log_->selection().is_as_messages) - taken;
    sent_ = result_.sent;
  }

  [[nodiscard]] steady_clock::time_point deadline_of(std::int64_t at_ns) const {
    if (options_.speed == 1.0) return start_ + Nanoseconds(at_ns);
    // Exact to a nanosecond for 104 days; further than time itself at speeds next to nothing.
    constexpr double kLatest_ns = 9e18;
    const double scaled = static_cast<double>(at_ns) / options_.speed;
    const auto since_epoch = static_cast<double>(start_.time_since_epoch().count());
    return start_ + Nanoseconds(std::llround(std::min(scaled, kLatest_ns - since_epoch)));
  }

  bool wait_until(steady_clock::time_point deadline) {
    next_deadline_ = deadline.time_since_epoch();
    for (auto now = steady_clock::now(); now < deadline; now = steady_clock::now()) {
      if (must_stop_) return false;
      sleep_until(deadline - now > kLongestSleep ? now + kLongestSleep : deadline);
    }
    return !must_stop_;
  }

  const PlaybackLog* log_;
  PlaybackTarget* target_;
  PlaybackOptions options_;
  ReadAhead ahead_;
  PlaybackResult result_;
  steady_clock::time_point start_;
  std::atomic<bool> must_stop_{false};
  std::atomic<std::int64_t> at_ns_{0};
  std::atomic<std::uint64_t> sent_{0};
  std::atomic<Nanoseconds> next_deadline_{Nanoseconds::zero()};
  std::mutex mutex_;
  std::condition_variable over_;
  bool is_over_ = false;
};

}  // namespace

PlaybackResult play(const PlaybackLog& log, PlaybackTarget& target, const PlaybackOptions& options,
                    const std::function<void(const PlaybackProgress&)>& on_progress) {
  return Player(log, target, options).run(on_progress);
}

PlaybackResult play_stepwise(const PlaybackLog& log, PlaybackTarget& target,
                             const PlaybackOptions& options,
                             const std::function<std::uint64_t()>& ask,
                             const std::function<void(const PlaybackProgress&)>& on_group) {
  const auto begin = steady_clock::now();
  ReadAhead ahead(log, options.passes);
  PlaybackResult result;
  std::uint64_t left = 0;
  std::int64_t group_ns = 0;  // of the group that is being sent
  bool is_in_group = false;
  const auto end_group = [&] {
    PlaybackProgress progress = progress_at(log, group_ns, options.passes);
    progress.sent = result.sent;
    on_group(progress);
    is_in_group = false;
    --left;
  };
  bool goes_on = true;
  std::optional<PlaybackChunk> chunk = ahead.queue().next({});
  while (goes_on && chunk) {
    for (const PlaybackItem& item : chunk->items) {
      if (is_in_group && group_ns != item.at_ns) end_group();
      if (left == 0) left = ask();
      goes_on = left > 0;
      if (!goes_on) break;
      group_ns = item.at_ns;
      is_in_group = true;
      const std::size_t taken = target.send(*chunk, item);
      result.sent += taken;
      result.refused += units_in(item, log.selection().is_as_messages) - taken;
    }
    if (goes_on) chunk = ahead.queue().next(std::move(*chunk));
  }
  if (is_in_group) end_group();
  if (goes_on) ahead.rethrow();
  complete(log, result, begin);
  return result;
}

}  // namespace faultline
