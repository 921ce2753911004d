#include "tools/replay/log_replay.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <fstream>
#include <memory>
#include <stdexcept>
#include <string_view>
#include <utility>

#include <faultline/run_t.hpp>
#include <faultline/stats_t.hpp>
#include <fmt/format.h>

#include "diagnosis/model/input_error.h"
#include "tools/can/frame_log.h"
#include "tools/lcm/channels.h"
#include "tools/lcm/frame_message.h"
#include "tools/lcm/frame_sequence.h"
#include "tools/lcm/message_type.h"
#include "tools/lcm/run_parts.h"
#include "tools/log/log_files.h"
#include "tools/replay/difference_text.h"
#include "tools/replay/replay_inputs.h"

namespace faultline {
namespace {

using std::chrono::steady_clock;

/// Hands the results of a replay to their comparison.
class ComparisonSink final : public MessageSink {
 public:
  explicit ComparisonSink(ResultComparison& comparison) : comparison_(&comparison) {}
  void publish(const char* channel, std::int64_t /*utime*/,
               std::span<const std::uint8_t> message) override {
    if (const auto id = find_result_channel(channel)) comparison_->on_replayed(*id, message);
  }
  void flush() override {}
  void close() override {}

 private:
  ResultComparison* comparison_;
};

/// One run of a log being replayed.
class RunInReplay {
 public:
  RunInReplay(const ReplayOptions& options, const std::string& run_id,
              const std::vector<RunPart>& parts, const std::string& log)
      : banks_(replay_banks(options, parts, log)) {
    run_.run_id = run_id;
    if (banks_.own) run_.name = banks_.own->name;
    if (banks_.is_recorded) comparison_ = std::make_unique<ResultComparison>();
    // The answer asked for is the other bank's, where there is one: that is what is written.
    const auto output = [&](bool is_last) {
      return options.output && is_last ? open_log(*options.output) : nullptr;
    };
    if (banks_.own) {
      own_ = std::make_unique<BankReplay>(
          *banks_.own, output(!banks_.other),
          comparison_ ? std::make_unique<ComparisonSink>(*comparison_) : nullptr);
    }
    if (banks_.other) {
      other_ = std::make_unique<BankReplay>(*banks_.other, output(true), nullptr);
    }
  }

  [[nodiscard]] ResultComparison* comparison() noexcept { return comparison_.get(); }

  void on_frame(const CanFrame& frame, std::uint64_t number) {
    ++run_.frames;
    if (own_) own_->on_frame(frame, number);
    if (other_) other_->on_frame(frame, number);
  }

  void on_gap(std::uint64_t missing) {
    run_.missing_frames += missing;
    if (comparison_) comparison_->on_gap();
  }

  /// @param has_ended no frame can come any more: what is open closes.
  RunReplay finish(bool has_ended) {
    run_.has_ended = has_ended;
    if (own_) own_->finish(has_ended);
    if (other_) other_->finish(has_ended);
    if (comparison_) {
      comparison_->finish(has_ended);
      Verification verification{std::move(*comparison_), {}};
      if (const auto& difference = verification.comparison.first_difference()) {
        verification.difference = describe(*difference, banks_.own->bank);
      }
      run_.verification = std::move(verification);
    }
    if (own_) run_.answers.push_back(answer_of(*own_, *banks_.own, banks_.own_source));
    if (other_) run_.answers.push_back(answer_of(*other_, *banks_.other, banks_.other_source));
    return std::move(run_);
  }

 private:
  static BankAnswer answer_of(const BankReplay& replayed, const ReplayInputs& inputs,
                              const std::string& source) {
    const RunHistory& history = replayed.history();
    BankAnswer answer{.bank = inputs.bank.name,
                      .source = source,
                      .verdicts = history.verdicts(),
                      .first_fired_s = history.first_fired_s(),
                      .residuals = {},
                      .injections = history.injections(),
                      .expectations = history.expectations(),
                      .samples = replayed.counters().samples,
                      .bad_samples = replayed.counters().bad_samples,
                      .resets = replayed.counters().resets};
    for (const ResidualFilter& filter : inputs.bank.filters)
      answer.residuals.push_back(filter.name);
    return answer;
  }

  ReplayBanks banks_;
  std::unique_ptr<ResultComparison> comparison_;
  std::unique_ptr<BankReplay> own_, other_;
  RunReplay run_;
};

/// Replays the runs of an LCM log one after the other.
class LcmReplay {
 public:
  explicit LcmReplay(const ReplayOptions& options) : options_(&options) {}

