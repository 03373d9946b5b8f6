// SPDX-License-Identifier: MIT
//
// Motion of the reduced model (equations in galerkin/galerkin.hpp): the tables of one quadrature,
// and the functions that are compiled for each level. Includes no other library.
#pragma once

#include <array>
#include <cstddef>

#include "pipedyn/chain/motion.hpp"
#include "pipedyn/terms/term.hpp"

namespace pipedyn {

/// Tables of one quadrature, row-major, for Gauss collocation on each panel between the places of
/// terms. The points of a panel are its nodes s_p, an odd number Q = 2 h - 1 of them that lie
/// symmetrically about the middle one, and its end; p' = Q - 1 - p is the mirror image of p. The
/// last of all points is the free end.
///
/// Integrals S f from the start of a panel to its nodes cost half of a product with S (Q, Q):
///   (S f)(p) - (S f)(p') = 2 (from_sums sums)(p),   sums(p) = f(p) + f(p'),
///   (S f)(p) + (S f)(p') = 2 (from_differences differences)(p) + the integral over the panel,
/// for p < h, except that the last row of from_sums, for the middle node, gives half the integral
/// over the panel. For integrals from the clamp, twice the integral up to the start of the panel is
/// added to the second sum.
struct GridTables {
  static constexpr std::ptrdiff_t multiple = 4;  // divides counts of points and padded functions
  static constexpr std::ptrdiff_t widest = 8;    // divides strides

  std::ptrdiff_t functions;         // m
  std::ptrdiff_t padded;            // number of functions after padding with zeros
  std::ptrdiff_t panels;            // P
  std::ptrdiff_t nodes;             // Q, on each panel
  std::ptrdiff_t points;            // N = P (Q + 1)
  std::ptrdiff_t stride;            // N or more: length of the rows that run over the points
  const double* slope_by_function;  // Theta_i at the points, (m, stride)
  const double* slope;              // Theta_i at the points, (N, padded), with room for a vector
  const double* orthonormal;        // the same for the orthonormal functions, (N, padded)
  const double* root_slope;  // Theta_i at the root in both, (2, m); null: its direction is held
  const double* to_basis;    // orthonormal coordinates to amplitudes, (m, m)
  const double* from_basis;  // inverse of the first, (m, padded), with room for a vector
  const double* from_sums;   // matrix above, for a panel of length 1, (h, h)
  const double* from_differences;       // matrix above, for a panel of length 1, (h, h)
  const double* length;                 // length of each panel, (P,)
  const double* curvature;              // Theta_i' at the points, (N, padded)
  const double* orthonormal_curvature;  // the same for the orthonormal functions, (N, padded)
  const double* weight;                 // weights of the quadrature, 0 at the ends of panels, (N,)
  const double* bending;                // these times the bending stiffness, (N,)
  const double* mass;                   // mass of the pipe and its terms at each point, (N,)
  std::ptrdiff_t turning;               // number of points with rotary inertia
  const std::ptrdiff_t* turning_at;     // these points, (turning,)
  const double* inertia;                // their rotary inertia, (turning,)
  const double* beyond;                 // mass beyond each point, (N,)
  const double* place;                  // arc length of each point, (N,)
  const double* arc;                    // places of a panel's points, from 0 to 1, (Q + 1,)
  const double* expansion;              // expansion of Quadrature, (Q, Q)
  const double* elastic;                // k_ij, (m, m)
  const double* damped;                 // k_ij without the spring at the root, which has no damping
  const double* elastic_forces;         // product of `elastic` and `to_basis`, (m, m)
  const double* damped_forces;          // product of `damped` and `to_basis`, (m, m)
};

/// A term with a load: at the end of a panel or, if it acts all along, at every node.
struct PanelTerm {
  Term term;
  std::ptrdiff_t panel;  // -1: all along
};

/// The effects that act on the pipe; each is 0 if the pipe does not have it.
struct MotionEffects {
  double coriolis = 0.0;           // 2 s sqrt(beta)
  double entry = 0.0;              // (1 - c) s sqrt(beta)
  std::array<double, 2> thrust{};  // a cos psi, along the free end, and a sin psi, across it
  double gamma = 0.0, drag = 0.0, damping = 0.0;
  double root_across = 0.0;  // what the root's spring has more for rotation across z = 0
  std::array<double, 2> down{0.0, 1.0};  // direction of gravity, across and along the axis
  double normal_mass = 0.0;              // mass per length that moves across the pipe alone
  const PanelTerm* loads = nullptr;
  std::ptrdiff_t load_count = 0;
  const std::ptrdiff_t* held = nullptr;  // panels at whose ends x = 0 is held, ascending
  std::ptrdiff_t held_count = 0;
  double return_rate = 0.0;  // k, rate at which states that miss x = 0 return to it
};

/// The functions of one level. A batch here is a block: one member or as many as the vectors of the
/// level hold, each with its own speed. The functions use the thread's scratch
/// (vector/scratch.hpp).
struct GalerkinKernel {
  using Function = void (*)(const GridTables&, const MotionEffects&, const Batch&, double* out);

  struct Motion {
    /// q'' (m, members), in O(N Q m + N m^2 + m^3) a member. The result is NaN for a member whose
    /// mass matrix is not positive definite to rounding.
    Function accelerations;
    /// Energy of each member, in O(N Q + N m).
    Function energy;
    /// Power of flow, damping, drag, terms and the base, (5, members).
    Function power;
    /// Position of the free end, x then y, and its velocity, (4, members).
    Function tips;
    /// Derivatives of q'' by q, then by q', (m, 2 m, members), then q'' and its derivative by the
    /// speed, (m, members) each. The drag contributes 2 |v_n| dv_n.
    Function jacobian;
  };
  Motion planar;
  /// Motion in space (galerkin/space.hpp), of states with 4 m rows: 2 m coordinates in place of m,
  /// and (x, y, z) in place of (x, y). jacobian is for one member.
  Motion spatial;

  /// Axial acceleration and its derivatives, as MotionKernel::axial.
  Function axial;
  /// x where the pipe is held, followed by the derivatives of each of these x by q:
  /// (held (1 + m), members).
  Function held;

  /// Linear operators about one state at rest, for the functions of the tables: the mass matrix (m,
  /// m); the derivatives of all forces except those of bending by q, then by q', (m, 2 m); the
  /// derivatives of the position of the free end, x then y, (2, m); all forces (m). displacements:
  /// those of the straight pipe, (N, m), which have more accurate digits than the integrals of the
  /// slopes, or null.
  void (*operators)(const GridTables&, const MotionEffects&, const Batch&,
                    const double* displacements, double* out);
};

extern const GalerkinKernel galerkin_baseline, galerkin_avx2, galerkin_avx512;

}  // namespace pipedyn
