#include "tools/campaign/campaign.h"

#include <algorithm>
#include <charconv>
#include <chrono>
#include <set>
#include <sstream>
#include <stdexcept>
#include <utility>

#include <fmt/format.h>

#include "tools/bench/stop_signal.h"
#include "tools/campaign/run_pool.h"

namespace faultline {
namespace {

using std::chrono::milliseconds;
using std::chrono::steady_clock;

/// Runs in hand per thread: enough that none waits for the next while rows are written.
constexpr std::size_t kStockPerThread = 32;
constexpr milliseconds kCommitPeriod{250};
constexpr milliseconds kProgressPeriod{200};
/// How long the main thread sleeps when there is nothing to do: alone, and with ranks that ask.
constexpr milliseconds kAlonePeriod{50};
constexpr milliseconds kRanksPeriod{2};

// Between ranks: "DIGEST WANTED\n", then a row per line, to rank 0; numbers separated by blanks, or
// "end", from it. A rank asks again only when it has its answer.
constexpr char kEnd[] = "end";

std::string request_text(const std::string& digest, std::size_t wanted,
                         const std::vector<CampaignRow>& rows) {
  std::string text = fmt::format("{} {}\n", digest, wanted);
  for (const CampaignRow& row : rows) text += row_text(row) + '\n';
  return text;
}

/// Runs that are still to be handed out, in order.
class Pending {
 public:
  Pending(const std::vector<bool>& done, const Shard& shard) {
    for (std::uint64_t run = 0; run < done.size(); ++run) {
      if (!shard.has(run)) continue;
      ++total_;
      if (!done[run]) runs_.push_back(run);
    }
    remaining_ = runs_.size();
  }
  [[nodiscard]] std::vector<std::uint64_t> take(std::size_t count) {
    const std::size_t taken = std::min(count, remaining_);
    const auto first = runs_.end() - static_cast<std::ptrdiff_t>(remaining_);
    std::vector<std::uint64_t> runs(first, first + static_cast<std::ptrdiff_t>(taken));
    remaining_ -= taken;
    return runs;
  }
  void stop() noexcept { remaining_ = 0; }
  [[nodiscard]] std::size_t remaining() const noexcept { return remaining_; }
  [[nodiscard]] std::uint64_t total() const noexcept { return total_; }
  [[nodiscard]] std::uint64_t missing() const noexcept { return runs_.size(); }

 private:
  std::vector<std::uint64_t> runs_;
  std::size_t remaining_ = 0;
  std::uint64_t total_ = 0;
};

/// Rank 0, or the only process.
class Coordinator {
 public:
  Coordinator(const CampaignInputs& inputs, CampaignDatabase& database,
              const CampaignOptions& options, RankLink* link)
      : inputs_(inputs),
        database_(database),
        options_(options),
        link_(link),
        pending_(database.done(), options.shard),
        pool_(inputs, options.threads) {
    progress_.total = pending_.total();
    progress_.done = progress_.total - pending_.missing();
    for (int rank = 1; link_ != nullptr && rank < link_->size(); ++rank) ranks_.insert(rank);
  }

  CampaignResult run() {
    const auto start = steady_clock::now();
    auto next_commit = start, next_progress = start;
    while (pending_.remaining() > 0 || !pool_.is_idle() || !ranks_.empty() || !rows_.empty()) {
      stock();
      keep(pool_.take(link_ == nullptr ? kAlonePeriod : kRanksPeriod));
      serve_ranks();
      const auto now = steady_clock::now();
      progress_.wall_s = std::chrono::duration<double>(now - start).count();
      const bool is_over = pending_.remaining() == 0 && pool_.is_idle() && ranks_.empty();
      if (now >= next_commit || is_over) {
        commit();
        next_commit = now + kCommitPeriod;
      }
      if (options_.on_progress && (now >= next_progress || is_over)) {
        options_.on_progress(progress_);
        next_progress = now + kProgressPeriod;
      }
      if (signal_ == 0 && (signal_ = stop_signal_.poll()) != 0) {
        pending_.stop();
        static_cast<void>(pool_.forget());
      }
    }
    return {progress_, signal_};
  }

