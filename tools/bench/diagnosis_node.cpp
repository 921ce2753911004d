#include "tools/bench/diagnosis_node.h"

#include <algorithm>

#include <fmt/format.h>

namespace faultline {
namespace {

template <class From, class To>
void copy_into(const From& from, To& to) noexcept {
  std::copy(from.begin(), from.end(), to.begin());
}

bool has_stale(std::span<const std::uint8_t> is_fresh) noexcept {
  return std::find(is_fresh.begin(), is_fresh.end(), std::uint8_t{0}) != is_fresh.end();
}

}  // namespace

DiagnosisRecord::DiagnosisRecord(const Bank& bank)
    : y(bank.output_names.size()),
      u(bank.input_names.size()),
      y_is_fresh(bank.output_names.size()),
      u_is_fresh(bank.input_names.size()),
      y_state(bank.output_names.size()),
      u_state(bank.input_names.size()),
      y_age(bank.output_names.size()),
      u_age(bank.input_names.size()),
      residual(static_cast<std::size_t>(bank.residual_rows())),
      evaluation(bank.filters.size()),
      thresholds(bank.filters.size()),
      row_thresholds(residual.size(), ResidualBank::kNoThreshold),
      fired(bank.filters.size()) {}

std::string blame_text(const DiagnosisRecord& record) {
  if (record.fault == MessageFault::kNone) return "";
  if (record.blamed_message.empty()) return "no frames";
  return fmt::format("{}: {}", record.blamed_message, message_fault_name(record.fault));
}

DiagnosisNode::DiagnosisNode(const SignalMap& map, const Bank& bank, bool is_initial_state_known)
    : sampler_(map),
      bank_(bank),
      evaluator_(bank),
      table_(bank),
      settling_(bank.decision, evaluator_.signature().size()),
      onset_(evaluator_.signature().size()),
      record_(bank) {
  message_names_.reserve(map.message_count());
  for (std::size_t message = 0; message < map.message_count(); ++message) {
    message_names_.push_back(map.message_name(message));
  }
  if (!is_initial_state_known) evaluator_.contaminate_start();
}

void DiagnosisNode::on_frame(const CanFrame& frame, DiagnosisSink& sink) noexcept {
  sink.on_received(frame);
  sampler_.push(frame);
  take_samples(sink);
}

void DiagnosisNode::finish(DiagnosisSink& sink) noexcept {
  sampler_.finish();
  take_samples(sink);
}

void DiagnosisNode::take_samples(DiagnosisSink& sink) noexcept {
  while (const Sample* sample = sampler_.take()) on_sample(*sample, sink);
}

void DiagnosisNode::mark_contamination(const Sample& sample) noexcept {
  if ((sample.flags & kSampleReset) != 0) {
    bank_.reset();
    evaluator_.reset();
    settling_.reset();
    onset_.reset();
    evaluator_.contaminate_start();
  }
  if ((sample.flags & kBadSample & ~kSampleReset) == 0) return;
  // Where the sampler cannot say which value is wrong (a repeated or late frame), all may be.
  if (has_stale(sample.y_is_fresh) || has_stale(sample.u_is_fresh)) {
    evaluator_.contaminate(sample.y_is_fresh, sample.u_is_fresh);
  } else {
    evaluator_.contaminate_all();
  }
}

void DiagnosisNode::find_blame(const Sample& sample, const Decision& announced) noexcept {
  if (announced.verdict != Verdict::kInhibited) {
    blame_ = {};
  } else if (blame_.fault == MessageFault::kNone) {
    blame_ = sample.blame;
  }
  record_.fault = blame_.fault;
  record_.blamed_message = blame_.message == Blame::kNoMessage
                               ? std::string_view()
                               : std::string_view(message_names_[blame_.message]);
}

std::vector<MessageCounters> DiagnosisNode::message_counters() const {
  std::vector<MessageCounters> counters;
  for (std::size_t message = 0; message < message_names_.size(); ++message) {
    counters.push_back(sampler_.message_counters(message));
  }
  return counters;
}

void DiagnosisNode::on_sample(const Sample& sample, DiagnosisSink& sink) noexcept {
  sink.on_stage(DiagnosisStage::kDecoded);
  mark_contamination(sample);
  bank_.step(sample.y, sample.u);
  sink.on_stage(DiagnosisStage::kStepped);
  evaluator_.step(bank_.evaluation(), bank_.thresholds());
  bank_.restart_tests(evaluator_.contaminated());
  const Decision decision = evaluator_.is_any_contaminated()
                                ? Decision{.verdict = Verdict::kInhibited}
                                : table_.decide(evaluator_.signature(), evaluator_.persistent());
  const Decision& announced = settling_.step(decision, evaluator_.signature());
  if (!is_same_verdict(announced, record_.decision)) record_.since_cycle = sample.cycle;
  record_.onset = onset_.step(settling_, evaluator_, sample.cycle);
  find_blame(sample, announced);
  sink.on_stage(DiagnosisStage::kDecided);

  record_.cycle = sample.cycle;
  record_.command_cycle = sample.command_cycle;
  record_.flags = sample.flags;
  record_.stamp = sample.stamp;
  record_.decision = announced;
  copy_into(sample.y, record_.y);
  copy_into(sample.u, record_.u);
  copy_into(sample.y_is_fresh, record_.y_is_fresh);
  copy_into(sample.u_is_fresh, record_.u_is_fresh);
  copy_into(sample.y_state, record_.y_state);
  copy_into(sample.u_state, record_.u_state);
  copy_into(sample.y_age, record_.y_age);
  copy_into(sample.u_age, record_.u_age);
  record_.bad_frames = sampler_.counters().bad_frames();
  record_.missing_messages = sampler_.counters().missing_messages;
  copy_into(bank_.residual(), record_.residual);
  copy_into(bank_.evaluation(), record_.evaluation);
  copy_into(bank_.thresholds(), record_.thresholds);
  copy_into(bank_.row_thresholds(), record_.row_thresholds);
  copy_into(evaluator_.fired(), record_.fired);
  sink.on_record(record_);
}

}  // namespace faultline
