#include "sim/plants/three_tank.h"

#include <algorithm>
#include <cmath>

namespace faultline {
namespace {

constexpr std::size_t kTanks = 3;

double pump(double commanded) noexcept {
  return std::clamp(commanded, 0.0, ThreeTank::kPumpMost_ml_s);
}

// Area of an opening of `leak_mm2`.
constexpr double leak(double leak_mm2) noexcept { return leak_mm2 / 100.0; }

// A full tank runs over, an empty one has nothing to give.
double level_rate(double level_cm, double net_flow_ml_s) noexcept {
  const bool runs_over = level_cm >= ThreeTank::kRim_cm && net_flow_ml_s > 0.0;
  const bool is_empty = level_cm <= 0.0 && net_flow_ml_s < 0.0;
  return runs_over || is_empty ? 0.0 : net_flow_ml_s / ThreeTank::kTankArea_cm2;
}

}  // namespace

double ThreeTank::torricelli(double head_cm) noexcept {
  const double size_cm = std::abs(head_cm);
  if (size_cm >= kLaminarHead_cm) {
    return std::copysign(std::sqrt(2.0 * kGravity_cm_s2 * size_cm), head_cm);
  }
  // Value and slope at s = 1 are those of √s: c_1 + c_3 = 1, c_1 + 3 c_3 = 1/2.
  constexpr double c_1 = 1.25;
  constexpr double c_3 = -0.25;
  const double s = head_cm / kLaminarHead_cm;
  return std::sqrt(2.0 * kGravity_cm_s2 * kLaminarHead_cm) * s * (c_1 + c_3 * s * s);
}

void ThreeTank::derivative(const double* x, const double* u, const double* p, const double* d,
                           double* dx) {
  const double h1 = x[0];
  const double h2 = x[1];
  const double h3 = x[2];
  const double Q13 = (1.0 - p[3]) * kOutflow13 * kPipeArea_cm2 * torricelli(h1 - h3);
  const double Q32 = (1.0 - p[4]) * kOutflow32 * kPipeArea_cm2 * torricelli(h3 - h2);
  const double Q20 = (1.0 - p[5]) * kOutflow20 * kPipeArea_cm2 * torricelli(h2);
  dx[0] = level_rate(h1, pump(u[0]) - Q13 - leak(p[0]) * torricelli(h1));
  dx[1] = level_rate(h2, pump(u[1]) + Q32 - Q20 - leak(p[1]) * torricelli(h2));
  dx[2] = level_rate(h3, Q13 - Q32 + d[0] - leak(p[2]) * torricelli(h3));
}

void ThreeTank::measure(const double* x, const double* /*u*/, const double* /*p*/, const double* d,
                        double* y) {
  for (std::size_t i = 0; i < kTanks; ++i) y[i] = x[i] + d[1 + i];
}

void ThreeTank::events(const double* x, const double* /*u*/, const double* /*p*/,
                       const double* /*d*/, double* g) {
  for (std::size_t i = 0; i < kTanks; ++i) g[i] = kRim_cm - x[i];
  const double heads_cm[] = {x[0] - x[2], x[2] - x[1], x[0], x[1], x[2]};
  std::size_t event = kTanks;
  for (const double head_cm : heads_cm) g[event++] = std::abs(head_cm) - kLaminarHead_cm;
}

void ThreeTank::on_event(std::size_t event, const double* /*u*/, const double* /*p*/,
                         const double* /*d*/, double* x) {
  if (event < kTanks) x[event] = std::min(x[event], kRim_cm);
}

}  // namespace faultline
