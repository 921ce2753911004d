#include "diagnosis/runtime/evaluator.h"

#include <algorithm>
#include <cassert>

namespace faultline {
namespace {

constexpr std::size_t kBitsPerWord = 64;

// Per channel: does it enter the state equation, the residual or a Lipschitz term?
std::vector<std::uint8_t> used_channels(const Eigen::MatrixXd& state,
                                        const Eigen::MatrixXd& residual,
                                        const std::vector<FilterNonlinearity>& terms,
                                        Eigen::VectorXd FilterNonlinearity::*a) {
  std::vector<std::uint8_t> used(static_cast<std::size_t>(residual.cols()));
  for (Eigen::Index j = 0; j < residual.cols(); ++j) {
    const bool is_used =
        (state.col(j).array() != 0.0).any() || (residual.col(j).array() != 0.0).any() ||
        std::any_of(terms.begin(), terms.end(),
                    [&](const FilterNonlinearity& term) { return (term.*a)[j] != 0.0; });
    used[static_cast<std::size_t>(j)] = is_used ? 1 : 0;
  }
  return used;
}

bool is_any_stale(const std::vector<std::uint8_t>& uses,
                  std::span<const std::uint8_t> is_fresh) noexcept {
  for (std::size_t j = 0; j < uses.size(); ++j) {
    if (uses[j] != 0 && is_fresh[j] == 0) {
      return true;
    }
  }
  return false;
}

}  // namespace

Evaluator::Evaluator(const Bank& bank)
    : dwell_(std::max<std::uint32_t>(bank.decision.dwell, 1)),
      contaminated_for_(bank.filters.size()),
      is_contaminated_(bank.filters.size()),
      run_length_(bank.filters.size()),
      fired_(bank.filters.size()),
      fired_for_(bank.filters.size()),
      signature_((bank.filters.size() + kBitsPerWord - 1) / kBitsPerWord),
      persistent_(signature_.size()),
      crossed_at_(bank.filters.size()) {
  for (const ResidualFilter& filter : bank.filters) {
    forget_samples_.push_back(filter.forget_samples);
    transient_samples_.push_back(filter.transient_samples);
    has_course_.push_back(filter.course ? 1 : 0);
    uses_y_.push_back(
        used_channels(filter.E, filter.H, filter.nonlinearities, &FilterNonlinearity::a_y));
    uses_u_.push_back(
        used_channels(filter.G, filter.K, filter.nonlinearities, &FilterNonlinearity::a_u));
  }
}

void Evaluator::contaminate_start() noexcept {
  for (std::size_t i = 0; i < fired_.size(); ++i) {
    if (has_course_[i] == 0) {
      contaminate_residual(i);
    }
  }
}

void Evaluator::contaminate_all() noexcept {
  for (std::size_t i = 0; i < fired_.size(); ++i) {
    contaminate_residual(i);
  }
}

void Evaluator::contaminate(std::span<const std::uint8_t> y_is_fresh,
                            std::span<const std::uint8_t> u_is_fresh) noexcept {
  for (std::size_t i = 0; i < fired_.size(); ++i) {
    assert(y_is_fresh.size() == uses_y_[i].size() && u_is_fresh.size() == uses_u_[i].size());
    if (is_any_stale(uses_y_[i], y_is_fresh) || is_any_stale(uses_u_[i], u_is_fresh)) {
      contaminate_residual(i);
    }
  }
}

void Evaluator::contaminate_residual(std::size_t i) noexcept {
  if (contaminated_for_[i] == 0 && forget_samples_[i] > 0) {
    ++contaminated_count_;
  }
  contaminated_for_[i] = forget_samples_[i];
}

void Evaluator::step(std::span<const double> evaluation,
                     std::span<const double> thresholds) noexcept {
  assert(evaluation.size() == fired_.size() && thresholds.size() == fired_.size());
  contaminated_count_ = 0;
  ++sample_count_;
  for (std::size_t i = 0; i < fired_.size(); ++i) {
    is_contaminated_[i] = contaminated_for_[i] > 0 ? 1 : 0;
    if (is_contaminated_[i] != 0) {
      --contaminated_for_[i];
      ++contaminated_count_;
      run_length_[i] = 0;
      set_fired_for(i, 0);
      continue;
    }
    // Written so that a NaN counts as above: a broken filter must not look healthy.
    take(i, !(evaluation[i] <= thresholds[i]));
  }
}

void Evaluator::take(std::size_t i, bool is_above) noexcept {
  const bool is_fired = fired_[i] != 0;
  run_length_[i] = is_above == is_fired ? 0 : run_length_[i] + 1;
  if (run_length_[i] >= dwell_) {
    run_length_[i] = 0;
    fired_[i] = is_above ? 1 : 0;
    crossed_at_[i] = sample_count_ - (dwell_ - 1);
    signature_[i / kBitsPerWord] ^= std::uint64_t{1} << (i % kBitsPerWord);
  }
  if (transient_samples_[i] > 0) {
    const bool is_counted = fired_for_[i] > transient_samples_[i];
    set_fired_for(i, fired_[i] == 0 ? 0 : fired_for_[i] + (is_counted ? 0 : 1));
  }
}

void Evaluator::set_fired_for(std::size_t i, std::uint32_t samples) noexcept {
  fired_for_[i] = samples;
  const std::uint64_t bit = std::uint64_t{1} << (i % kBitsPerWord);
  if (transient_samples_[i] > 0 && samples > transient_samples_[i]) {
    persistent_[i / kBitsPerWord] |= bit;
  } else {
    persistent_[i / kBitsPerWord] &= ~bit;
  }
}

void Evaluator::reset() noexcept {
  std::fill(contaminated_for_.begin(), contaminated_for_.end(), 0);
  std::fill(is_contaminated_.begin(), is_contaminated_.end(), std::uint8_t{0});
  std::fill(run_length_.begin(), run_length_.end(), 0);
  std::fill(fired_.begin(), fired_.end(), std::uint8_t{0});
  std::fill(fired_for_.begin(), fired_for_.end(), 0);
  std::fill(signature_.begin(), signature_.end(), 0);
  std::fill(persistent_.begin(), persistent_.end(), 0);
  std::fill(crossed_at_.begin(), crossed_at_.end(), 0);
  sample_count_ = 0;
  contaminated_count_ = 0;
}

}  // namespace faultline
