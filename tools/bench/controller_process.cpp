#include "tools/bench/controller_process.h"

#include <array>
#include <chrono>
#include <memory>
#include <stdexcept>
#include <system_error>

#include <fmt/format.h>

#include "drivers/signal/cycle_counter.h"
#include "drivers/signal/message_integrity.h"
#include "sim/controller_node.h"
#include "sim/frame_faults.h"
#include "tools/bench/endpoints.h"
#include "tools/bench/message_silence.h"
#include "tools/bench/stop_signal.h"

namespace faultline {
namespace {

using std::chrono::steady_clock;

constexpr std::size_t kBatch = 64;
/// Longest wait on the bus before it looks whether it shall stop and what it misses.
constexpr std::chrono::milliseconds kIdleWait{20};

/// The controller as it is from one start of the plant to the next.
struct Life {
  Life(const BenchInputs& inputs, CanBus& bus)
      : node(inputs.map, inputs.make_controller()),
        faults(inputs.map, inputs.schedule, BenchNode::kController, inputs.bank.sample_time_s) {
    faults.set_output(bus);
    if (!inputs.map.sync) faults.begin_cycle(0);
  }
  ControllerNode node;
  FrameFaults faults;
};

class ControllerProcess {
 public:
  ControllerProcess(const BenchInputs& inputs, const ControllerProcessOptions& options)
      : inputs_(inputs),
        options_(options),
        bus_(open_node(options.bus, inputs.map, BenchNode::kController)),
        silence_(inputs.map, messages_of_plant(inputs.map),
                 std::chrono::duration_cast<std::chrono::nanoseconds>(
                     std::chrono::duration<double>(inputs.bank.sample_time_s))),
        life_(std::make_unique<Life>(inputs, *bus_)) {
    if (inputs.map.sync) sync_integrity_ = MessageIntegrity(inputs.map.sync->protection);
  }

  ControllerProcessResult run() {
    tell(fmt::format("controller of {} on {}", inputs_.scenario.name, bus_->name()));
    while ((result_.signal = stop_signal_.poll()) == 0 && !is_time_over()) {
      const ReceiveResult received = bus_->receive(batch_, kIdleWait);
      for (std::size_t i = 0; i < received.count; ++i) on_frame(batch_[i]);
      if (received.status == ReceiveStatus::kError) {
        throw BusError(fmt::format("{} failed: {}", bus_->name(),
                                   std::generic_category().message(bus_->last_error())));
      }
      watch();
    }
    result_.clamped_values += life_->node.clamped_values();
    result_.bus = bus_->counters();
    result_.silences = silence_.silences();
    return result_;
  }

 private:
  void on_frame(const CanFrame& frame) {
    silence_.count(frame);
    if (const auto k = synced_cycle(frame)) begin_cycle(*k);
    const std::uint32_t before = life_->node.cycle();
    if (life_->faults.hears()) life_->node.on_frame(frame, life_->faults);
    // Without SYNC a cycle begins, for all it can know, when the one before has been answered.
    if (inputs_.map.sync || life_->node.cycle() == before) return;
    ++result_.cycles;
    life_->faults.begin_cycle(life_->node.cycle() + 1);
  }

  /// k of a SYNC that can be believed.
  std::optional<std::uint32_t> synced_cycle(const CanFrame& frame) noexcept {
    const auto& sync = inputs_.map.sync;
    if (!sync || !sync->matches(frame)) return std::nullopt;
    if (!is_usable(sync_integrity_.check(frame).status)) return std::nullopt;
    std::int64_t k = 0;
    if (sync->cycle.decode_raw(frame.payload(), k) != CodecStatus::kOk) return std::nullopt;
    return static_cast<std::uint32_t>(k);
  }

  void begin_cycle(std::uint32_t k) {
    if (cycle_ && cycles_ahead(k, *cycle_) < 0) begin_anew(k);
    if (!cycle_) tell(fmt::format("measurements come, from cycle {} on", k));
    if (cycle_ != k) {
      ++result_.cycles;
      life_->faults.begin_cycle(k);
    }
    cycle_ = k;
  }

  void begin_anew(std::uint32_t k) {
    tell(fmt::format("the plant began anew: cycle {} after cycle {}; so does the control law", k,
                     *cycle_));
    ++result_.restarts;
    result_.clamped_values += life_->node.clamped_values();
    life_ = std::make_unique<Life>(inputs_, *bus_);
    cycle_ = k;
    life_->faults.begin_cycle(k);
  }

  void watch() {
    for (const MessageSilence::Report& report : silence_.look(steady_clock::now())) {
      tell(report.text);
    }
    if (bus_->is_up() == !is_down_) return;
    is_down_ = !is_down_;
    tell(fmt::format("bus {} is {}", bus_->name(),
                     is_down_ ? "down; waiting for its return" : "back"));
  }

  void tell(const std::string& text) const {
    options_.on_line(std::chrono::duration<double>(steady_clock::now() - start_).count(), text);
  }

  [[nodiscard]] bool is_time_over() const {
    return options_.seconds &&
           steady_clock::now() - start_ >= std::chrono::duration<double>(*options_.seconds);
  }

  const BenchInputs& inputs_;
  const ControllerProcessOptions& options_;
  StopSignal stop_signal_;
  std::unique_ptr<CanBus> bus_;
  MessageSilence silence_;
  MessageIntegrity sync_integrity_;
  std::unique_ptr<Life> life_;
  std::optional<std::uint32_t> cycle_;  ///< of the last SYNC
  bool is_down_ = false;
  std::array<CanFrame, kBatch> batch_{};
  steady_clock::time_point start_ = steady_clock::now();
  ControllerProcessResult result_;
};

}  // namespace

ControllerProcessResult run_controller_process(const BenchInputs& inputs,
                                               const ControllerProcessOptions& options) {
  if (inputs.make_controller() == nullptr) {
    throw std::invalid_argument(
        fmt::format("{}: found a controller of kind \"external\", expected one that this program "
                    "has: the controller is to be another one's",
                    inputs.scenario.file.string()));
  }
  return ControllerProcess(inputs, options).run();
}

}  // namespace faultline
