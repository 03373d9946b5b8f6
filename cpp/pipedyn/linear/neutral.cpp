// SPDX-License-Identifier: MIT
#include "pipedyn/linear/neutral.hpp"

#include <algorithm>
#include <cmath>

namespace pipedyn {

namespace {

/// Share of its norm by which a matrix may be off. The larger share serves where no residual tells
/// how much eigenvectors that are far from orthogonal amplify that error: next to divergence 110
/// eps was measured.
constexpr double of_norm = 40.0 * eps, of_any_norm = 1000.0 * eps;

/// Rounding of shift + 1 / mu, relative to lambda.
constexpr double of_value = 1e-14;

/// Largest |lambda| of a root that may be one of two that are a double zero.
constexpr double double_zero = 1e-6;

/// Distance of an eigenvalue to the shift below which a smaller distance makes no difference.
constexpr double least_distance = 1e-3;

}  // namespace

void rounding_about(const Values& values, double shift, bool assessed, Reals& found) {
  double nearest = infinite;
  for (const Complex value : values) {
    nearest = std::min(nearest, std::max(std::abs(value - shift), least_distance));
  }
  const auto lost = [=](Complex value) {
    const double size = std::abs(value);
    if (assessed) return of_value * size + of_norm / nearest * std::norm(value);
    if (size <= double_zero) return double_zero;
    return of_value * size + of_any_norm / nearest * std::norm(value - shift) / std::min(size, 1.0);
  };
  found = values.unaryExpr(lost);
}

}  // namespace pipedyn