  ReplayResult replay() {
    LogFiles log(options_->logs, options_->is_quiet);
    while (const LogEvent* event = log.next()) {
      name_ = log.file();
      take(*event);
    }
    for (const FileDamage& damaged : log.damages()) tell(describe(damaged.file, damaged.damage));
    result_.damages = log.damages().size();
    finish_run();
    const auto has_frames = [](const RunReplay& run) { return run.frames > 0; };
    if (std::none_of(result_.runs.begin(), result_.runs.end(), has_frames)) {
      throw InputError(
          name_, {},
          fmt::format("found no message on {}, expected the frames to replay", kCanChannel));
    }
    return std::move(result_);
  }

 private:
  void tell(const std::string& text) const {
    if (options_->on_problem) options_->on_problem(text);
  }

  void take(const LogEvent& event) {
    if (event.channel == kCanChannel) {
      take_frames(event);
    } else if (const auto id = find_result_channel(event.channel)) {
      take_result(*id, event);
    } else if (event.channel == kRunChannel) {
      take_part(event);
    } else if (event.channel == kStatsChannel) {
      take_stats(event);
    } else if (event.channel == kTruthChannel) {
      if (decode_message(event.data, layout::kTruth, truth_)) faults_.on_truth(truth_);
    }
  }

  void take_frames(const LogEvent& event) {
    if (!decode_frames(event.data, batch_)) return refuse_or_tell(event);
    static_cast<void>(current_run());
    frames_.push(batch_);
  }

  /// The next frames in their order.
  void on_batch(const FrameBatch& batch) {
    // Where the log begins late, no frame before it tells.
    if (next_frame_ == 0 && batch.first_frame > 0) on_gap(0, batch.first_frame);
    next_frame_ = batch.first_frame + batch.frame_count;
    if (batch.malformed > 0) on_gap(batch.first_frame, batch.malformed);
    for (std::size_t i = 0; i < batch.frames.size(); ++i) {
      run_->on_frame(batch.frames[i], static_cast<std::uint64_t>(batch.first_frame) + i);
    }
  }

  void on_gap(std::int64_t first_frame, std::int64_t count) {
    if (count > 0) {
      tell(fmt::format("{}: {} frames from number {} on are missing", name_, count, first_frame));
    }
    run_->on_gap(static_cast<std::uint64_t>(count));
  }

  void take_result(ResultChannel id, const LogEvent& event) {
    MessageHead head;
    const MessageType& type = *find_message_type(event.channel);
    if (read_head(type, event.data, head) != MessageStatus::kWhole) return refuse_or_tell(event);
    if (ResultComparison* comparison = current_run().comparison()) {
      comparison->on_recorded(id, event.data);
    }
  }

  /// Of a message that cannot be used. One of another program or version cannot be compared, and
  /// says nothing of the frames; a damaged one is passed over.
  void refuse_or_tell(const LogEvent& event) const {
    MessageHead head;
    const MessageType& type = *find_message_type(event.channel);
    if (read_head(type, event.data, head) == MessageStatus::kOtherSchema) {
      throw InputError(
          name_, {},
          fmt::format("byte {}: {}: found a message with fingerprint {:016x}, expected {:016x}: it "
                      "was made by another program, or by another version of this one",
                      event.offset, event.channel,
                      static_cast<std::uint64_t>(big_endian_at(event.data, 0)),
                      static_cast<std::uint64_t>(type.fingerprint)));
    }
    tell(
        fmt::format("{}: byte {}: found a damaged {} message", name_, event.offset, event.channel));
  }

  void take_part(const LogEvent& event) {
    run_t& part = part_;
    if (!decode_message(event.data, layout::kRun, part)) return;
    if (run_ && part.run_id != run_id_) finish_run();
    if (!run_) run_id_ = part.run_id;
  }

  void take_stats(const LogEvent& event) {
    if (!run_ || !decode_message(event.data, layout::kStats, stats_)) return;
    if (stats_.is_final == 0) return;
    frames_.give_up();
    // What the run received last may be missing in the log.
    if (stats_.frames_received > next_frame_) {
      on_gap(next_frame_, stats_.frames_received - next_frame_);
    }
    has_ended_ = true;
    finish_run();
  }

  RunInReplay& current_run() {
    if (!run_) {
      run_.emplace(*options_, run_id_, parts_of_run(), name_);
      frames_.start_over();
      next_frame_ = 0;
      has_ended_ = false;
    }
    return *run_;
  }

  void finish_run() {
    if (!run_) return;
    frames_.give_up();
    result_.runs.push_back(run_->finish(has_ended_));
    result_.runs.back().faults = std::exchange(faults_, {}).faults();
    run_.reset();
    run_id_.clear();
  }

