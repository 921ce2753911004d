#include "tools/bench/stage_latencies.h"

#include <algorithm>

#include "drivers/signal/cycle_counter.h"

namespace faultline {

using std::chrono::nanoseconds;
using std::chrono::steady_clock;
using std::chrono::system_clock;

nanoseconds steady_clock_cost() noexcept {
  // The fastest of a few rounds: an interruption says nothing about the clock.
  constexpr int kRounds = 8;
  constexpr int kReads = 16;
  nanoseconds cost = nanoseconds::max();
  for (int round = 0; round < kRounds; ++round) {
    const auto begin = steady_clock::now();
    auto end = begin;
    for (int read = 0; read < kReads; ++read) end = steady_clock::now();
    cost = std::min<nanoseconds>(cost, (end - begin) / kReads);
  }
  return cost;
}

std::uint32_t cycles_per_timed_sample(nanoseconds clock_cost, nanoseconds period) noexcept {
  constexpr std::int64_t kReads = 4;  // RealtimeSink: decoded, stepped, decided, queued
  constexpr std::int64_t kShare = 100;
  constexpr std::int64_t kMost = 1000;
  if (period <= nanoseconds::zero()) return 1;
  const nanoseconds cost = kShare * kReads * clock_cost;
  return static_cast<std::uint32_t>(
      std::clamp<std::int64_t>((cost + period - nanoseconds(1)) / period, 1, kMost));
}

StageLatencies::StageLatencies(Nanoseconds period, std::uint32_t cycles_per_value, bool has_probe)
    : period_(period) {
  stages_ = {
      {.stage = "due->sent"},
      {.stage = "stamp->read"},
      {.stage = "read->decoded", .cycles_per_value = cycles_per_value},
      {.stage = "decoded->stepped", .cycles_per_value = cycles_per_value},
      {.stage = "stepped->decided", .cycles_per_value = cycles_per_value},
      {.stage = "decided->queued", .cycles_per_value = cycles_per_value},
      {.stage = "queued->published", .cycles_per_value = cycles_per_value},
      {.stage = "total", .cycles_per_value = cycles_per_value},
      {.stage = "end to end", .cycles_per_value = cycles_per_value},
  };
  if (has_probe) stages_.push_back({.stage = "probe: stamp->read"});
  compare_clocks();
}

void StageLatencies::compare_clocks() noexcept {
  // Of a few readings the one that was interrupted least.
  constexpr int kReadings = 3;
  Nanoseconds narrowest = Nanoseconds::max();
  for (int reading = 0; reading < kReadings; ++reading) {
    const auto before = steady_clock::now();
    const auto now = system_clock::now();
    const auto after = steady_clock::now();
    if (after - before >= narrowest) continue;
    narrowest = after - before;
    clock_offset_ = now.time_since_epoch() - (before + narrowest / 2).time_since_epoch();
  }
}

StageLatencies::Nanoseconds StageLatencies::since(Timestamp stamp, SteadyTime time) const noexcept {
  return time.time_since_epoch() + clock_offset_ - stamp.time_since_epoch();
}

void StageLatencies::on_sent(Nanoseconds since_due) noexcept {
  of(kDueSent).record_missed(since_due, period_, skipped_);
  skipped_ = 0;
}

void StageLatencies::on_probe(Timestamp stamp, SteadyTime read) noexcept {
  of(kProbe).record(since(stamp, read));
}

void StageLatencies::on_record(const DiagnosisRecord& record, const StageTimes& times,
                               SteadyTime published) {
  if (!times.is_closed_by_frame) return;
  if (times.has_stages) {
    of(kReadDecoded).record(times.decoded - times.read);
    of(kDecodedStepped).record(times.stepped - times.decoded);
    of(kSteppedDecided).record(times.decided - times.stepped);
    of(kDecidedQueued).record(times.queued - times.decided);
    of(kQueuedPublished).record(published - times.queued);
  }
  if (record.stamp != waiting_.stamp) settle();
  waiting_ = {.is_any = true,
              .is_timed = times.has_stages,
              .cycle = record.cycle,
              .stamp = record.stamp,
              .to_read = since(record.stamp, times.read),
              .to_queued = since(record.stamp, times.queued),
              .to_published = since(record.stamp, published)};
}

void StageLatencies::settle() noexcept {
  if (!waiting_.is_any) return;
  // Samples that the same frame closed, and cycles that were jumped over, were due one each period
  // before this one. More than the time that has passed they cannot be: a counter may start anew.
  std::uint64_t missed = 0;
  if (has_settled_) {
    const std::int64_t ahead = cycles_ahead(waiting_.cycle, settled_cycle_);
    const std::int64_t periods = (waiting_.stamp - settled_stamp_) / period_;
    missed = static_cast<std::uint64_t>(
        std::max<std::int64_t>(std::min<std::int64_t>(ahead - 1, periods), 0));
  }
  of(kStampRead).record_missed(waiting_.to_read, period_, missed);
  if (waiting_.is_timed) {
    of(kTotal).record_missed(waiting_.to_queued, period_, missed);
    of(kEndToEnd).record_missed(waiting_.to_published, period_, missed);
  }
  has_settled_ = true;
  settled_cycle_ = waiting_.cycle;
  settled_stamp_ = waiting_.stamp;
  waiting_ = {};
}

}  // namespace faultline
