#include "tools/campaign/run_pool.h"

#include <utility>

#include "tools/campaign/campaign_run.h"

namespace faultline {

RunPool::RunPool(const CampaignInputs& inputs, unsigned threads) : inputs_(&inputs) {
  for (unsigned i = 0; i < threads; ++i) threads_.emplace_back([this] { work(); });
}

RunPool::~RunPool() {
  {
    const std::lock_guard lock(mutex_);
    waiting_.clear();
    is_over_ = true;
  }
  has_work_.notify_all();
}

void RunPool::add(const std::vector<std::uint64_t>& runs) {
  {
    const std::lock_guard lock(mutex_);
    waiting_.insert(waiting_.end(), runs.begin(), runs.end());
  }
  has_work_.notify_all();
}

std::size_t RunPool::waiting() const {
  const std::lock_guard lock(mutex_);
  return waiting_.size();
}

std::vector<std::uint64_t> RunPool::forget() {
  const std::lock_guard lock(mutex_);
  std::vector<std::uint64_t> runs(waiting_.begin(), waiting_.end());
  waiting_.clear();
  return runs;
}

bool RunPool::is_idle() const {
  const std::lock_guard lock(mutex_);
  return waiting_.empty() && running_ == 0 && rows_.empty();
}

std::vector<CampaignRow> RunPool::take(std::chrono::milliseconds wait) {
  std::unique_lock lock(mutex_);
  has_rows_.wait_for(lock, wait, [this] { return is_half_done(); });
  return std::exchange(rows_, {});
}

void RunPool::work() {
  std::unique_lock lock(mutex_);
  for (;;) {
    has_work_.wait(lock, [this] { return is_over_ || !waiting_.empty(); });
    if (is_over_) return;
    const std::uint64_t run = waiting_.front();
    waiting_.pop_front();
    ++running_;
    lock.unlock();
    CampaignRow row = run_point(*inputs_, run);
    lock.lock();
    --running_;
    rows_.push_back(std::move(row));
    if (is_half_done()) has_rows_.notify_one();
  }
}

}  // namespace faultline
