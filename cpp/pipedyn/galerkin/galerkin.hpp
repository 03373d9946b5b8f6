// SPDX-License-Identifier: MIT
//
// Reduced model: projection of the pipe's equation (Gregory and Paidoussis 1966),
//
//   w'''' + [a U^2 - gamma (1 - s)] w'' + gamma w' + 2 sqrt(beta) U w'.' + w.. + delta w''''. = 0,
//
// clamped at s = 0 and free at s = 1, onto the functions of a basis. Integrated by parts, the
// Coriolis term leaves the skew part and the flux through the end,
//   G_ij = sqrt(beta) int (w_i w_j' - w_j w_i'),   F_ij = sqrt(beta) w_i(1) w_j(1),
// and the centrifugal force with the end's follower force leaves
//   flux_ij = w_i(1) w_j'(1) - int w_i' w_j'.
//
// A term (terms/station.hpp) with mass mu and load f at s_f adds mu w_i w_j there to the mass, the
// slopes of f_x by x, theta and v_x to stiffness and damping, and what it weighs or pulls along the
// pipe hangs on the tension above it:
//   int_0^1 (gamma (1 - s + sum of mu beyond s) + sum of f_y beyond s) w_i' w_j'.
#pragma once

#include "pipedyn/galerkin/basis.hpp"

namespace pipedyn {

/// What functions are at the free end, each (m,): displacement, its part across the pipe, slope.
struct End {
  const double *x, *y, *across, *slope;
};

/// Adds bending and what is left of the flow, given coriolis_ij, the integral of the displacement
/// i across the pipe times the slope j; the integral in the flux is the caller's.
void add_flow_and_bending(const Pipe& pipe, const Matrix& coriolis, const End& end,
                          const Vector& elastic, Operators& ops);

/// Immutable; one model may serve many threads.
class Galerkin {
 public:
  /// nodes and weights: quadrature on [0, 1], exact for products of two functions or slopes, and
  /// with terms also up to each of these. Throws std::invalid_argument if nodes and weights
  /// differ in length.
  Galerkin(const Pipe& pipe, Basis basis, Vector nodes, Vector weights);

  Index dof() const { return basis_.size(); }
  const Basis& basis() const { return basis_; }

  /// Operators about the straight pipe, O((nodes + terms) m^2).
  Operators operators() const;
  /// Bound on the norm of what terms add to the stiffness where each function has unit stiffness:
  /// then |w(s)|^2 <= s^3 / 3 and |w'(s)|^2 <= s of all functions together.
  double term_stiffness() const;

 private:
  Pipe pipe_;
  Basis basis_;
  Vector nodes_;
  Vector weights_;
};

}  // namespace pipedyn
