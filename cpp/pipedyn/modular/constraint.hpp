// SPDX-License-Identifier: MIT
//
// Constraints between the redundant coordinates, g(q) = 0; twice differentiated A(q) q'' = b(q,
// q').
#pragma once

#include <vector>

#include "pipedyn/modular/redundant.hpp"

namespace pipedyn {

/// With a = r_j - r_{j-1}, d = r_{j-1} - r_{j-2}:
///   clamp (eq. (10), j = 1): (y_1 - base) - l_1 cos phi_1,  x_1 - l_1 sin phi_1
///   joint (eq. (11), j >= 2): a . d / l_{j-1} - l_j cos phi_j,
///                             cross(a, d) / l_{j-1} - l_j sin phi_j
///   guide: x_j      pin: x_j - x, y_j - y
/// The clamp is a joint to a fixed segment with d / l = (0, 1). phi_j is the angle from segment
/// j - 1 to segment j, t = (sin theta, cos theta).
struct Constraint {
  enum class Kind : std::int64_t { clamp, joint, guide, pin };
  Kind kind;
  Index node;
  double x = 0.0, y = 0.0;

  /// Throws std::invalid_argument unless it fits a scene of n segments.
  void check(Index segments) const;
  int rows() const { return kind == Kind::guide ? 1 : 2; }
  /// The coordinates that it touches.
  std::vector<int> coordinates() const;

  /// residual: g, matrix: A (rows, coordinates), row-major, right_side: b. length: of all segments.
  void fill(const Nodes& place, const Nodes& rate, const Vector& length, double* residual,
            double* matrix, double* right_side) const;
  /// Adds sum_i multipliers_i d2 g_i / dq2.
  void add_curvature(const Nodes& place, const Vector& length, const double* multipliers,
                     Triplets& out) const;
  /// Derivatives of A q'' - b with q'' held, its rows from `row` on.
  void add_derivatives(const Nodes& place, const Nodes& rate, const Nodes& acceleration,
                       const Vector& length, Index row, Derivatives& out) const;
};

}  // namespace pipedyn
