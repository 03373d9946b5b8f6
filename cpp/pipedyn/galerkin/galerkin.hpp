// SPDX-License-Identifier: MIT
//
// Reduced model, geometrically exact. The inextensible centreline is described by its
// angle from the downward vertical, theta(s) = sum_i q_i Theta_i(s) with Theta_i = w_i' of a basis,
//
//   t = (sin theta, cos theta),  n = (cos theta, -sin theta),  r(s) = int_0^s t,
//   J_i(s) = dr/dq_i = int_0^s n Theta_i,   velocity v = sum_i J_i q_i'.
//
// Virtual work, with U = s u and the forces per length of Orsino and Di Giulio in the limit of
// short segments (no expansion in the amplitude anywhere):
//
//   int m J_i . a + sum_j k_ij (q_j + delta q_j')                               inertia, bending
//     + J int Theta_i theta''                                                   rotary inertia
//     + 2 sqrt(beta) U int J_i . n theta'                                       Coriolis, end flux
//     - (1 - c) sqrt(beta) U v(1) . J_i(1)                                      entering flow
//     + a U^2 (cos psi t(1) + sin psi n(1)) . J_i(1)                            follower force
//     + sqrt(beta) U' int t . J_i                                               unsteady flow
//     - gamma int m J_i . (0, 1)                                                gravity
//     + kappa int |v_n| v_n n . J_i = 0,   v_n = n . v,                         drag
//   a(s) = (X'', Y'') + sum_i J_i q_i'' - int_0^s t theta'^2,
//
// (theta' here is the rate), m the mass per length, J the rotary inertia of cross-sections, k_ij
// the integral of e Theta_i' Theta_j' with the bending stiffness e. Both functions have a k_ij that
// is diagonal where the pipe is uniform, e = m = 1; its fluid always is. As v' = n theta', the
// Coriolis term's power is -sqrt(beta) U |v(1)|^2:
//
//   dE/dtau = -c sqrt(beta) U |v(1)|^2 - a U^2 (cos psi t(1) + sin psi n(1)) . v(1)
//     - sqrt(beta) U' int t . v - delta sum k_ij q_i' q_j' - kappa int |v_n|^3,
//
// where the base rests. It may stand at (X, Y), a function of time: drag and terms then see the
// velocity v + (X', Y'). The energy is that in its frame, and with the force R of drag and terms
// its motion adds the power -(X'', Y'') . int v - (X', Y') . R. All of
// this holds to rounding at any number of nodes, since the quadrature integrates by parts
// exactly (quadrature.hpp). The drag's integrand is cut at the zeros of v_n (signed_weights).
//
// A term (terms/station.hpp) with mass mu and load f at the arc length s_f adds the virtual work
//
//   J_i(s_f) . (mu a(s_f) - mu gamma (0, 1) - f).
//
// Mass that moves across the pipe alone (terms/added_mass.hpp) adds chi int (n . J_i) (n . a), and
// a couple c the virtual work -c Theta_i(s_f), or its integral. Rotary inertia I at s_f adds
// I Theta_i Theta_j to the mass matrix, at any amplitude, since theta is linear in q.
//
// The quadrature is Gauss collocation on each panel between the places of terms and the steps of e
// and m: integrals from the
// clamp to its points are block lower triangular, and integration by parts holds as on one panel.
// So a term is one more load at a panel's end, or at every node where it acts all along.
//
// A root's spring (pipe.hpp) is part of k_ij, but not damped: k_ij of the dampings lack it.
//
// Where the pipe is held across, x(s_b) = 0, forces mu_b along x act such that
//
//   x'' + 2 k x' + k^2 x = 0 at each s_b,   M q'' = f + G^T mu,   G = dx/dq,
//
// so that a state that misses this by its integrator's errors returns to it (Baumgarte 1972). Held
// directions are the functions' matter (basis.hpp). The operators about q are those of all
// functions, with what the forces mu add to stiffness and flux; small motions take what G allows.
//
// About the straight pipe, where J_i = (w_i, 0), this is the projection of the pipe's equation,
// where it is uniform (Gregory and Paidoussis 1966),
//
//   w'''' + [a U^2 - gamma (1 - s)] w'' + gamma w' + 2 sqrt(beta) U w'.' + w.. + delta w''''. = 0,
//
// onto the functions w_i. Integrated by parts, its Coriolis term leaves a skew part and the flux
// through the end, at any configuration
//   G_ij = sqrt(beta) int (J_i . n w_j' - J_j . n w_i'),   F_ij = c sqrt(beta) J_i(1) . J_j(1).
#pragma once

