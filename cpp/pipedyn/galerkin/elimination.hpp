// SPDX-License-Identifier: MIT
//
// The determinant of a straight reduced model's P(lambda), by elimination from panel to panel.
//
// A panel of length h from a has the functions 1, (s - a) / h and those of Legendre curvature
// (basis.hpp), which are 0 before it; in lengths of h, and with moments in EI / h, their matrices
// are banded and elastic ones the identity. What lies beyond the panel's end moves with the
// displacement w and the slope theta there, and resists by a force Q and a moment M. Not an
// impedance is carried from panel to panel, which is infinite where the part beyond has a root of
// its own, but two equations
//   r_w w + r_theta theta + r_Q Q + r_M M = 0.
// With these and its own equations a panel's functions are eliminated, those of highest degree
// first, with threshold pivoting, and two equations are left at its start:
//   (P z)_i + w_i Q + theta_i M = 0 of each function, Q_a and M_a being what the panel resists by.
// Of the first two functions w_i and theta_i are those of a rigid motion; they are 0 of degree 2
// and beyond. Beyond a free end nothing is carried. The product of the pivots is det P but for a
// constant. Where the pipe is held, w or theta is 0 and Q or M any.
//
// A null vector is the first step of inverse iteration (Golub and Van Loan 2013, sec. 7.6): what
// irregular loads of the order of 1, one on each function, move. They are eliminated as one more
// column; were they put on the pivots' rows instead, a mode that is large far from the root alone,
// as that of the last of many spans, would hardly be among what they excite. That of P^T is the
// first step with irregular loads on the functions, by the same factors: P = L U but for exchanges
// of rows, so that U^T is solved from the tip to the root and L^T back.
#pragma once

#include <cstddef>

#include "pipedyn/vector/points.hpp"

namespace pipedyn {

/// Half-bandwidth up to which the elimination is worth its cost: of a plain pipe it is 4.
inline constexpr std::ptrdiff_t widest = 24;

/// An entry of P at a speed: what multiplies lambda^0, with an imaginary part, lambda and lambda^2,
/// and its derivative by the speed.
struct PencilEntry {
  double still, loss, rate, square, still_by_speed, rate_by_speed;
};

struct EliminationPanel {
  double length;
  std::ptrdiff_t size;         // functions, with the first two
  const PencilEntry* entries;  // (size, 2 band + 1), of functions i and i - band .. i + band
  PencilEntry station[2][2];   // what acts at its end, on w and theta
  bool held, directed;         // whether w is 0 there, and theta
};

struct EliminationModel {
  const EliminationPanel* panels;
  std::ptrdiff_t count, band, dof;  // dof: curvatures of all panels, and theta at the root if
  bool turns;                       // it turns
  double root;                      // stiffness of its spring
};

struct EliminationKernel {
  /// d log det P / dlambda - sum_k 1 / (lambda - lambda_k), real and imaginary parts of count
  /// values; roots k at lambda itself add nothing. signs, if not null: the determinant's own, of a
  /// real one, and the logarithm of its size.
  void (*log_derivative)(const EliminationModel&, const Points&, double* out, double* signs);
  /// Vectors of roots, or of values near them; coordinates are theta at a root that turns, then the
  /// amplitudes of curvatures, panel by panel. Both use the thread's scratch.
  void (*pairs)(const EliminationModel&, const Points&, const PairsAsked&);
};

extern const EliminationKernel elimination_baseline, elimination_avx2, elimination_avx512;

}  // namespace pipedyn
