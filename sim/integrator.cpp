#include "sim/integrator.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>

#include <boost/numeric/odeint/stepper/controlled_runge_kutta.hpp>
#include <boost/numeric/odeint/stepper/runge_kutta4.hpp>
#include <boost/numeric/odeint/stepper/runge_kutta_dopri5.hpp>
#include <fmt/format.h>

namespace faultline {
namespace {

namespace odeint = boost::numeric::odeint;
using State = std::vector<double>;

// 2^-48 of a step is 4e-15 of it: what is left of a double once t has been added.
constexpr int kBisections = 48;
// How far ahead, in samples, f is followed to see which side of an event function it leads to: far
// enough to tell it from what bisection leaves, too short for anything else to happen.
constexpr double kLookAhead = 1e-6;
// How often, and how many times as far each time, f is followed where it leads along a surface at
// first: to a tenth of a sample.
constexpr int kLooksAhead = 6;
constexpr double kFartherAhead = 10.0;
// An event within this part of what is left is at the beginning of it, as bisection sees it.
constexpr double kAtOnce = 0x1p-44;
// By which part a state is moved to see what an event function depends on.
constexpr double kNudge = 1e-6;
// A step below this part of a sample is lost when t is added.
constexpr double kLeastStep = 1e-14;
// Steps in one sample before Dormand-Prince gives up: a stiff plant must not stop a bench's clock.
constexpr int kMostSteps = 100'000;
// What the step is multiplied with where f leads out of the finite numbers.
constexpr double kRetreat = 0.1;

bool are_finite(const State& x) noexcept {
  return std::all_of(x.begin(), x.end(), [](double value) { return std::isfinite(value); });
}

/// Which side of zero each event function is on.
class EventSides {
 public:
  using Trouble = IntegrationResult::Trouble;

  EventSides(const HeldEquations& equations, double look_ahead_s)
      : equations_(equations),
        look_ahead_s_(look_ahead_s),
        g_(equations.event_count),
        g_ahead_(equations.event_count),
        side_(equations.event_count),
        was_(equations.event_count),
        leads_through_(equations.event_count),
        is_fresh_(equations.event_count, false),
        slope_(equations.state_count),
        ahead_(equations.state_count),
        before_(equations.state_count) {}

  [[nodiscard]] bool is_empty() const noexcept { return side_.empty(); }

  void reset() noexcept {
    std::fill(side_.begin(), side_.end(), std::int8_t{0});
    std::fill(is_fresh_.begin(), is_fresh_.end(), false);
  }

  /// A sample begins at x. What was held may have changed: that is no event. What lies on a surface
  /// keeps its side, unless it has just been put there and f now leads elsewhere.
  void begin(void* self, const State& x) noexcept {
    if (is_empty()) return;
    count_ = 0;
    equations_.events(self, x.data(), g_.data());
    const bool has_fresh = std::find(is_fresh_.begin(), is_fresh_.end(), true) != is_fresh_.end();
    if (has_fresh) look_ahead(self, x);
    for (std::size_t i = 0; i < side_.size(); ++i) {
      const std::int8_t side = sign(is_fresh_[i] ? g_ahead_[i] - g_[i] : g_[i]);
      if (side != 0) side_[i] = side;
    }
    decide(self, x);
  }

  [[nodiscard]] bool have_changed(void* self, const State& x) noexcept {
    equations_.events(self, x.data(), g_.data());
    for (std::size_t i = 0; i < side_.size(); ++i) {
      if (has_changed(i)) return true;
    }
    return false;
  }

  /// A step without an event ended where have_changed has just looked.
  void settle() noexcept {
    for (std::size_t i = 0; i < side_.size(); ++i) {
      if (side_[i] == 0) side_[i] = sign(g_[i]);
      is_fresh_[i] = false;
    }
  }

  /// Calls on_event for all that have changed at x, which lies `part` of the way that was left
  /// behind the last event or the step's beginning.
  Trouble handle(void* self, State& x, double part) noexcept {
    equations_.events(self, x.data(), g_.data());
    const bool is_at_once = part <= kAtOnce;
    bool comes_again = false;
    for (std::size_t i = 0; i < side_.size(); ++i) {
      was_[i] = has_changed(i) ? side_[i] : std::int8_t{0};
      if (was_[i] != 0) {
        last_ = i;
        comes_again = comes_again || (is_at_once && is_fresh_[i]);
      }
      // Behind an event at once, x is still where the one before has left it.
      is_fresh_[i] = was_[i] != 0 || (is_at_once && is_fresh_[i]);
    }
    if (comes_again) return Trouble::kRest;
    look_ahead(self, x);
    for (std::size_t i = 0; i < side_.size(); ++i) {
      leads_through_[i] = sign(g_ahead_[i] - g_[i]) == -was_[i];
    }
    std::copy(x.begin(), x.end(), before_.begin());
    for (std::size_t i = 0; i < side_.size(); ++i) {
      if (was_[i] != 0) equations_.on_event(self, i, x.data());
    }
    if (++count_ > kMostEventsPerSample) return Trouble::kTooManyEvents;
    // One event may move the state across another's surface: that is its doing, and no event.
    equations_.events(self, x.data(), g_.data());
    for (std::size_t i = 0; i < side_.size(); ++i) side_[i] = is_fresh_[i] ? 0 : sign(g_[i]);
    decide(self, x, x != before_);
    return has_stopped_ ? Trouble::kRest : Trouble::kNone;
  }

