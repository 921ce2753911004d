#include "tools/log/recorded_samples.h"

#include <stdexcept>
#include <utility>

#include <faultline/run_t.hpp>
#include <faultline/sample_t.hpp>
#include <faultline/truth_t.hpp>
#include <fmt/format.h>

#include "diagnosis/bank/bank_file.h"
#include "drivers/signal/sample.h"
#include "tools/lcm/channels.h"
#include "tools/lcm/log_event.h"
#include "tools/lcm/message_type.h"
#include "tools/lcm/run_parts.h"
#include "tools/log/log_files.h"

namespace faultline {
namespace {

class SampleReader {
 public:
  SampleReader(const std::string& file, const PlantModel& plant, RecordedSamples& recorded)
      : file_(file), plant_(plant), recorded_(recorded) {}

  void take(const LogEvent& event) {
    const MessageType* type = find_message_type(event.channel);
    MessageHead head;
    if (type == nullptr || read_head(*type, event.data, head) != MessageStatus::kWhole) {
      return;
    }
    if (type->channel == kSampleChannel) {
      sample_t sample;
      if (decode_message(event.data, type->layout, sample)) take_sample(sample);
    } else if (type->channel == kTruthChannel) {
      truth_t truth;
      if (decode_message(event.data, type->layout, truth)) take_truth(truth);
    } else if (type->channel == kRunChannel) {
      run_t run;
      if (decode_message(event.data, type->layout, run)) parts_.take(run);
    }
  }

  // The end of the log.
  void finish() {
    end_stretch();
    const RunParts::Part* bank = parts_.find("bank");
    if (bank == nullptr || !bank->is_whole()) return;
    const double sample_time_s = parse_bank(bank->text(), bank->name).sample_time_s;
    if (recorded_.sample_time_s && *recorded_.sample_time_s != sample_time_s) {
      throw std::invalid_argument(
          fmt::format("{}: found samples every {} s, expected every {} s as in the logs before",
                      file_, sample_time_s, *recorded_.sample_time_s));
    }
    recorded_.sample_time_s = sample_time_s;
  }

 private:
  void take_truth(const truth_t& truth) const {
    if (truth.faults.empty()) return;
    throw std::invalid_argument(fmt::format(
        "{}: found fault \"{}\" ({}) acting in cycle {}, expected a record without any fault",
        file_, truth.faults[0].target, truth.faults[0].kind, truth.cycle));
  }

  void take_sample(const sample_t& sample) {
    if (std::ssize(sample.y) != plant_.q() || std::ssize(sample.u) != plant_.m()) {
      throw std::invalid_argument(fmt::format(
          "{}: found samples of {} outputs and {} inputs, expected {} and {}: those of "
          "plant \"{}\"",
          file_, sample.y.size(), sample.u.size(), plant_.q(), plant_.m(), plant_.name));
    }
    const bool is_good =
        (static_cast<std::uint32_t>(sample.flags) & kBadSample) == 0 && sample.command_cycle >= 0;
    if (!is_good || sample.cycle != next_cycle_) end_stretch();
    next_cycle_ = sample.cycle + 1;
    if (!is_good) return;
    for (Eigen::Index i = 0; i < plant_.q(); ++i) {
      y_.push_back(sample.y[static_cast<std::size_t>(i)] - plant_.y_operating[i]);
    }
    for (Eigen::Index i = 0; i < plant_.m(); ++i) {
      u_.push_back(sample.u[static_cast<std::size_t>(i)] - plant_.u_operating[i]);
    }
    ++samples_;
  }

  void end_stretch() {
    if (samples_ > 0) {
      recorded_.stretches.push_back({Eigen::MatrixXd::Map(y_.data(), plant_.q(), samples_),
                                     Eigen::MatrixXd::Map(u_.data(), plant_.m(), samples_)});
    }
    samples_ = 0;
    y_.clear();
    u_.clear();
  }

  const std::string& file_;
  const PlantModel& plant_;
  RecordedSamples& recorded_;
  RunParts parts_;
  std::vector<double> y_, u_;  // of the stretch, sample by sample
  Eigen::Index samples_ = 0;
  std::int64_t next_cycle_ = -1;
};

}  // namespace

RecordedSamples read_recorded_samples(const std::vector<std::string>& logs,
                                      const PlantModel& plant) {
  RecordedSamples recorded;
  for (const std::string& file : logs) {
    const std::size_t before = recorded.stretches.size();
    LogFiles log({file});
    SampleReader reader(file, plant, recorded);
    while (const LogEvent* event = log.next()) reader.take(*event);
    reader.finish();
    for (const FileDamage& damage : log.damages()) {
      recorded.remarks.push_back(describe(damage.file, damage.damage));
    }
    if (recorded.stretches.size() == before) {
      throw std::invalid_argument(
          fmt::format("{}: found no good sample (channel {}), expected the log of a run or of "
                      "`faultline diagnose`",
                      file, kSampleChannel));
    }
  }
  return recorded;
}

}  // namespace faultline