 private:
  void stock() {
    const std::size_t wanted = options_.threads * fair_stock();
    const std::size_t waiting = pool_.waiting();
    if (waiting < wanted) pool_.add(pending_.take(wanted - waiting));
  }

  /// Runs in hand per thread: fewer towards the end, so that all threads end together.
  [[nodiscard]] std::size_t fair_stock() const {
    const std::size_t workers = options_.threads * (ranks_.size() + 1);
    return std::clamp<std::size_t>(pending_.remaining() / (2 * workers), 1, kStockPerThread);
  }

  void keep(std::vector<CampaignRow> rows) {
    progress_.done += rows.size();
    progress_.done_here += rows.size();
    std::move(rows.begin(), rows.end(), std::back_inserter(rows_));
  }

  void commit() {
    database_.insert(rows_);
    rows_.clear();
  }

  void serve_ranks() {
    while (link_ != nullptr && !ranks_.empty()) {
      const auto message = link_->receive();
      if (!message) return;
      std::istringstream lines(message->text);
      std::string digest, line;
      std::size_t wanted = 0;
      lines >> digest >> wanted;
      std::getline(lines, line);
      if (digest != inputs_.digest()) {
        throw std::runtime_error(
            fmt::format("rank {}: found a sweep, scenario, plant, bank or DBC with another digest "
                        "than on rank 0, expected the same files on all machines",
                        message->from));
      }
      std::vector<CampaignRow> rows;
      while (std::getline(lines, line)) rows.push_back(row_of_text(line));
      keep(std::move(rows));
      reply(message->from, wanted);
    }
  }

  void reply(int rank, std::size_t wanted) {
    const std::size_t share = std::max(wanted / kStockPerThread, std::size_t{1}) * fair_stock();
    const auto runs = pending_.take(std::min(wanted, share));
    if (runs.empty() && wanted > 0) {
      link_->send(rank, kEnd);
    } else if (wanted == 0) {  // its last rows
      ranks_.erase(rank);
    } else {
      link_->send(rank, fmt::format("{}", fmt::join(runs, " ")));
    }
  }

  const CampaignInputs& inputs_;
  CampaignDatabase& database_;
  const CampaignOptions& options_;
  RankLink* link_;
  StopSignal stop_signal_;
  Pending pending_;
  CampaignProgress progress_;
  std::vector<CampaignRow> rows_;  // not committed
  std::set<int> ranks_;            // that have not said their last
  int signal_ = 0;
  RunPool pool_;
};

}  // namespace

CampaignResult run_campaign(const CampaignInputs& inputs, CampaignDatabase& database,
                            const CampaignOptions& options, RankLink* link) {
  return Coordinator(inputs, database, options, link).run();
}

void serve_campaign(const CampaignInputs& inputs, unsigned threads, RankLink& link) {
  StopSignal stop_signal;  // rank 0 says when it is over
  RunPool pool(inputs, threads);
  std::vector<CampaignRow> rows;
  const std::size_t stock = threads * kStockPerThread;
  bool is_waiting = false;
  bool is_over = false;
  while (!is_over || !pool.is_idle()) {
    auto done = pool.take(kRanksPeriod);
    std::move(done.begin(), done.end(), std::back_inserter(rows));
    static_cast<void>(stop_signal.poll());
    if (!is_over && !is_waiting && pool.waiting() <= stock / 2) {
      link.send(0, request_text(inputs.digest(), stock - pool.waiting(), rows));
      rows.clear();
      is_waiting = true;
    }
    const auto message = link.receive();
    if (!message) continue;
    is_waiting = false;
    if (message->text == kEnd) {
      is_over = true;
      continue;
    }
    std::istringstream numbers(message->text);
    std::vector<std::uint64_t> runs;
    for (std::uint64_t run = 0; numbers >> run;) runs.push_back(run);
    pool.add(runs);
  }
  auto done = pool.take(milliseconds(0));
  std::move(done.begin(), done.end(), std::back_inserter(rows));
  link.send(0, request_text(inputs.digest(), 0, rows));
}

}  // namespace faultline
