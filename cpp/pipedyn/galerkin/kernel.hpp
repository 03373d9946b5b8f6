// SPDX-License-Identifier: MIT
//
// Motion of the reduced model (equations in galerkin/galerkin.hpp): the tables of one quadrature,
// and the functions that each vector level compiles. Includes no other library.
#pragma once

#include <array>
#include <cstddef>

#include "pipedyn/chain/motion.hpp"
#include "pipedyn/terms/term.hpp"

namespace pipedyn {

/// Tables of one quadrature, row-major: Gauss collocation on each panel between terms' places. A
/// panel's points are its nodes s_p, an odd number Q = 2 h - 1 of them that lie symmetric about the
/// middle one, and its end; p' = Q - 1 - p mirrors p. The last point of all is the free end.
///
/// Integrals from a panel's start to its nodes, S f, cost half of a product with S (Q, Q):
///   (S f)(p) - (S f)(p') = 2 (from_sums sums)(p),   sums(p) = f(p) + f(p'),
///   (S f)(p) + (S f)(p') = 2 (from_differences differences)(p) + the integral over all,
/// p < h; but the last row of from_sums, the middle's, gives half the integral over all. From the
/// clamp the second has twice what lies before the panel besides.
struct GridTables {
  static constexpr std::ptrdiff_t multiple = 4;  // of points, and of padded functions
  static constexpr std::ptrdiff_t widest = 8;    // of a stride

  std::ptrdiff_t functions;         // m
  std::ptrdiff_t padded;            // functions with some that are zero
  std::ptrdiff_t panels;            // P
  std::ptrdiff_t nodes;             // Q, of each panel
  std::ptrdiff_t points;            // N = P (Q + 1)
  std::ptrdiff_t stride;            // N or more, of the rows that run over the points
  std::ptrdiff_t heavy;             // points that may have mass: all, or all but the last
  const double* slope_by_function;  // Theta_i at the points, (m, stride)
  const double* slope;              // Theta_i at the points, (N, padded), with room for a vector
  const double* orthonormal;        // those of the orthonormal functions, of the same shape
  const double* to_basis;           // T of Orthonormal, (m, m); none where it is the identity
  const double* from_basis;         // its inverse, (m, padded), with room for a vector
  const double* from_sums;          // (h, h), for a panel of length 1
  const double* from_differences;   // (h, h)
  const double* length;             // of each panel, (P,)
  const double* weight;             // of the quadrature, 0 at the panels' ends, (N,)
  const double* mass;               // of the pipe and its terms at each point, (N,)
  const double* inertia;            // rotary, at the end of each panel, (P,); none where all are 0
  const double* density;            // per length at the nodes, 1 at ends; none where uniform, (N,)
  const double* beyond;             // mass beyond each point, (N,)
  const double* arc;                // of a panel's points, from 0 to 1, (Q + 1,)
  const double* expansion;          // of Quadrature, (Q, Q)
  const double* recurrence;         // (2 k + 1) / (k + 1), k / (k + 1), 1 / (4 k + 2), (Q, 3)
  const double* stiffness;          // k_ii of a uniform pipe, (m,)
  const double* elastic;            // k_ij, (m, m); none where the stiffness is uniform
  const double* elastic_forces;     // k T, (m, m)
  const double* turned;             // sqrt(k_r) Theta_i(0) (m,), and its product with T: by these
  const double* turned_forces;      // the root's spring is undamped; none without one
};

/// A term with a load, at the end of a panel or, where it acts all along, at every node.
struct PanelTerm {
  Term term;
  std::ptrdiff_t panel;  // -1: all along
};

/// What acts on the pipe, each 0 where the pipe does not have it.
struct MotionEffects {
  double coriolis = 0.0;           // 2 s sqrt(beta)
  double entry = 0.0;              // (1 - c) s sqrt(beta)
  std::array<double, 2> thrust{};  // a cos psi along and a sin psi across the free end
  double gamma = 0.0, drag = 0.0, damping = 0.0;
  double normal_mass = 0.0;     // per length, of what moves across the pipe alone
  double rotary_inertia = 0.0;  // per length, of cross-sections
  const PanelTerm* loads = nullptr;
  std::ptrdiff_t load_count = 0;
  const std::ptrdiff_t* held = nullptr;  // panels at whose ends the pipe is held, x = 0, ascending
  std::ptrdiff_t held_count = 0;
  double return_rate = 0.0;  // k, of states that miss that
};

/// The functions of one vector level. A batch here is a block: one member or the level's width,
/// each with a speed of its own. They use the thread's scratch (vector/scratch.hpp).
struct GalerkinKernel {
  using Function = void (*)(const GridTables&, const MotionEffects&, const Batch&, double* out);

  /// q'' (m, members), O(N Q m + N m^2 + m^3) a member. NaN where a member's mass matrix is not
  /// positive definite to rounding.
  Function accelerations;
  /// Energy of each member, O(N Q + N m).
  Function energy;
  /// Power of flow, damping, drag, terms and the base, (5, members).
  Function power;
  /// As MotionKernel's.
  Function axial;
  /// Position of the free end, x then y, and its velocity, (4, members).
  Function tips;
  /// x where the pipe is held, then of each its derivatives by q: (held (1 + m), members).
  Function held;
  /// Derivatives of q'' by q, then by q', (m, 2 m, members), q'' and its derivative by the speed,
  /// (m, members) each. Drag's share is 2 |v_n| dv_n.
  Function jacobian;

  /// About one state at rest, the functions being those of the tables: the mass matrix (m, m);
  /// derivatives of all forces but bending's by q, then by q' (m, 2 m); of the free end's position,
  /// x then y (2, m); all forces (m). displacements: those of the straight pipe (N,
  /// m), which have more digits than the integrals of the slopes; or null.
  void (*operators)(const GridTables&, const MotionEffects&, const Batch&,
                    const double* displacements, double* out);
};

extern const GalerkinKernel galerkin_baseline, galerkin_avx2, galerkin_avx512;

}  // namespace pipedyn
