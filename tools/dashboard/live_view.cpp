#include "tools/dashboard/live_view.h"

#include <algorithm>
#include <exception>
#include <string_view>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "diagnosis/bank/bank_file.h"
#include "drivers/dbc/dbc_parser.h"
#include "tools/lcm/channels.h"
#include "tools/lcm/log_event.h"
#include "tools/lcm/message_layout.h"

namespace faultline {
namespace {

/// Without a residual or diagnosis for so long, the bench is thought to stand: it publishes one of
/// them at least once per second of bench time.
constexpr std::chrono::milliseconds kSilence{1500};
/// Longest text of an event that is kept.
constexpr std::size_t kEventText = 1000;
/// Taken into account for each chunk besides its text: a map's node with a string.
constexpr std::size_t kChunkCost = 128;
/// The parts of a run that are looked at.
constexpr std::string_view kDbcPart = "dbc";
constexpr std::string_view kBankPart = "bank";

template <class Message>
bool replace(std::optional<Message>& target, const LiveMessage& message, std::string_view layout) {
  Message decoded;
  if (!decode_message(message.data, layout, decoded)) return false;
  target = std::move(decoded);
  return true;
}

}  // namespace

void LiveView::take(const LiveMessage& message) {
  const std::string_view channel = message.channel;
  bool is_read = true;
  if (message.data.size() > kLongestMessage) {
    is_read = false;
  } else if (channel == kRunChannel) {
    is_read = take_run(message);
  } else if (channel == kResidualChannel) {
    is_read = take_residual(message);
  } else if (channel == kDiagnosisChannel) {
    is_read = replace(diagnosis_, message, layout::kDiagnosis);
    if (is_read) last_heard_ = Clock::now();
  } else if (channel == kStatsChannel) {
    is_read = replace(stats_, message, layout::kStats);
  } else if (channel == kTruthChannel) {
    is_read = replace(truth_, message, layout::kTruth);
  } else if (channel == kCanChannel) {
    is_read = take_frames(message);
  } else if (channel == kEventChannel) {
    is_read = take_event(message);
  }
  if (!is_read) ++unreadable_;
}

bool LiveView::is_running(Clock::time_point now) const noexcept {
  return last_heard_ && now - *last_heard_ < kSilence;
}

void LiveView::begin_run(const std::string& run_id) {
  run_id_ = run_id;
  parts_ = {};
  bank_.reset();
  dbc_ = {};
  traffic_ = TrafficMonitor(DbcDatabase{}, kIdentifiers);
  has_tried_dbc_ = has_tried_bank_ = false;
  residual_.reset();
  diagnosis_.reset();
  stats_.reset();
  truth_.reset();
  reset_peaks();
  run_bytes_ = 0;
  ++revision_;
}

bool LiveView::take_run(const LiveMessage& message) {
  run_t chunk;
  if (!decode_message(message.data, layout::kRun, chunk)) return false;
  if (revision_ == 0 || chunk.run_id != run_id_) begin_run(chunk.run_id);
  // RUN comes again every few seconds for those who join late.
  const bool is_due =
      (chunk.part == kDbcPart && !has_tried_dbc_) || (chunk.part == kBankPart && !has_tried_bank_);
  if (!is_due) return true;
  return keep_chunk(chunk) && read_part(chunk.part);
}

/// False: it cannot be one of this part, or there is no room for it.
bool LiveView::keep_chunk(const run_t& chunk) {
  const RunParts::Part* const part = parts_.find(chunk.part);
  const bool is_same_text = part != nullptr && part->digest == chunk.digest;
  const std::int32_t count = is_same_text ? part->chunk_count : chunk.chunk_count;
  if (chunk.chunk < 0 || chunk.chunk >= count) return false;
  std::size_t freed = 0;  // of what this chunk takes the place of
  if (is_same_text) {
    const auto before = part->chunks.find(chunk.chunk);
    if (before != part->chunks.end()) freed = kChunkCost + before->second.size();
  } else if (part != nullptr) {
    for (const auto& [number, text] : part->chunks) freed += kChunkCost + text.size();
  }
  const std::size_t bytes = run_bytes_ - freed + kChunkCost + chunk.data.size();
  if (bytes > kRunBytes) return false;
  run_bytes_ = bytes;
  parts_.take(chunk);
  return true;
}

/// Once the part is whole. False: it is none.
bool LiveView::read_part(std::string_view name) {
  const RunParts::Part* const part = parts_.find(name);
  if (part == nullptr || !part->is_whole()) return true;
  try {
    if (name == kDbcPart) {
      has_tried_dbc_ = true;
      dbc_ = parse_dbc(part->text(), part->name);
      traffic_ = TrafficMonitor(dbc_, kIdentifiers);
    } else {
      has_tried_bank_ = true;
      bank_ = parse_bank(part->text(), part->name);
    }
    ++revision_;
    return true;
  } catch (const std::exception&) {
    return false;
  }
}

bool LiveView::take_residual(const LiveMessage& message) {
  const std::int64_t before = residual_ ? residual_->sequence : -1;
  if (!replace(residual_, message, layout::kResidual)) return false;
  if (before >= 0 && residual_->sequence > before) {
    lost_ += static_cast<std::uint64_t>(residual_->sequence - before - 1);
  }
  last_heard_ = Clock::now();
  const std::size_t count = std::min(residual_->evaluation.size(), kFilters);
  if (least_.size() != count) {
    least_.assign(residual_->evaluation.begin(),
                  residual_->evaluation.begin() + static_cast<std::ptrdiff_t>(count));
    greatest_ = least_;
  }
  for (std::size_t i = 0; i < count; ++i) {
    least_[i] = std::min(least_[i], residual_->evaluation[i]);
    greatest_[i] = std::max(greatest_[i], residual_->evaluation[i]);
  }
  return true;
}

bool LiveView::take_frames(const LiveMessage& message) {
  if (!decode_frames(message.data, batch_)) return false;
  for (const CanFrame& frame : batch_.frames) {
    traffic_.on_frame(frame);
    last_frame_ = frame.stamp;
  }
  return true;
}

bool LiveView::take_event(const LiveMessage& message) {
  event_t event;
  if (!decode_message(message.data, layout::kEvent, event)) return false;
  for (std::string* const text : {&event.severity, &event.source, &event.text}) {
    if (text->size() > kEventText) text->resize(kEventText);
  }
  events_.push_back(std::move(event));
  if (events_.size() > kEvents) events_.pop_front();
  return true;
}

void LiveView::reset_peaks() {
  least_.clear();
  greatest_.clear();
}

std::string LiveView::filter_name(std::size_t i) const {
  return bank_ && i < bank_->filters.size() ? bank_->filters[i].name
                                            : fmt::format("residual {}", i + 1);
}

std::string LiveView::verdict_text() const {
  if (!diagnosis_) return {};
  std::string text = diagnosis_->verdict;
  const char* separator = " ";
  for (const fault_set_t& set : diagnosis_->sets) {
    if (set.faults.empty()) continue;
    text += fmt::format("{}{}", separator, fmt::join(set.faults, "+"));
    separator = " | ";
  }
  if (!diagnosis_->blame.empty()) text += fmt::format(" ({})", diagnosis_->blame);
  return text;
}

std::optional<double> LiveView::verdict_age_s() const {
  if (!diagnosis_ || !bank_) return std::nullopt;
  const std::int64_t now =
      residual_ ? std::max(residual_->cycle, diagnosis_->cycle) : diagnosis_->cycle;
  return (static_cast<double>(now) - static_cast<double>(diagnosis_->since_cycle)) *
         bank_->sample_time_s;
}

}  // namespace faultline