  /// The parts of the run that begins here: looked for ahead, as they may come behind its first
  /// frames (a logger that started late hears them after 5 s).
  [[nodiscard]] std::vector<RunPart> parts_of_run() {
    RunParts parts;
    LogFiles log(options_->logs, true);
    while (const LogEvent* event = log.next()) {
      if (event->channel != kRunChannel || !decode_message(event->data, layout::kRun, part_)) {
        continue;
      }
      if (run_id_.empty() && !is_over(part_.run_id)) run_id_ = part_.run_id;
      if (part_.run_id != run_id_) continue;
      parts.take(part_);
      if (has_all(parts)) break;
    }
    return parts.whole_parts();
  }

  [[nodiscard]] bool is_over(const std::string& run_id) const {
    return std::any_of(result_.runs.begin(), result_.runs.end(),
                       [&](const RunReplay& run) { return run.run_id == run_id; });
  }

  [[nodiscard]] static bool has_all(const RunParts& parts) {
    constexpr std::array<std::string_view, 4> kNeeded = {"scenario", "plant", "dbc", "bank"};
    const bool is_whole = std::all_of(kNeeded.begin(), kNeeded.end(), [&](std::string_view name) {
      const RunParts::Part* const part = parts.find(name);
      return part != nullptr && part->is_whole();
    });
    return is_whole && has_all_includes(parts.whole_parts());
  }

  const ReplayOptions* options_;
  ReplayResult result_;
  std::string name_;  ///< of the log being read
  std::optional<RunInReplay> run_;
  std::string run_id_;
  std::int64_t next_frame_ = 0;
  bool has_ended_ = false;
  FrameBatch batch_;
  FrameSequence frames_{
      {.on_batch = [this](const FrameBatch& batch) { on_batch(batch); },
       .on_gap = [this](const FrameGap& gap) { on_gap(gap.first_frame, gap.frames); },
       .on_restart = [this] { on_gap(next_frame_, 0); }}};
  run_t part_{};
  stats_t stats_{};
  truth_t truth_{};
  RecordedFaults faults_;
};

/// A text of frames has no results to compare, and the names of its buses stand for their order.
ReplayResult replay_text(const ReplayOptions& options) {
  const std::string& file = options.logs.front();
  RunInReplay run(options, "", {}, file);
  std::vector<std::string> buses;
  std::uint64_t number = 0;
  FrameLogReceiver receiver;
  receiver.on_frame = [&](const CanFrame& received, std::string_view bus) {
    auto known = std::find(buses.begin(), buses.end(), bus);
    if (known == buses.end()) known = buses.emplace(known, bus);
    CanFrame frame = received;
    frame.bus = static_cast<std::uint8_t>(known - buses.begin());
    run.on_frame(frame, number++);
  };
  receiver.on_problem = [&](const std::string& text) {
    if (options.on_problem) options.on_problem(text);
  };
  const FrameLogCount count = read_frame_log(file, nullptr, receiver);
  ReplayResult result;
  result.runs.push_back(run.finish(true));
  result.damages = count.problems;
  if (count.frames == 0) {
    throw InputError(file, {}, "found no frame, expected some");
  }
  return result;
}

void check_output(const ReplayOptions& options) {
  if (!options.output) return;
  for (const std::string& log : options.logs) {
    std::error_code error;
    if (std::filesystem::equivalent(log, *options.output, error)) {
      throw std::invalid_argument(
          fmt::format("{}: found the log to replay, expected another file to write to", log));
    }
  }
}

bool is_text(const std::string& file) {
  if (file == "-") return true;
  std::ifstream in(file, std::ios::binary);
  std::string head(kLogMagic.size(), '\0');
  in.read(head.data(), static_cast<std::streamsize>(head.size()));
  return in && head.find('\0') == std::string::npos && head != kLogMagic;
}

}  // namespace

bool BankAnswer::are_expectations_met() const {
  return std::all_of(expectations.begin(), expectations.end(),
                     [](const ExpectationOutcome& outcome) { return outcome.is_met; });
}

bool Verification::is_verified() const noexcept {
  const ResultComparison::Counts total = comparison.total();
  return total.identical > 0 && total.different == 0 && total.unverifiable == 0;
}

ReplayResult replay(const ReplayOptions& options) {
  check_output(options);
  const auto start = steady_clock::now();
  ReplayResult result = is_text(options.logs.front()) && options.logs.size() == 1
                            ? replay_text(options)
                            : LcmReplay(options).replay();
  result.wall_s = std::chrono::duration<double>(steady_clock::now() - start).count();
  return result;
}

}  // namespace faultline
