// SPDX-License-Identifier: MIT
//
// Constraints between the redundant coordinates, g(q) = 0; twice differentiated A(q) q'' = b(q, q')
// with b_i = -sum_jk H_ijk q_j' q_k', H_i the second derivatives of g_i.
#pragma once

#include <vector>

#include "pipedyn/modular/redundant.hpp"

namespace pipedyn {

/// With a = r_j - r_{j-1}, d = (r_{j-1} - r_{j-2}) / l_{j-1}:
///   clamp (eq. (10), j = 1) and joint (eq. (11), j >= 2): a . d - l_j cos phi_j,
///                                                         cross(a, d) - l_j sin phi_j
///   guide: x_j - x      pin: x_j - x, y_j - y
/// The clamp is a joint to a fixed segment, d = (0, 1). phi_j is the angle from segment j - 1 to
/// segment j, t = (sin theta, cos theta).
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
  /// Adds the second derivatives of g, whose rows are counted from `row`.
  void add_hessians(const Nodes& place, const Vector& length, Index row, Hessians& out) const;
};

}  // namespace pipedyn