  [[nodiscard]] std::size_t last() const noexcept { return last_; }

  /// The state that moves the last event's function most.
  [[nodiscard]] std::size_t state_of_last(void* self, const State& x) noexcept {
    equations_.events(self, x.data(), g_.data());
    std::size_t state = 0;
    double most = -1.0;
    for (std::size_t i = 0; i < x.size(); ++i) {
      std::copy(x.begin(), x.end(), ahead_.begin());
      const double change = kNudge * std::max(std::abs(x[i]), 1.0);
      ahead_[i] += change;
      equations_.events(self, ahead_.data(), g_ahead_.data());
      const double moved = std::abs(g_ahead_[last_] - g_[last_]) / change;
      if (moved > most) {
        most = moved;
        state = i;
      }
    }
    return state;
  }

 private:
  static std::int8_t sign(double value) noexcept {
    return static_cast<std::int8_t>((value > 0.0) - (value < 0.0));
  }
  [[nodiscard]] bool has_changed(std::size_t i) const noexcept {
    return side_[i] != 0 && sign(g_[i]) == -side_[i];
  }
  /// The sides that are open become those which f leads to: by its direction, and where that lies
  /// in the surface, by what two steps along it make of it, ever farther ahead. @pre g_ is at x
  void decide(void* self, const State& x, bool is_new_state = false) noexcept {
    has_stopped_ = false;
    if (!has_open_side()) return;
    look_ahead(self, x);
    choose_sides(is_new_state, true);
    double half_s = 0.5 * look_ahead_s_;
    for (int i = 0; i < kLooksAhead && has_open_side(); ++i, half_s *= kFartherAhead) {
      equations_.derivative(self, x.data(), slope_.data());
      for (std::size_t j = 0; j < x.size(); ++j) ahead_[j] = x[j] + half_s * slope_[j];
      equations_.derivative(self, ahead_.data(), slope_.data());
      for (std::size_t j = 0; j < x.size(); ++j) ahead_[j] += half_s * slope_[j];
      equations_.events(self, ahead_.data(), g_ahead_.data());
      choose_sides(is_new_state, false);
    }
  }
  [[nodiscard]] bool has_open_side() const noexcept {
    return std::find(side_.begin(), side_.end(), std::int8_t{0}) != side_.end();
  }
  void look_ahead(void* self, const State& x) noexcept {
    equations_.derivative(self, x.data(), slope_.data());
    for (std::size_t i = 0; i < x.size(); ++i) ahead_[i] = x[i] + look_ahead_s_ * slope_[i];
    equations_.events(self, ahead_.data(), g_ahead_.data());
  }
  /// By g_ahead_. What has been turned to lead through its surface was on its way back from it, but
  /// too slowly for x to show it; and what has been stopped on its surface must not be led through
  /// it later. Both are a ball in its floor.
  void choose_sides(bool is_new_state, bool is_direction) noexcept {
    for (std::size_t i = 0; i < side_.size(); ++i) {
      if (side_[i] != 0) continue;
      side_[i] = sign(g_ahead_[i] - g_[i]);
      if (!is_new_state || was_[i] == 0 || side_[i] != -was_[i]) continue;
      if (is_direction && leads_through_[i]) continue;  // as it was led before the event
      last_ = i;
      has_stopped_ = true;
    }
  }

