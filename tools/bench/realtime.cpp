#include <array>
#include <atomic>
#include <chrono>
#include <mutex>
#include <system_error>
#include <thread>
#include <utility>

#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <fmt/format.h>

#include "tools/bench/bench_run.h"
#include "tools/bench/slot_queue.h"

namespace faultline {
namespace {

using std::chrono::steady_clock;
using Nanoseconds = std::chrono::nanoseconds;

constexpr std::size_t kBatch = 64;
/// Longest wait on a bus before a thread looks whether it shall stop.
constexpr Nanoseconds kIdleWait = std::chrono::milliseconds(20);
/// After the last cycle the answers and the last frames are waited for this long.
constexpr Nanoseconds kGrace = std::chrono::milliseconds(100);
/// The publisher looks into its queues this often.
constexpr Nanoseconds kPublishPeriod = std::chrono::milliseconds(2);
/// A second of a 1 kHz bench with a few frames per cycle.
constexpr std::size_t kRecordSlots = 1024;
constexpr std::size_t kFrameSlots = 8192;

struct TruthRecord {
  PlantTruth truth;
  Eigen::VectorXd x;
};

/// A frame and its place among those the diagnosis node received.
struct NumberedFrame {
  CanFrame frame;
  std::uint64_t number = 0;
};

/// Queues between the diagnosis thread and the publisher.
class QueueSink final : public DiagnosisSink {
 public:
  explicit QueueSink(const Bank& bank)
      : records_(kRecordSlots, DiagnosisRecord(bank)), frames_(kFrameSlots, NumberedFrame{}) {}
  void on_received(const CanFrame& frame) noexcept override {
    frames_.push({frame, frame_count_++});
  }
  void on_record(const DiagnosisRecord& record) noexcept override { records_.push(record); }

  SlotQueue<DiagnosisRecord> records_;
  SlotQueue<NumberedFrame> frames_;

 private:
  std::uint64_t frame_count_ = 0;
};

std::int64_t to_utime(Timestamp stamp) {
  return std::chrono::duration_cast<std::chrono::microseconds>(stamp.time_since_epoch()).count();
}

class Realtime {
 public:
  explicit Realtime(BenchRun& run)
      : run_(run),
        period_(std::chrono::duration_cast<Nanoseconds>(
            std::chrono::duration<double>(run.inputs.bank.sample_time_s))),
        sink_(run.inputs.bank),
        truths_(kRecordSlots, TruthRecord{{}, run.inputs.x_initial}) {}

  void run() {
    start_ = steady_clock::now() + kIdleWait;  // all threads are up by then
    std::thread diagnosis([this] { run_diagnosis(); });
    std::thread controller([this] { run_controller(); });
    std::thread plant([this] { run_plant(); });
    try {
      publish_until_done();
    } catch (...) {
      // Join before unwinding: the threads use what is about to be destroyed.
      must_stop_ = true;
      plant.join();
      controller.join();
      diagnosis.join();
      throw;
    }
    plant.join();
    controller.join();
    diagnosis.join();
    drain_queues();
    run_.add_losses(overruns_, sink_.records_.dropped());
    if (sink_.frames_.dropped() > 0) {
      run_.publisher.publish_event(
          -1, "warning", "publisher",
          fmt::format("{} received frames are missing in the log: its queue was full",
                      sink_.frames_.dropped()),
          last_utime_);
    }
    if (failure_) run_.stop(*failure_);
  }

 private:
  // --- plant thread: leads the cycle at absolute deadlines; late cycles are caught up, not
  // skipped.
  void run_plant() {
    TruthRecord truth{{}, run_.inputs.x_initial};
    auto deadline = start_;
    for (std::uint32_t k = 0; k < run_.cycle_count() && !must_stop_; ++k, deadline += period_) {
      take_commands_until(deadline);
      if (steady_clock::now() >= deadline + period_) ++overruns_;
      run_.plant.on_cycle(k, *run_.buses.plant);
      truth.truth = run_.plant.truth();
      truth.x = run_.plant.state();
      truths_.push(truth);
      if (!run_.plant.is_finite()) {
        fail({StopReason::Kind::kPlant,
              fmt::format("the plant diverged: at t = {:.6g} s its state is not finite",
                          run_.time_of(k))});
      }
    }
    take_commands_until(steady_clock::now() + kGrace);
    is_over_ = true;
  }

