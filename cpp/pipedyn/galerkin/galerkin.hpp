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
// A fitting at s_f with mass mu_f and stiffness k_f adds mu_f w_i w_j at s_f to the mass, k_f w_i
// w_j there to the stiffness, and hangs on the tension above it:
//   gamma int_0^1 (1 - s + sum of mu_f beyond s) w_i' w_j'.
#pragma once

#include "pipedyn/galerkin/basis.hpp"
#include "pipedyn/galerkin/fitting.hpp"

namespace pipedyn {

/// Immutable; one model may serve many threads.
class Galerkin {
 public:
  /// nodes and weights: quadrature on [0, 1], exact for products of two functions or slopes, and
  /// with fittings also up to each of these. Throws std::invalid_argument if nodes and weights
  /// differ in length.
  Galerkin(const Pipe& pipe, Basis basis, Vector nodes, Vector weights, Fittings fittings = {});

  Index dof() const { return basis_.size(); }
  const Basis& basis() const { return basis_; }

  /// Operators about the straight pipe, O((nodes + fittings) m^2).
  Operators operators() const;

 private:
  Pipe pipe_;
  Basis basis_;
  Vector nodes_;
  Vector weights_;
  Fittings fittings_;
};

}  // namespace pipedyn
