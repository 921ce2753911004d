#include <array>
#include <chrono>
#include <vector>

#include <fmt/format.h>

#include "tools/bench/bench_run.h"

namespace faultline {
namespace {

using std::chrono::steady_clock;

/// Frames read at a time.
constexpr std::size_t kBatch = 64;
/// Reading the wall clock costs 25 ns on a host and 13 µs in User Mode Linux: once per so many
/// cycles.
constexpr std::uint32_t kCyclesPerAttention = 16;
/// On a bus between processes of one machine an answer takes microseconds; so long means it is
/// lost.
constexpr auto kAnswerTimeout = std::chrono::seconds(2);
constexpr auto kPollInterval = std::chrono::milliseconds(5);

/// Hands what the diagnosis found straight to the publisher.
class DirectSink final : public DiagnosisSink {
 public:
  explicit DirectSink(BenchRun& run) : run_(&run) {}
  void set_utime(std::int64_t utime) noexcept { utime_ = utime; }
  void on_received(const CanFrame& frame) noexcept override {
    guard([&] { run_->on_frame(frame, frame_count_++, utime_); });
  }
  void on_record(const DiagnosisRecord& record) noexcept override {
    guard([&] { run_->on_record(record, utime_); });
  }
  /// Rethrows what publishing threw: the node between is noexcept.
  void rethrow() const {
    if (error_) std::rethrow_exception(error_);
  }

 private:
  template <class Action>
  void guard(const Action& action) noexcept {
    if (error_) return;
    try {
      action();
    } catch (...) {
      error_ = std::current_exception();
    }
  }

  BenchRun* run_;
  std::uint64_t frame_count_ = 0;
  std::int64_t utime_ = 0;
  std::exception_ptr error_;
};

/// Sends a node's frames and keeps those of the cycle: what an outage swallowed is sent again.
class CycleSink final : public FrameSink {
 public:
  explicit CycleSink(CanBus& bus) : bus_(&bus) {}
  bool send(const CanFrame& frame) noexcept override {
    frames_.push_back(frame);
    return bus_->send(frame);
  }
  void begin_cycle() noexcept { frames_.clear(); }
  /// Frames of the cycle so far.
  [[nodiscard]] std::uint64_t count() const noexcept { return frames_.size(); }
  void send_again() noexcept { bus_->send_batch(frames_); }

 private:
  CanBus* bus_;
  std::vector<CanFrame> frames_;
};

/// Frames of a cycle on their way to a node.
struct Arrivals {
  std::uint64_t unheard_before = 0;  ///< FrameFaults::unheard at its begin
  std::uint64_t arrived = 0;

  [[nodiscard]] bool has_all(std::uint64_t sent, std::uint64_t unheard) const noexcept {
    return arrived + (unheard - unheard_before) >= sent;
  }
};

class LockStep {
 public:
  explicit LockStep(BenchRun& run)
      : run_(run),
        sink_(run),
        from_plant_(*run.buses.plant),
        from_controller_(*run.buses.controller) {
    run.plant_faults.set_output(from_plant_);
    run.controller_faults.set_output(from_controller_);
  }

  void run() {
    for (std::uint32_t k = 0; k < run_.cycle_count(); ++k) {
      const double t_s = run_.time_of(k);
      const std::int64_t utime = run_.utime_of(t_s);
      sink_.set_utime(utime);
      if (run_.buses.loop) {
        run_.buses.loop->set_time(Timestamp(std::chrono::microseconds(utime)));
      }
      if (!run_cycle(k, utime)) break;
      if (k % kCyclesPerAttention != 0) continue;
      if (run_.attend(t_s, utime)) break;
      run_.take_injections(k + 1, utime);
    }
    drain_diagnosis(std::chrono::milliseconds(0));
    run_.diagnosis.finish(sink_);
    sink_.rethrow();
  }

 private:
  /// @return false if the run cannot go on.
  bool run_cycle(std::uint32_t k, std::int64_t utime) {
    losses_ = count_losses();
    from_plant_.begin_cycle();
    from_controller_.begin_cycle();
    to_controller_ = {.unheard_before = run_.plant_faults.unheard()};
    to_plant_ = {.unheard_before = run_.controller_faults.unheard()};
    run_.plant_faults.begin_cycle(k);
    run_.controller_faults.begin_cycle(k);
    run_.plant.on_cycle(k, run_.plant_faults);
    run_.on_truth(run_.plant.truth(), run_.plant.state(), utime);
    if (!run_.plant.is_finite()) {
      run_.stop({StopReason::Kind::kPlant, fmt::format("the plant diverged: at t = {:.6g} s {}",
                                                       run_.time_of(k), run_.plant.failure())});
      return false;
    }
    if (!await_command(k)) return false;
    drain_diagnosis(std::chrono::milliseconds(0));
    sink_.rethrow();
    return true;
  }

