// SPDX-License-Identifier: MIT
//
// Motion of the reduced model (equations in galerkin/motion.hpp): the tables of one quadrature, and
// the functions that each vector level compiles. Includes no other library.
#pragma once

#include <cstddef>

#include "pipedyn/chain/motion.hpp"

namespace pipedyn {

/// Tables of one quadrature, row-major. Its points are the nodes s_p, an odd number Q = 2 h - 1 of
/// them that lie symmetric about the middle one, and the free end; p' = Q - 1 - p mirrors p.
///
/// Integrals from 0 to the nodes, S f, cost half of a product with S (Q, Q): of the sums
/// f(p) + f(p') (and f in the middle) and the differences f(p) - f(p'), p < h - 1,
///   (S f)(p) - (S f)(p') = 2 (from_sums sums)(p),
///   (S f)(p) + (S f)(p') = 2 (from_differences (differences, half the integral over all))(p),
/// where the last row of from_sums gives half the integral over all.
struct GridTables {
  static constexpr std::ptrdiff_t multiple = 4;  // of points, and of padded functions
  static constexpr std::ptrdiff_t widest = 8;    // of a stride

  std::ptrdiff_t functions;         // m
  std::ptrdiff_t padded;            // functions with some that are zero
  std::ptrdiff_t nodes;             // Q
  std::ptrdiff_t stride;            // Q + 1 or more, of the rows that run over the points
  const double* slope_by_function;  // Theta_i at the points, (m, stride)
  const double* orthonormal;        // slopes of the orthonormal functions, (Q + 1, padded)
  const double* to_basis;           // T of Orthonormal, (m, m); none where it is the identity
  const double* from_sums;          // (h, h)
  const double* from_differences;   // (h, h)
  const double* weight;             // w_p, (Q,)
  const double* folded_weight;      // of products of rows as the integrals leave them, (Q,)
  const double* arc;                // arc length of each point, (Q + 1,)
  const double* expansion;          // of Quadrature, (Q, stride)
  const double* recurrence;         // (2 k + 1) / (k + 1), k / (k + 1), 1 / (4 k + 2), (Q, 3)
  const double* stiffness;          // k_i, (m,)
};

/// What acts on the pipe, each 0 where the pipe does not have it.
struct MotionEffects {
  double coriolis;     // 2 s sqrt(beta)
  double centrifugal;  // a
  double gamma, drag, damping;
};

/// The functions of one vector level. A batch here is a block: one member or the level's width,
/// each with a speed of its own. scratch: as many numbers as its size says, on a boundary of 64
/// bytes.
struct GalerkinKernel {
  std::ptrdiff_t (*scratch_size)(const GridTables&, std::ptrdiff_t members);

  /// q'' (m, members), O(Q^2 m + Q m^2 + m^3) a member. NaN where a member's mass matrix is not
  /// positive definite to rounding.
  void (*accelerations)(const GridTables&, const MotionEffects&, const Batch&, double* out,
                        double* scratch);
  /// Energy of each member, O(Q^2).
  void (*energy)(const GridTables&, const MotionEffects&, const Batch&, double* out,
                 double* scratch);
  void (*power)(const GridTables&, const MotionEffects&, const Batch&, const PowerParts& out,
                double* scratch);

  /// Integrals from 0 to each point (Q + 1, columns) of what f (Q, columns) is at the nodes.
  std::ptrdiff_t (*integrals_scratch_size)(const GridTables&, std::ptrdiff_t columns);
  void (*integrate)(const GridTables&, const double* f, std::ptrdiff_t columns, double* out,
                    double* scratch);

  /// Weights (Q,) that integrate sign(v) f for a smooth f, given v at the points: the interval is
  /// cut at the zeros of v, each found on the cubic through the four points around it. Where f has
  /// a double zero with v, as |v| v has, a zero's error enters by its cube. O(Q), and O(Q^2) with
  /// zeros. scratch holds 3 Q numbers.
  void (*signed_weights)(const GridTables&, const double* v, double* weights, double* scratch);
};

extern const GalerkinKernel galerkin_baseline, galerkin_avx2, galerkin_avx512;

}  // namespace pipedyn