  HeldEquations equations_;
  double look_ahead_s_;
  State g_, g_ahead_;
  std::vector<std::int8_t> side_;    // 0: on the surface, and led nowhere
  std::vector<std::int8_t> was_;     // side before the event that is being handled; 0: it has none
  std::vector<bool> leads_through_;  // did f before the event
  std::vector<bool> is_fresh_;       // handled, and x has not moved on since
  State slope_, ahead_, before_;
  bool has_stopped_ = false;
  int count_ = 0;
  std::size_t last_ = 0;
};

/// The smallest part of (0, most] at which events have changed, as `move(part)` makes x of it.
/// @pre they have at `most`
template <class Move>
double locate(EventSides& sides, void* self, const State& x, double most, const Move& move) {
  double before = 0.0;
  double behind = most;
  for (int i = 0; i < kBisections; ++i) {
    const double middle = 0.5 * (before + behind);
    move(middle);
    (sides.have_changed(self, x) ? behind : before) = middle;
  }
  return behind;
}

class RungeKutta4 final : public Integrator {
 public:
  RungeKutta4(const HeldEquations& equations, double sample_time_s, int substeps)
      : equations_(equations),
        step_s_(sample_time_s / static_cast<double>(substeps)),
        substeps_(substeps),
        sides_(equations, kLookAhead * sample_time_s),
        x_(equations.state_count),
        trial_(equations.state_count) {
    method_.adjust_size(x_);
    // Odeint sizes its memory once more in its first step: that must not be one of a run's.
    method_.do_step([](const State&, State& dx, double) { std::fill(dx.begin(), dx.end(), 0.0); },
                    x_, 0.0, step_s_);
  }

  IntegrationResult advance(void* self, double* x) noexcept override {
    std::copy_n(x, x_.size(), x_.begin());
    IntegrationResult result;
    if (sides_.is_empty()) {
      for (int i = 0; i < substeps_; ++i) step(self, x_, step_s_);
    } else {
      sides_.begin(self, x_);
      for (int i = 0; i < substeps_ && result.trouble == IntegrationResult::Trouble::kNone; ++i) {
        result = step_through_events(self, static_cast<double>(i) * step_s_);
      }
    }
    std::copy(x_.begin(), x_.end(), x);
    return result;
  }
  void reset() noexcept override { sides_.reset(); }

 private:
  void step(void* self, State& x, double step_s) noexcept {
    method_.do_step(
        [this, self](const State& at, State& dx, double /*t_s*/) {
          equations_.derivative(self, at.data(), dx.data());
        },
        x, 0.0, step_s);
  }

  IntegrationResult step_through_events(void* self, double from_s) noexcept {
    double left_s = step_s_;
    const auto go = [&](double part_s) {
      std::copy(x_.begin(), x_.end(), trial_.begin());
      step(self, trial_, part_s);
    };
    while (left_s > 0.0) {
      go(left_s);
      if (!sides_.have_changed(self, trial_)) {
        x_.swap(trial_);
        sides_.settle();
        return {};
      }
      const double at_s = locate(sides_, self, trial_, left_s, go);
      go(at_s);
      x_.swap(trial_);
      const auto trouble = sides_.handle(self, x_, at_s / left_s);
      left_s -= at_s;
      if (trouble != IntegrationResult::Trouble::kNone) {
        return {trouble, sides_.state_of_last(self, x_), sides_.last(), from_s + step_s_ - left_s};
      }
    }
    return {};
  }

  HeldEquations equations_;
  double step_s_;
  int substeps_;
  odeint::runge_kutta4<State> method_;
  EventSides sides_;
  State x_, trial_;
};

class DormandPrince final : public Integrator {
 public:
  DormandPrince(const HeldEquations& equations, double sample_time_s,
                const Integration& integration)
      : equations_(equations),
        sample_time_s_(sample_time_s),
        absolute_tolerance_(integration.absolute_tolerance),
        relative_tolerance_(integration.relative_tolerance),
        step_s_(sample_time_s),
        method_(Checker(integration.absolute_tolerance, integration.relative_tolerance)),
        sides_(equations, kLookAhead * sample_time_s),
        x_(equations.state_count),
        slope_(equations.state_count),
        x_next_(equations.state_count),
        slope_next_(equations.state_count),
        between_(equations.state_count) {
    // Sizes odeint's memory: its first step does so, and that must not be one of a run's.
    double t_s = 0.0;
    double step_s = sample_time_s;
    method_.try_step([](const State&, State& dx, double) { std::fill(dx.begin(), dx.end(), 0.0); },
                     x_, slope_, t_s, x_next_, slope_next_, step_s);
  }

  IntegrationResult advance(void* self, double* x) noexcept override {
    std::copy_n(x, x_.size(), x_.begin());
    sides_.begin(self, x_);
    equations_.derivative(self, x_.data(), slope_.data());
    double t_s = 0.0;
    IntegrationResult result;
    for (int steps = 0; t_s < sample_time_s_; ++steps) {
      const double step_s = try_step(self, t_s);
      if (step_s == 0.0 || steps == kMostSteps) {
        result = {IntegrationResult::Trouble::kStepsTooSmall, worst_state(), 0, t_s};
        break;
      }
      const auto trouble = take_step(self, t_s, step_s);
      if (trouble != IntegrationResult::Trouble::kNone) {
        result = {trouble, sides_.state_of_last(self, x_), sides_.last(), t_s};
        break;
      }
    }
    std::copy(x_.begin(), x_.end(), x);
    return result;
  }
  void reset() noexcept override {
    sides_.reset();
    step_s_ = sample_time_s_;
  }