  /// Reads what is there for plant and controller. @return whether there was anything.
  bool serve_nodes(std::chrono::nanoseconds wait) {
    const ReceiveResult measured = run_.buses.controller->receive(batch_, wait);
    for (std::size_t i = 0; i < measured.count; ++i) {
      to_controller_.arrived += batch_[i].is_error ? 0U : 1U;
      if (!run_.controller_faults.hears()) continue;
      run_.controller.on_frame(batch_[i], run_.controller_faults);
    }
    const ReceiveResult commanded = run_.buses.plant->receive(batch_, std::chrono::nanoseconds(0));
    for (std::size_t i = 0; i < commanded.count; ++i) {
      to_plant_.arrived += batch_[i].is_error ? 0U : 1U;
      if (run_.plant_faults.hears()) run_.plant.on_frame(batch_[i]);
    }
    return measured.count + commanded.count > 0;
  }

  /// Whether the next cycle may begin. Where faults keep frames from the nodes the answer may never
  /// come: then it may when all frames that were passed on have arrived, as nodes only answer.
  [[nodiscard]] bool is_over(std::uint32_t k) const noexcept {
    const bool is_answered = run_.plant.has_command(k);
    if (!may_withhold()) return is_answered;
    if (is_sent_again_) return is_answered;
    return to_controller_.has_all(from_plant_.count(), run_.plant_faults.unheard()) &&
           to_plant_.has_all(from_controller_.count(), run_.controller_faults.unheard());
  }

  [[nodiscard]] bool may_withhold() const noexcept {
    return run_.plant_faults.may_withhold() || run_.controller_faults.may_withhold();
  }

  bool await_command(std::uint32_t k) {
    std::chrono::nanoseconds wait{0};
    constexpr auto kNotYet = steady_clock::time_point::max();
    auto deadline = kNotYet, outage_deadline = kNotYet;
    is_sent_again_ = false;
    while (!is_over(k)) {
      if (serve_nodes(wait)) continue;
      wait = kPollInterval;
      const auto now = steady_clock::now();
      if (has_lost_frames()) {
        if (outage_deadline == kNotYet) outage_deadline = now + run_.options.bus_patience;
        if (!await_bus(k, outage_deadline)) return false;
        from_plant_.send_again();
        from_controller_.send_again();
        is_sent_again_ = true;
        deadline = kNotYet;
        continue;
      }
      if (deadline == kNotYet) deadline = now + kAnswerTimeout;
      if (now < deadline) continue;
      if (is_sent_again_ && may_withhold()) return true;  // what still comes, nobody can tell
      run_.stop({StopReason::Kind::kBus,
                 fmt::format("no complete command answered cycle {} within {} s: frames are lost, "
                             "or {} is down{}",
                             k, kAnswerTimeout.count(), run_.buses.plant->name(),
                             run_.inputs.scenario.controller.kind == ControllerKind::kExternal
                                 ? ", or the external controller does not run"
                                 : "")});
      return false;
    }
    return true;
  }

  /// Outages seen by plant and controller, and frames their buses refused.
  [[nodiscard]] std::uint64_t count_losses() const noexcept {
    const BusCounters sum = run_.buses.plant->counters() + run_.buses.controller->counters();
    return sum.outages + sum.send_errors;
  }

  /// Whether a bus lost or refused frames since the last call in this cycle, or is down.
  bool has_lost_frames() noexcept {
    const std::uint64_t losses = count_losses();
    const bool has_lost = losses != losses_;
    losses_ = losses;
    return has_lost || !run_.buses.plant->is_up() || !run_.buses.controller->is_up();
  }

  /// Waits until all endpoints are up. @return false if the run cannot go on.
  bool await_bus(std::uint32_t k, steady_clock::time_point deadline) {
    const double t_s = run_.time_of(k);
    for (;;) {
      drain_diagnosis(std::chrono::milliseconds(0));
      sink_.rethrow();
      if (run_.attend(t_s, run_.utime_of(t_s))) return false;
      if (steady_clock::now() >= deadline) {
        run_.stop(
            {StopReason::Kind::kBus,
             fmt::format("{} was down, or took no frames, for {:g} s in cycle {}",
                         run_.buses.plant->name(),
                         std::chrono::duration<double>(run_.options.bus_patience).count(), k)});
        return false;
      }
      serve_nodes(kPollInterval);
      if (run_.buses.plant->is_up() && run_.buses.controller->is_up() &&
          run_.buses.diagnosis->is_up()) {
        return true;
      }
    }
  }

  void drain_diagnosis(std::chrono::nanoseconds wait) {
    for (;;) {
      const ReceiveResult received = run_.buses.diagnosis->receive(batch_, wait);
      for (std::size_t i = 0; i < received.count; ++i) {
        run_.diagnosis.on_frame(batch_[i], sink_);
      }
      if (received.count < batch_.size()) return;
    }
  }

  BenchRun& run_;
  DirectSink sink_;
  CycleSink from_plant_, from_controller_;
  Arrivals to_controller_, to_plant_;
  bool is_sent_again_ = false;  ///< in this cycle, after an outage
  std::uint64_t losses_ = 0;
  std::array<CanFrame, kBatch> batch_{};
};

}  // namespace

void run_lock_step(BenchRun& run) { LockStep(run).run(); }

}  // namespace faultline
