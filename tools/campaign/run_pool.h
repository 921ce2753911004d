#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <mutex>
#include <thread>
#include <vector>

#include "tools/campaign/campaign_inputs.h"
#include "tools/campaign/campaign_row.h"

namespace faultline {

/// Threads that do runs of a campaign: numbers in, rows out, in whatever order.
class RunPool {
 public:
  RunPool(const CampaignInputs& inputs, unsigned threads);
  /// Runs that have not begun are forgotten; waits for the others.
  ~RunPool();
  RunPool(const RunPool&) = delete;
  RunPool& operator=(const RunPool&) = delete;

  void add(const std::vector<std::uint64_t>& runs);
  /// Runs that have not begun.
  [[nodiscard]] std::size_t waiting() const;
  /// Forgets them. @return what was forgotten
  std::vector<std::uint64_t> forget();
  /// True if no run waits, is going on, or is done and not taken.
  [[nodiscard]] bool is_idle() const;
  /// Rows since the last call; waits until half of the runs in hand are done, at most so long. Not
  /// for every row: a caller that wakes so often takes the time of the threads.
  [[nodiscard]] std::vector<CampaignRow> take(std::chrono::milliseconds wait);

 private:
  void work();
  /// As many rows as runs that wait, and at least one. Called with mutex_ held.
  [[nodiscard]] bool is_half_done() const noexcept {
    return !rows_.empty() && rows_.size() >= waiting_.size();
  }

  const CampaignInputs* inputs_;
  mutable std::mutex mutex_;
  std::condition_variable has_work_, has_rows_;
  std::deque<std::uint64_t> waiting_;
  std::vector<CampaignRow> rows_;
  std::size_t running_ = 0;
  bool is_over_ = false;
  std::vector<std::jthread> threads_;
};

}  // namespace faultline
