#pragma once

#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include "sim/integration.h"

namespace faultline {

/// dx/dt = f(x), all else held, as plain functions: nothing is virtual inside a step. `self` is
/// what the caller of Integrator::advance gave.
struct HeldEquations {
  std::size_t state_count = 0;
  void (*derivative)(void* self, const double* x, double* dx) = nullptr;
  std::size_t event_count = 0;  ///< 0: none, and both that follow are null
  void (*events)(void* self, const double* x, double* g) = nullptr;
  void (*on_event)(void* self, std::size_t event, double* x) = nullptr;
};

/// How an integrator got through a sample.
struct IntegrationResult {
  enum class Trouble : unsigned char {
    kNone,
    kStepsTooSmall,  ///< no step is small enough for the tolerances; `index`: the worst state
    kTooManyEvents,  ///< more than kMostEventsPerSample; `index`: the state that `event` looks at
    kRest,           ///< `event` happens without end where it has just happened; `index` as above
  };
  Trouble trouble = Trouble::kNone;
  std::size_t index = 0;       ///< a state
  std::size_t event = 0;       ///< the last one
  double into_sample_s = 0.0;  ///< where it gave up
};

/// A plant that meets more events in one sample chatters.
inline constexpr int kMostEventsPerSample = 200;

/// Takes x from one sample to the next.
///
/// An event is where one of g changes its sign. A method that finds one between the ends of a step
/// bisects for it (to 2^-48 of the step), calls on_event there, and begins anew from what that made
/// of x. Which side of g = 0 a plant is on behind an event is where f then leads it, so that a ball
/// is not hit twice by the same floor. A g that changes its sign twice within one step is not seen.
///
/// An event that merely switches something is gone on from, whichever way f then leads. One without
/// an end is not: a ball that comes to rest on its floor bounces infinitely often in finite time,
/// in ever shorter flights, and what lies behind that f and on_event do not say. Such a plant is
/// given up (kRest) where a flight has become too short to be told from the event before it, and
/// where on_event has stopped x on the surface and f leads on through it. on_event says that a
/// plant stays where it has been stopped by changing what f is there, by a state of its own if need
/// be.
///
/// A step that finds an event has looked behind it: where f itself jumps there, that step is only
/// as good as it is long. A mode that on_event sets, a state that is otherwise constant, costs
/// nothing.
///
/// Runge-Kutta 4 looks for an event by repeating its step, shortened; Dormand-Prince on its dense
/// output (order 4), without evaluating f.
class Integrator {
 public:
  virtual ~Integrator() = default;
  /// x_k+1 in place of x_k. What is found not finite is left so: nobody is asked to go on from
  /// there. Real-time: neither allocates nor throws.
  virtual IntegrationResult advance(void* self, double* x) noexcept = 0;
  /// Forgets what the samples so far have left: the step's length, sides of surfaces.
  virtual void reset() noexcept = 0;

 protected:
  Integrator() = default;
  Integrator(const Integrator&) = default;
  Integrator& operator=(const Integrator&) = default;
};

/// Sizes everything. @pre method is kRk4 or kDormandPrince
[[nodiscard]] std::unique_ptr<Integrator> make_integrator(const HeldEquations& equations,
                                                          double sample_time_s,
                                                          IntegrationMethod method,
                                                          const Integration& integration);

/// What was wrong, in words; empty if nothing was. "level1: the integrator's steps became too
/// small 0.002 s into the sample".
[[nodiscard]] std::string trouble_text(const IntegrationResult& result,
                                       const std::vector<std::string>& state_names);

}  // namespace faultline