#include <memory>
#include <mutex>
#include <string>

#include "pipedyn/galerkin/grid.hpp"

namespace pipedyn {

/// Immutable; one model may serve many threads. Moves with the vectors that the processor has
/// (levels.hpp). A state y = [q, q'] has 2 m entries; a batch holds one a column. The arrays are
/// the caller's and of the sizes given; scratch belongs to the thread and is allocated by its first
/// call for a size.
class Galerkin {
 public:
  /// least_nodes: use at least so many quadrature nodes on each panel, to measure what fewer miss.
  Galerkin(const Pipe& pipe, Basis basis, Index least_nodes = 0);

  Index dof() const { return basis_.size(); }
  const Pipe& pipe() const { return pipe_; }
  const Basis& basis() const { return basis_; }
  /// The integrals k_ij (m, m) where the stiffness varies along the pipe, else empty: see Basis.
  Matrix elastic() const { return Panels(basis_, pipe_).elastic; }

  /// Operators about a configuration q at rest, or where q is empty about the straight pipe, by a
  /// quadrature that is exact for products of functions. stiffness and flux are the derivatives of
  /// the forces of bending, gravity and terms and of the follower force. Throws
  /// std::invalid_argument unless q has m entries or none, and with q as what follows.
  Operators operators(const Vector& q = Vector()) const;

  // What follows throws std::invalid_argument where the basis is dependent to rounding.

  /// Quadrature nodes on each panel that a configuration is given. Throws std::invalid_argument
  /// unless q has m entries.
  Index nodes(const Vector& q) const;

  /// Why amplitudes with the given stride are not resolved by the largest grid, and how far it
  /// resolves a pipe of this shape; empty where they are.
  std::string unresolved(const double* q, Index stride) const;

  /// How many supports hold the pipe across, x = 0, the end's among them.
  Index supports() const {
    return static_cast<Index>(pipe_.supports.size()) +
           (pipe_.end == End::pinned || pipe_.end == End::clamped ? 1 : 0);
  }
  /// Rate k at which states that miss supports return to them, as those of scenes do (modular).
  static constexpr double return_rate = 60.0;
  /// x at each support, then of each its derivatives by q: (supports (1 + m), members).
  void held(const Batch& batch, double* out) const;

  /// dy/dtau (2 m, members), O(N Q m + N m^2 + m^3) a member with N points, Q nodes a panel. NaN
  /// where the mass matrix is singular to rounding, or q bends more than the largest grid resolves.
  void rhs(const Batch& batch, double* rates) const;
  /// Those of [q, q', W] (2 m + 1, members) with W' the sum of the power, as of a chain.
  void rhs_and_power(const Batch& batch, double* rates) const;
  /// d(dy/dtau)/dy (members, 2 m, 2 m), row-major, at the same order of cost. Drag's share is
  /// 2 |v_n| dv_n, 0 where v_n = 0.
  void jacobian(const Batch& batch, double* out) const { differentiate(batch, 0, out); }
  /// Rates of each member, their derivatives by the speed and by the state (members, 2 + 2 m, 2 m),
  /// at once.
  void linearise(const Batch& batch, double* out) const { differentiate(batch, 2, out); }
  /// Kinetic, elastic, gravity's and terms' energy of each member, O(N Q + N m); 0 at rest on the
  /// straight pipe.
  void energy(const Batch& batch, double* out) const;
  /// What flow, damping (joints), drag, terms (others) and the base's motion add to the energy in
  /// unit time, (5, members); their sum is dE/dtau.
  void power(const Batch& batch, double* out) const;
  /// MotionKernel::axial of [q, q', q''] (3 m, members), O(N Q + N m) a member.
  void axial(const Batch& batch, double* out) const;
  /// Position (x, y) of each member's free end and its velocity, (4, members), O(N m).
  void tips(const Batch& batch, double* out) const;

 private:
  const Grids& grids() const;
  /// The last rows of `linearise`, 2 m and so many before.
  void differentiate(const Batch& batch, Index before, double* out) const;

  Pipe pipe_;
  Basis basis_;
  Index least_nodes_;
  mutable std::once_flag moved_;
  mutable std::unique_ptr<const Grids> grids_;  // made by the first call that needs them
};

}  // namespace pipedyn
