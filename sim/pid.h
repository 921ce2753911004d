#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include <Eigen/Core>

#include "sim/command_base.h"
#include "sim/control_design.h"
#include "sim/controller.h"
#include "sim/reference.h"

namespace faultline {

/// What keeps the integral from running away while the actuator is at its limit.
enum class AntiWindup {
  kBackCalculation,  ///< what the limit cut off leads the integral back, within T_t
  kClamping,         ///< the integral waits while the error pushes further into the limit
};

/// One loop, from an output to an input, in the parallel form with a filtered derivative of the
/// output (Åström, Hägglund: Advanced PID Control, 2006, chapters 3 and 13), e = y_ref - y:
///
///   u = K_p (e + ∫e/T_i dt - T_d s/(1 + s T_d/N) y)
struct PidLoop {
  Eigen::Index output = 0, input = 0;
  double K_p = 0.0;             ///< negative where the output falls as the input rises
  std::optional<double> T_i_s;  ///< absent: no integral
  std::optional<double> T_d_s;  ///< absent: no derivative
  double N = 10.0;              ///< derivative gain at high frequency: the filter's T_d/N
  AntiWindup anti_windup = AntiWindup::kBackCalculation;
  std::optional<double> T_t_s;  ///< of back calculation; absent: √(T_i T_d), T_i without derivative
};

/// PID loops side by side; an input without a loop gets its CommandBase.
struct PidLaw {
  std::vector<PidLoop> loops;  ///< one per input at most
  CommandBase base;
  Reference reference;
  double sample_time_s = 1.0;
};

/// Within its limits and far from its start. ξ = (integral, derivative, y before), loop by loop.
[[nodiscard]] LinearController linear_form(const PidLaw& law);

/// A PidLaw at work: derivative by backward, integral by forward differences over the cycles that
/// have passed, however many. It begins without a bump: with integral action the first command is
/// u₀ + v whatever the error; so it does anew where k goes back or more than kMaxMissingCycles
/// ahead.
class Pid final : public Controller {
 public:
  explicit Pid(PidLaw law);
  void command(std::uint32_t k, std::span<const double> y, std::span<double> u) noexcept override;

 private:
  struct Memory {
    double integral = 0.0, derivative = 0.0;  ///< shares of u
    double y = 0.0, e = 0.0;                  ///< of the last cycle
    double excess = 0.0;                      ///< u asked for - u within limits, then
  };
  void begin(const PidLoop& loop, Memory& memory, double y, double e) const noexcept;
  static void advance(const PidLoop& loop, Memory& memory, double y, double elapsed_s) noexcept;

  PidLaw law_;
  std::vector<Memory> memories_;  ///< per loop
  bool has_begun_ = false;
  std::uint32_t k_ = 0;
  Eigen::VectorXd u_, u_asked_, y_ref_;
};

}  // namespace faultline
