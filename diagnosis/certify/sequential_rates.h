#pragma once

#include <cstdint>

namespace faultline {

/// Average number of samples until a one-sided CUSUM g_k = max(0, g_k-1 + s_k - κ) first exceeds h,
/// from g = 0, of white s with unit variance and the given mean: the solution of
///
///   L(x) = 1 + L(0) Φ(κ - μ - x) + ∫_0^h L(y) φ(y - x + κ - μ) dy
///
/// by Gauss-Legendre quadrature (Vance, J. Qual. Technol. 18 (1986) 189-193). κ > 0, h > 0.
[[nodiscard]] double cusum_run_length(double reference, double threshold, double mean = 0.0);

/// The h at which it exceeds `rate` times per sample without a fault; rate < 0.1. Beyond 80 by
/// Siegmund's approximation (Sequential Analysis, 1985).
[[nodiscard]] double cusum_threshold(double reference, double rate);

/// How often per sample a windowed GLR statistic max_{1<=j<=window} (s_k-j+1 + .. + s_k)² / (2 j)
/// first exceeds h, of white s with unit variance: with b = √(2h), φ the normal density,
///
///   b φ(b) Σ_j b² / (2 j²) ν(b/√j)²,  1 <= j <= window
///
/// (Siegmund, Venkatraman, Ann. Statist. 23 (1995) 255-271, their integral as the sum that it
/// stands for; ν by Siegmund, Yakir, The Statistics of Gene Mapping, 2007). Asymptotic: within 15 %
/// where the rate is below 1e-3.
[[nodiscard]] double glr_rate(double threshold, std::uint32_t window);

/// The h at which it does so `rate` times per sample.
[[nodiscard]] double glr_threshold(std::uint32_t window, double rate);

}  // namespace faultline
