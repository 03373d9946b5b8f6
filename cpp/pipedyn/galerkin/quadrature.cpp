// SPDX-License-Identifier: MIT
#include "pipedyn/galerkin/quadrature.hpp"

#include <numbers>
#include <stdexcept>
#include <utility>

namespace pipedyn {

Quadrature::Quadrature(Index count) {
  if (count < 1) throw std::invalid_argument("a quadrature must have at least one node");
  node.resize(count);
  weight.resize(count);
  expansion.resize(count, count);
  const double degree = static_cast<double>(count);
  for (Index i = 0; i < count; ++i) {
    // Newton's method on P_count from the classical guesses, in descending order.
    double x = std::cos(std::numbers::pi * (static_cast<double>(i) + 0.75) / (degree + 0.5));
    double slope = 1.0;
    for (int step = 0; step < 6; ++step) {
      double value = x, before = 1.0;
      for (Index k = 2; k <= count; ++k) {
        const double order = static_cast<double>(k);
        const double next = ((2.0 * order - 1.0) * x * value - (order - 1.0) * before) / order;
        before = std::exchange(value, next);
      }
      slope = degree * (before - x * value) / ((1.0 - x) * (1.0 + x));
      x -= value / slope;
    }
    const Index p = count - 1 - i;
    node[p] = 0.5 * (1.0 + x);
    weight[p] = 1.0 / ((1.0 - x) * (1.0 + x) * slope * slope);
    double value = 1.0, before = 0.0;
    for (Index k = 0; k < count; ++k) {
      const double order = static_cast<double>(k);
      expansion(k, p) = (2.0 * order + 1.0) * weight[p] * value;
      const double next = ((2.0 * order + 1.0) * x * value - order * before) / (order + 1.0);
      before = std::exchange(value, next);
    }
  }
}

Matrix Quadrature::integral_to(const Vector& s) const {
  Matrix integrals(s.size(), size());
  for (Index i = 0; i < s.size(); ++i) legendre_integrals(s[i], size(), integrals.row(i).data());
  return integrals * expansion;
}

Matrix legendre_recurrence(Index count) {
  Matrix recurrence(count, 3);
  for (Index k = 0; k < count; ++k) {
    const double order = static_cast<double>(k), twice = 2.0 * order + 1.0;
    recurrence.row(k) << twice / (order + 1.0), order / (order + 1.0), 0.5 / twice;
  }
  return recurrence;
}

void legendre_integrals(double s, Index count, double* out) {
  const double x = 2.0 * s - 1.0;
  double before = 1.0, value = x;  // P_{k-1}, P_k
  out[0] = s;
  for (Index k = 1; k < count; ++k) {
    const double order = static_cast<double>(k), twice = 2.0 * order + 1.0;
    const double next = (twice * x * value - order * before) / (order + 1.0);
    out[k] = (next - before) / (2.0 * twice);
    before = std::exchange(value, next);
  }
}

}  // namespace pipedyn
