#include "tools/bench/diagnosis_node.h"

#include <algorithm>

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
      residual(static_cast<std::size_t>(bank.residual_rows())),
      evaluation(bank.filters.size()),
      fired(bank.filters.size()) {}

DiagnosisNode::DiagnosisNode(const SignalMap& map, const Bank& bank, bool is_initial_state_known)
    : sampler_(map),
      bank_(bank),
      evaluator_(bank),
      table_(bank),
      settling_(bank.decision.settle, evaluator_.signature().size()),
      onset_(evaluator_.signature().size()),
      record_(bank) {
  if (!is_initial_state_known) evaluator_.contaminate_all();
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
    evaluator_.contaminate_all();
  } else if (!sample.is_good()) {
    // Where the sampler cannot say which value is wrong (a repeated or late frame), all may be.
    if (has_stale(sample.y_is_fresh) || has_stale(sample.u_is_fresh)) {
      evaluator_.contaminate(sample.y_is_fresh, sample.u_is_fresh);
    } else {
      evaluator_.contaminate_all();
    }
  }
}

void DiagnosisNode::on_sample(const Sample& sample, DiagnosisSink& sink) noexcept {
  mark_contamination(sample);
  bank_.step(sample.y, sample.u);
  evaluator_.step(bank_.evaluation());
  const Decision decision = evaluator_.is_any_contaminated()
                                ? Decision{.verdict = Verdict::kInhibited}
                                : table_.decide(evaluator_.signature());
  const Decision& announced = settling_.step(decision, evaluator_.signature());
  if (!is_same_verdict(announced, record_.decision)) record_.since_cycle = sample.cycle;
  record_.onset = onset_.step(settling_, evaluator_, sample.cycle);

  record_.cycle = sample.cycle;
  record_.command_cycle = sample.command_cycle;
  record_.flags = sample.flags;
  record_.stamp = sample.stamp;
  record_.decision = announced;
  copy_into(sample.y, record_.y);
  copy_into(sample.u, record_.u);
  copy_into(sample.y_is_fresh, record_.y_is_fresh);
  copy_into(sample.u_is_fresh, record_.u_is_fresh);
  copy_into(bank_.residual(), record_.residual);
  copy_into(bank_.evaluation(), record_.evaluation);
  copy_into(evaluator_.fired(), record_.fired);
  sink.on_record(record_);
}

}  // namespace faultline
