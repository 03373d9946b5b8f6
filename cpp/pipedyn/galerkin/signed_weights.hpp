// SPDX-License-Identifier: MIT
//
// The quadrature of drag: weights (N,) that integrate sign(v) f for a smooth f, given v at the
// points. Each panel is cut at the zeros of v, and each zero is found on the cubic through the four
// points around it. If f has a double zero where v is zero, as in |v| v, the error of a zero enters
// the integral with its cube. A zero between the start of a panel and its first node is not
// detected, which gives an error with the cube of that distance, 1e-9 at 31 nodes. Costs O(N), and
// O(Q^2) for each panel with zeros.
//
// The file is local to each translation unit, like vector/pack.hpp.
#pragma once

#include "pipedyn/galerkin/integrals.hpp"

namespace {

/// Zero of the cubic through (x[k], v[k]), k < 4, between low and high, where the cubic changes
/// sign.
double cubic_zero(const double* x, const double* v, Count stride, double low, double high) {
  double d[4] = {v[0], v[stride], v[2 * stride], v[3 * stride]};
  for (int order = 1; order < 4; ++order) {
    for (int k = 3; k >= order; --k) d[k] = (d[k] - d[k - 1]) / (x[k] - x[k - order]);
  }
  const auto value = [&](double s) {
    return d[0] + (s - x[0]) * (d[1] + (s - x[1]) * (d[2] + (s - x[2]) * d[3]));
  };
  const bool rises = value(high) > 0.0;
  const double least = 1e-9 * (high - low);
  while (high - low > least) {
    const double middle = 0.5 * (low + high);
    ((value(middle) > 0.0) == rises ? high : low) = middle;
  }
  return 0.5 * (low + high);
}

/// Computes the weights from v at the points; scratch: 3 Q Reals. Those of a panel are the weights
/// of the integral over all of it, with the sign of v after its last zero, plus for each zero those
/// of the integral up to it, times twice the sign of v before it. The zeros of all members are
/// treated together: the first zero of each member, then the second, and so on.
template <class Real>
void signed_weights_of(const GridTables& grid, const double* v, double* weights, double* scratch) {
  constexpr Count members = lanes<Real>;
  const Count nodes = grid.nodes, block = nodes + 1;
  double* const zero = scratch;
  double* const twice = zero + nodes * members;  // twice the sign of v before each zero
  double* const turned = twice + nodes * members;
  for (Count panel = 0; panel < grid.panels;
       ++panel, v += block * members, weights += block * members) {
    double last[members];
    Count most = 0, found[members];
    for (Count b = 0; b < members; ++b) {
      double sign = v[b] < 0.0 ? -1.0 : 1.0;
      Count count = 0;
      for (Count p = 0; p < nodes; ++p) {
        if (!(sign * v[(p + 1) * members + b] < 0.0)) continue;
        const Count last_first = nodes - 3, near = p > 0 ? p - 1 : 0;
        const Count first = near < last_first ? near : last_first;
        zero[count * members + b] = cubic_zero(grid.arc + first, v + first * members + b, members,
                                               grid.arc[p], grid.arc[p + 1]);
        twice[count * members + b] = 2.0 * sign;
        sign = -sign;
        ++count;
      }
      last[b] = sign;
      found[b] = count;
      most = count > most ? count : most;
    }
    const Real sign = load<Real>(last);
    set(weights, nodes, Real{});
    for (Count p = 0; p < nodes; ++p) set(weights, p, Real(sign * grid.weight[panel * block + p]));
    if (most == 0) continue;
    for (Count b = 0; b < members; ++b) {
      for (Count k = found[b]; k < most; ++k) zero[k * members + b] = twice[k * members + b] = 0.0;
    }
    for (Count k = 0; k < nodes; ++k) set(turned, k, Real{});
    for (Count j = 0; j < most; ++j) {
      const Real x = 2.0 * at<Real>(zero, j) - 1.0,
                 factor = grid.length[panel] * at<Real>(twice, j);
      Real before = all<Real>(1.0), value = x;  // P_{k-1}, P_k
      add(turned, 0, Real(factor * at<Real>(zero, j)));
      for (Count k = 1; k < nodes; ++k) {
        const double order = static_cast<double>(k), odd = 2.0 * order + 1.0;
        const double share = 1.0 / (order + 1.0);
        const Real next = (odd * share) * (x * value) - (order * share) * before;
        add(turned, k, Real((0.5 / odd * factor) * (next - before)));
        before = value;
        value = next;
      }
    }
    for (Count k = 0; k < nodes; ++k) {
      const Real factor = at<Real>(turned, k);
      const double* const row = grid.expansion + k * nodes;
      for (Count p = 0; p < nodes; ++p) add(weights, p, Real(factor * row[p]));
    }
  }
}

}  // namespace
