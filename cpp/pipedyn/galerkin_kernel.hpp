// SPDX-License-Identifier: MIT
//
// Accelerations of the geometrically exact reduced model (equations in galerkin_motion.hpp), for
// one member or a block of them side by side. Plain pointers and loops, no Eigen: the source may be
// compiled once for each vector level.
#pragma once

#include <cstddef>

namespace pipedyn {

using std::ptrdiff_t;

/// Tables of one quadrature level, row-major. Points are the nodes and, last, the free end; the
/// orthonormal functions are padded with zeros.
struct LevelTables {
  static constexpr ptrdiff_t multiple = 4;  // of points, and of padded functions

  ptrdiff_t functions;              // m
  ptrdiff_t padded;                 // functions with the padding
  ptrdiff_t nodes;                  // Q
  const double* slope_by_function;  // Theta_i at the points, (m, Q + 1)
  const double* orthonormal;        // Theta T at the points, (Q + 1, padded)
  const double* to_basis;           // T of Orthonormal, (m, m); none where it is the identity
  const double* integral;           // integral from 0 to each point, (Q + 1, Q); last row: weights
  const double* arc;                // arc length of each point, (Q + 1,)
  const double* expansion;          // of Quadrature, (Q, Q)
  const double* stiffness;          // k_i, (m,)
};

/// What acts on the pipe, each 0 where the pipe does not have it.
struct MotionEffects {
  double coriolis;     // 2 s sqrt(beta)
  double centrifugal;  // a
  double gamma, drag, damping;
};

/// Members that a block holds side by side.
constexpr ptrdiff_t block_width = 8;

/// Doubles that `accelerations` needs for `width` members; work must start at a multiple of 64
/// bytes.
ptrdiff_t work_size(const LevelTables& level, ptrdiff_t width);

/// Amplitudes q (m, width), rates (m, width), flow speeds u (width,) -> accelerations (m, width),
/// O(Q^2 m + Q m^2 + m^3) a member. width is 1 or block_width. Where a member's mass matrix is not
/// positive definite to rounding its accelerations are NaN.
void accelerations(const LevelTables& level, const MotionEffects& effects, ptrdiff_t width,
                   const double* q, const double* rate, const double* u, double* work,
                   double* acceleration);

/// Weights (Q,) that integrate sign(v) f for a smooth f, given v at the points: the interval is cut
/// at the zeros of v, each found on the cubic through the four points around it. Where f has a
/// double zero with v, as |v| v has, a zero's error enters by its cube. O(Q), and O(Q^2) with
/// zeros. v and weights are strided; scratch holds 3 Q doubles.
void signed_weights(const LevelTables& level, const double* v, ptrdiff_t stride, double* scratch,
                    double* weights);

}  // namespace pipedyn