  void take_commands_until(steady_clock::time_point deadline) {
    for (;;) {
      const auto left = deadline - steady_clock::now();
      if (left <= Nanoseconds::zero() || must_stop_) return;
      const ReceiveResult received =
          run_.buses.plant->receive(plant_batch_, std::min<Nanoseconds>(left, kIdleWait));
      for (std::size_t i = 0; i < received.count; ++i) run_.plant.on_frame(plant_batch_[i]);
      watch(received, *run_.buses.plant);
    }
  }

  // --- controller thread: answers measurements.
  void run_controller() {
    while (!is_over_ && !must_stop_) {
      const ReceiveResult received = run_.buses.controller->receive(controller_batch_, kIdleWait);
      for (std::size_t i = 0; i < received.count; ++i) {
        run_.controller.on_frame(controller_batch_[i], *run_.buses.controller);
      }
      watch(received, *run_.buses.controller);
    }
  }

  // --- diagnosis thread: waits on its bus, reads a batch, diagnoses, queues.
  void run_diagnosis() {
    for (;;) {
      const bool may_end = is_over_ || must_stop_;
      const ReceiveResult received = run_.buses.diagnosis->receive(diagnosis_batch_, kIdleWait);
      for (std::size_t i = 0; i < received.count; ++i) {
        run_.diagnosis.on_frame(diagnosis_batch_[i], sink_);
      }
      watch(received, *run_.buses.diagnosis);
      if (received.count == 0 && may_end) break;
    }
    run_.diagnosis.finish(sink_);
    is_diagnosis_over_ = true;
  }

  /// A bus that is down comes back, and the cycles go on meanwhile: BenchRun tells of it.
  void watch(const ReceiveResult& received, const CanBus& bus) {
    if (received.status != ReceiveStatus::kError) return;
    fail({StopReason::Kind::kBus, fmt::format("{} failed: {}", bus.name(),
                                              std::generic_category().message(bus.last_error()))});
  }

  void fail(StopReason reason) {
    const std::lock_guard lock(failure_mutex_);
    if (!failure_) failure_ = std::move(reason);
    must_stop_ = true;
  }

  // --- calling thread: publishes.
  void publish_until_done() {
    boost::asio::io_context context(1);
    boost::asio::steady_timer timer(context);
    for (bool is_done = false; !is_done;) {
      timer.expires_after(kPublishPeriod);
      timer.async_wait([](const boost::system::error_code&) {});
      context.restart();
      context.run();
      is_done = is_diagnosis_over_;
      drain_queues();
      if (run_.attend(run_.time_of(last_cycle_), last_utime_)) must_stop_ = true;
    }
  }

  void drain_queues() {
    while (const TruthRecord* truth = truths_.front()) {
      run_.on_truth(truth->truth, truth->x, run_.utime_of(run_.time_of(truth->truth.cycle)));
      truths_.pop();
    }
    while (const NumberedFrame* received = sink_.frames_.front()) {
      last_utime_ = to_utime(received->frame.stamp);
      run_.on_frame(received->frame, received->number, last_utime_);
      sink_.frames_.pop();
    }
    run_.publisher.flush_frames();
    while (const DiagnosisRecord* record = sink_.records_.front()) {
      last_cycle_ = record->cycle;
      run_.on_record(*record, to_utime(record->stamp));
      sink_.records_.pop();
    }
  }

  BenchRun& run_;
  Nanoseconds period_;
  QueueSink sink_;
  SlotQueue<TruthRecord> truths_;
  steady_clock::time_point start_;
  std::array<CanFrame, kBatch> plant_batch_{}, controller_batch_{}, diagnosis_batch_{};
  std::atomic<bool> must_stop_{false}, is_over_{false}, is_diagnosis_over_{false};
  std::atomic<std::uint64_t> overruns_{0};
  std::mutex failure_mutex_;
  std::optional<StopReason> failure_;
  std::uint32_t last_cycle_ = 0;
  std::int64_t last_utime_ = 0;
};

}  // namespace

void run_realtime(BenchRun& run) { Realtime(run).run(); }

}  // namespace faultline