 private:
  using Method = odeint::runge_kutta_dopri5<State>;
  using Checker =
      odeint::default_error_checker<double, Method::algebra_type, Method::operations_type>;

  /// From x_ to x_next_ by as much as the tolerances allow, at most to the sample's end.
  /// @return how far, 0 if nowhere
  double try_step(void* self, double t_s) noexcept {
    const auto f = [this, self](const State& at, State& dx, double /*t_s*/) {
      equations_.derivative(self, at.data(), dx.data());
    };
    const double left_s = sample_time_s_ - t_s;
    double step_s = std::min(step_s_, left_s);
    // What would be left must be worth a step of its own.
    if (left_s - step_s < kLeastStep * sample_time_s_) step_s = left_s;
    while (true) {
      const double tried_s = step_s;
      double local_s = 0.0;
      const auto outcome = method_.try_step(f, x_, slope_, local_s, x_next_, slope_next_, step_s);
      const bool is_finite = are_finite(x_next_) && are_finite(slope_next_);
      if (outcome == odeint::success && is_finite) {
        // A step that the sample's end has cut short says little about the next one.
        step_s_ = tried_s == left_s ? std::max(step_s, step_s_) : step_s;
        return tried_s;
      }
      if (!is_finite) step_s = kRetreat * tried_s;
      if (step_s < kLeastStep * sample_time_s_) return 0.0;
      step_s_ = step_s;
    }
  }

  /// x_ becomes x_next_, or where the first event before it leads; t_s follows.
  IntegrationResult::Trouble take_step(void* self, double& t_s, double step_s) noexcept {
    const double end_s = t_s + step_s >= sample_time_s_ ? sample_time_s_ : t_s + step_s;
    if (sides_.is_empty() || !sides_.have_changed(self, x_next_)) {
      x_.swap(x_next_);
      slope_.swap(slope_next_);
      sides_.settle();
      t_s = end_s;
      return IntegrationResult::Trouble::kNone;
    }
    const auto go = [&](double part_s) {
      method_.stepper().calc_state(part_s, between_, x_, slope_, 0.0, x_next_, slope_next_, step_s);
    };
    const double at_s = locate(sides_, self, between_, step_s, go);
    go(at_s);
    x_.swap(between_);
    t_s = at_s == step_s ? end_s : t_s + at_s;
    const auto trouble = sides_.handle(self, x_, at_s / step_s);
    equations_.derivative(self, x_.data(), slope_.data());
    return trouble;
  }

  /// The one that moves fastest, by its tolerance.
  [[nodiscard]] std::size_t worst_state() const noexcept {
    std::size_t worst = 0;
    double fastest = -1.0;
    for (std::size_t i = 0; i < x_.size(); ++i) {
      const double scale = absolute_tolerance_ + relative_tolerance_ * std::abs(x_[i]);
      double speed = std::abs(slope_[i]) / scale;
      if (!std::isfinite(speed)) speed = std::numeric_limits<double>::infinity();
      if (speed > fastest) {
        fastest = speed;
        worst = i;
      }
    }
    return worst;
  }

  HeldEquations equations_;
  double sample_time_s_, absolute_tolerance_, relative_tolerance_;
  double step_s_;  // what the last step says that the next may be
  odeint::controlled_runge_kutta<Method> method_;
  EventSides sides_;
  State x_, slope_, x_next_, slope_next_, between_;
};

}  // namespace

std::unique_ptr<Integrator> make_integrator(const HeldEquations& equations, double sample_time_s,
                                            IntegrationMethod method,
                                            const Integration& integration) {
  if (method == IntegrationMethod::kDormandPrince) {
    return std::make_unique<DormandPrince>(equations, sample_time_s, integration);
  }
  assert(method == IntegrationMethod::kRk4);
  return std::make_unique<RungeKutta4>(equations, sample_time_s, integration.substeps);
}

std::string trouble_text(const IntegrationResult& result,
                         const std::vector<std::string>& state_names) {
  using enum IntegrationResult::Trouble;
  switch (result.trouble) {
    case kNone:
      return {};
    case kStepsTooSmall:
      return fmt::format("{}: the integrator's steps became too small {:.6g} s into the sample",
                         state_names[result.index], result.into_sample_s);
    case kTooManyEvents:
      return fmt::format(
          "{}: event {}: more than {} events in one sample, {:.6g} s into it: the plant chatters",
          state_names[result.index], result.event + 1, kMostEventsPerSample, result.into_sample_s);
    case kRest:
      return fmt::format(
          "{}: event {} has brought it to rest {:.6g} s into the sample, and the equations do not "
          "say what holds it there",
          state_names[result.index], result.event + 1, result.into_sample_s);
  }
  return {};
}

}  // namespace faultline
