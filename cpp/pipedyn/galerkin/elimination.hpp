// SPDX-License-Identifier: MIT
//
// The determinant of P(lambda) of a straight reduced model, by elimination from panel to panel.
//
// A panel of length h that starts at a has the functions 1, (s - a) / h and those of Legendre
// curvature (basis.hpp); all are 0 before the panel. With lengths in units of h and moments in
// units of EI / h, their matrices are banded, and the elastic matrix is the identity. The part of
// the pipe beyond the end of the panel moves with the displacement w and the slope theta there, and
// resists by a force Q and a moment M. Its dynamic_stiffness would be infinite where that part has
// a root of its own, so the elimination carries two equations from panel to panel instead:
//   r_w w + r_theta theta + r_Q Q + r_M M = 0.
// With these and the equations of the panel its functions are eliminated, those of highest degree
// first, with threshold pivoting, and two equations remain at its start. The equation of each
// function i is
//   (P z)_i + w_i Q + theta_i M = 0,
// where w_i and theta_i are the displacement and slope of function i at the end of the panel: those
// of a rigid motion for the first two functions, and 0 for curvatures of degree 2 and higher. In
// the equations of the first two functions the force Q_a and the moment M_a, by which the panel
// resists at its start, are on the right-hand side instead of 0; at the root these equations are
// left out, but for that of the slope, if the root turns. Beyond a free end nothing is carried. The
// product of the pivots is det P up to a constant. Where the pipe is held, w or theta is 0 and Q or
// M is arbitrary.
//
// A right null vector is the first step of inverse iteration (Golub and Van Loan 2013, sec. 7.6):
// the response to irregular loads of the order of 1, one on each function. The loads are eliminated
// as one more column. If they were put on the rows of the pivots instead, a mode that is large only
// far from the root, such as that of the last of many spans, would hardly be excited. A left null
// vector is the right null vector of P^T, whose panels and stations are those of P, transposed.
#pragma once

#include <cstddef>

#include "pipedyn/vector/points.hpp"

namespace pipedyn {

/// Half-bandwidth up to which the elimination is worth its cost; that of a plain pipe is 4.
inline constexpr std::ptrdiff_t widest = 24;

/// Displacement and slope of the end of a panel for unit amplitudes of its first functions; the
/// others do not move it. The fourth of the displacements is -sqrt(3) / 6.
inline constexpr std::ptrdiff_t moving = 4;
inline constexpr double end_shape[moving] = {1.0, 1.0, 0.5, -0.28867513459481287};
inline constexpr double end_slope[moving] = {0.0, 1.0, 1.0, 0.0};

/// An entry of P at a speed: the coefficients of lambda^0 (`stiffness`, with the imaginary part
/// `hysteretic`), of lambda (`damping`) and of lambda^2 (`mass`), and derivatives by the speed.
struct PencilEntry {
  double stiffness = 0.0, hysteretic = 0.0, damping = 0.0, mass = 0.0;
  double stiffness_by_speed = 0.0, damping_by_speed = 0.0;
};

struct EliminationPanel {
  double length;
  std::ptrdiff_t size;         // number of functions, with the first two
  std::ptrdiff_t first;        // number of functions of the panels before it, and two for each
  const PencilEntry* entries;  // (size, 2 band + 1), for functions i and i - band .. i + band
  PencilEntry station[2][2];   // entries of what acts at its end on w and theta
  bool held, directed;         // whether w = 0 there; whether theta = 0
};

struct EliminationModel {
  const EliminationPanel* panels;
  std::ptrdiff_t count, band, dof;  // dof: curvatures of all panels, theta if the root turns
  bool turns;                       // whether the root turns
  double root;                      // stiffness of the spring at the root
  bool transposed = false;          // whether P^T is meant
};

struct EliminationKernel {
  /// d log det P / dlambda - sum_k 1 / (lambda - lambda_k): real and imaginary parts of count
  /// values; a root k at lambda itself is left out of the sum. signs, if not null: the sign of the
  /// determinant, if it is real, and the logarithm of its absolute value.
  void (*log_derivative)(const EliminationModel&, const Points&, double* out, double* signs);
  /// Null vectors at roots of the determinant or at values near them. Their coordinates are the
  /// slope theta at s = 0, if the pipe can turn there, and the amplitudes of curvatures, panel by
  /// panel. Both functions use the thread's scratch.
  void (*pairs)(const EliminationModel&, const Points&, const PairsAsked&);
};

extern const EliminationKernel elimination_baseline, elimination_avx2, elimination_avx512;

}  // namespace pipedyn
