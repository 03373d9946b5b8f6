// SPDX-License-Identifier: MIT
#include "pipedyn/linear/neutral.hpp"

#include <algorithm>
#include <cmath>

namespace pipedyn {

namespace {

/// Share of its norm by which a matrix may be off, and the share where no residual tells what
/// eigenvectors that are far from orthogonal make of that: next to divergence 110 eps was measured.
constexpr double of_norm = 40.0 * eps, of_any_norm = 1000.0 * eps;

/// Rounding of shift + 1 / mu, relative to lambda.
constexpr double of_value = 1e-14;

/// |lambda| up to which two roots may be one double zero.
constexpr double double_zero = 1e-6;

/// Distance to the shift beyond which it makes no difference.
constexpr double least_distance = 1e-3;

}  // namespace

Reals rounding_about(const Values& values, double shift, bool assessed) {
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
  return values.unaryExpr(lost);
}

}  // namespace pipedyn
