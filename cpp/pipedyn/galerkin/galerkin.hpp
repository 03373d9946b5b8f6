// SPDX-License-Identifier: MIT
//
// Geometrically exact reduced model. The inextensible centreline is described by its angle from the
// downward vertical, theta(s) = sum_i q_i Theta_i(s) with the slopes Theta_i = w_i' of a basis:
//
//   t = (sin theta, cos theta),  n = (cos theta, -sin theta),  r(s) = int_0^s t,
//   J_i(s) = dr/dq_i = int_0^s n Theta_i,   velocity v = sum_i J_i q_i'.
//
// The virtual work, with U = s u and the forces per length of Orsino and Di Giulio in the limit of
// short segments (there is no expansion in the amplitude anywhere), is
//
//   int m J_i . a + sum_j k_ij (q_j + delta q_j')                               inertia, bending
//     + J int Theta_i theta''                                                   rotary inertia
//     + 2 sqrt(beta) U int J_i . n theta'                                       Coriolis, end flux
//     - (1 - c) sqrt(beta) U v(1) . J_i(1)                                      entering flow
//     + a U^2 (cos psi t(1) + sin psi n(1)) . J_i(1)                            follower force
//     + sqrt(beta) U' int t . J_i                                               unsteady flow
//     - gamma int m J_i . (sin iota, cos iota)                                  gravity
//     + kappa int |v_n| v_n n . J_i = 0,   v_n = n . v,                         drag
//   a(s) = (X'', Y'') + sum_i J_i q_i'' - int_0^s t theta'^2,
//
// where theta' is the rate, m the mass per length, J the rotary inertia of cross-sections, and k_ij
// the integral of e Theta_i' Theta_j' with the bending stiffness e. In either family of functions
// k_ij is diagonal if the pipe is uniform, e = m = 1; the fluid is always uniform. As v' = n
// theta', the power of the Coriolis term is -sqrt(beta) U |v(1)|^2:
//
//   dE/dtau = -c sqrt(beta) U |v(1)|^2 - a U^2 (cos psi t(1) + sin psi n(1)) . v(1)
//     - sqrt(beta) U' int t . v - delta sum k_ij q_i' q_j' - kappa int |v_n|^3,
//
// if the base is at rest. The base may be at (X, Y), a function of time: drag and terms then depend
// on the velocity v + (X', Y'). The energy is the one in the frame of the base; with the force R of
// drag and terms, the motion of the base adds the power -(X'', Y'') . int v - (X', Y') . R. The
// energy balance holds to rounding for any number of nodes, since the quadrature integrates by
// parts exactly (quadrature.hpp). The integrand of drag is cut at the zeros of v_n
// (signed_weights.hpp).
//
// A term (terms/station.hpp) with mass mu and load f at the arc length s_f adds the virtual work
//
//   J_i(s_f) . (mu a(s_f) - mu gamma (sin iota, cos iota) - f).
//
// Mass that moves across the pipe alone (terms/added_mass.hpp) adds chi int (n . J_i) (n . a), and
// a couple c adds the virtual work -c Theta_i(s_f), or its integral. Rotary inertia I at s_f adds
// I Theta_i Theta_j to the mass matrix, at any amplitude, since theta is linear in q.
//
// The quadrature is Gauss collocation on each panel between the places of terms and the steps of e
// and m: integrals from the clamp to its points form a block lower triangular matrix, and
// integration by parts holds as on one panel. So a term is one more load at the end of a panel, or
// at every node if it acts all along.
//
// The spring of a root (pipe.hpp) is part of k_ij, but it is not damped: the k_ij in the terms with
// delta do not contain it.
//
// If the pipe is held across, x(s_b) = 0, forces mu_b along x act at these places such that
//
//   x'' + 2 k x' + k^2 x = 0 at each s_b,   M q'' = f + G^T mu,   G = dx/dq,
//
// so that a state that violates x = 0 by the errors of its integrator returns to it (Baumgarte
// 1972). If the direction of the pipe is held, the functions satisfy this condition (basis.hpp).
// The operators about q are those of all functions, and include what the forces mu add to stiffness
// and flux; small motions are restricted to those that G allows.
//
// About the straight pipe, where J_i = (w_i, 0), and if the pipe is uniform, this is the projection
// of the equation of the pipe (Gregory and Paidoussis 1966),
//
//   w'''' + [a U^2 - gamma (1 - s)] w'' + gamma w' + 2 sqrt(beta) U w'.' + w.. + delta w''''. = 0,
//
// onto the functions w_i. After integration by parts, the Coriolis term consists of a skew part and
// the flux through the end, at any configuration:
//   G_ij = sqrt(beta) int (J_i . n w_j' - J_j . n w_i'),   F_ij = c sqrt(beta) J_i(1) . J_j(1).
#pragma once

#include <memory>
#include <mutex>
#include <string>

#include "pipedyn/galerkin/grid.hpp"

namespace pipedyn {

/// What reduced models of a pipe share that move in a plane or in space, where both planes have the
/// same functions. Immutable; several threads may share one model. It computes motions with the
/// vectors that the processor has (levels.hpp). A state is [q, q'] with n = dof() coordinates q, m
/// a plane; a batch holds one state in each column. The arrays belong to the caller and have the
/// sizes given; scratch belongs to the thread and is allocated by its first call for a size. The
/// functions of a state throw std::invalid_argument if the functions of the basis are linearly
/// dependent to rounding.
class ReducedMotion {
 public:
  Index dof() const { return planes_ * basis_.size(); }
  const Pipe& pipe() const { return pipe_; }
  const Basis& basis() const { return basis_; }

  /// dy/dtau (2 n, members), in O(N Q m + N m^2 + m^3) a member with N points and Q nodes a panel.
  /// The result is NaN if the mass matrix is singular to rounding, or if q bends more than the
  /// largest grid resolves.
  void rhs(const Batch& batch, double* rates) const;
  /// Rates of [q, q', W] (2 n + 1, members), where W' is the sum of the power, as for a chain.
  void rhs_and_power(const Batch& batch, double* rates) const;
  /// d(dy/dtau)/dy (members, 2 n, 2 n), row-major, in a plane at the same order of cost as `rhs`.
  /// The drag contributes 2 |v_n| dv_n, 0 where v_n = 0.
  void jacobian(const Batch& batch, double* out) const { differentiate(batch, 0, out); }
  /// Rates of each member, followed by their derivatives by the speed and by the state (members,
  /// 2 + 2 n, 2 n), in one evaluation.
  void linearise(const Batch& batch, double* out) const { differentiate(batch, 2, out); }
  /// Sum of the kinetic and elastic energies and those of gravity and terms for each member, in O(N
  /// Q + N m); it is 0 at rest on the straight pipe.
  void energy(const Batch& batch, double* out) const;
  /// Power that flow, damping (joints), drag, terms (others) and the motion of the base add to the
  /// energy, (5, members); their sum is dE/dtau.
  void power(const Batch& batch, double* out) const;
  /// Number of components of the free end's position, with its velocity: 4, or 6 in space.
  Index tip_rows() const { return 2 * (planes_ + 1); }
  /// Position (x, y), or (x, y, z), of the free end of each member, then its velocity, (tip_rows(),
  /// members), in O(N m).
  void tips(const Batch& batch, double* out) const;

  /// Rate k at which states that violate x = 0 at supports return to it; it is the same for scenes
  /// (modular).
  static constexpr double return_rate = 60.0;

 protected:
  ReducedMotion(const Pipe& pipe, Basis basis, Index planes, Index least_nodes);
  const Grids& grids() const;
  /// As `Galerkin::unresolved`, for amplitudes (m,) whose sizes are summed over the planes.
  std::string unresolved_sum(Vector amplitudes) const;

 private:
  /// Writes the last rows of `linearise` of each member: 2 n rows and `before` rows that precede
  /// them.
  void differentiate(const Batch& batch, Index before, double* out) const;

  Pipe pipe_;
  Basis basis_;
  Index planes_, least_nodes_;
  mutable std::once_flag moved_;
  mutable std::unique_ptr<const Grids> grids_;  // made by the first call that needs them
};

/// The reduced model of a pipe that moves in a plane. A state y = [q, q'] has 2 m entries.
class Galerkin : public ReducedMotion {
 public:
  /// least_nodes: least number of quadrature nodes on each panel, to measure the error of fewer
  /// nodes.
  Galerkin(const Pipe& pipe, Basis basis, Index least_nodes = 0)
      : ReducedMotion(pipe, std::move(basis), 1, least_nodes) {}

  /// The integrals k_ij, (m, m).
  Matrix elastic() const { return Panels(basis(), pipe()).elastic; }

  /// Operators about a configuration q at rest, or about the straight pipe if q is empty, by a
  /// quadrature that is exact for products of functions. stiffness and flux are the derivatives of
  /// the forces of bending, gravity and terms and of the follower force. Throws
  /// std::invalid_argument unless q has m entries or none.
  Operators operators(const Vector& q = Vector()) const;

  /// Number of quadrature nodes on each panel for a configuration q. Throws std::invalid_argument
  /// unless q has m entries.
  Index nodes(const Vector& q) const;

  /// A message that the largest grid does not resolve the amplitudes with the given stride, and how
  /// far it resolves a pipe of this shape; empty if it resolves them.
  std::string unresolved(const double* q, Index stride) const;

  /// Number of supports that hold the pipe across, x = 0, with the one at the end.
  Index supports() const {
    return static_cast<Index>(pipe().supports.size()) + (pipe().end_held() ? 1 : 0);
  }
  /// x at each support, followed by the derivatives of each of these x by q:
  /// (supports (1 + m), members).
  void held(const Batch& batch, double* out) const;

  /// Axial acceleration and its derivatives as MotionKernel::axial, for [q, q', q''] (3 m,
  /// members), in O(N Q + N m) a member.
  void axial(const Batch& batch, double* out) const;
};

/// The reduced model of a pipe that moves in three dimensions (galerkin/space.hpp). A state y =
/// [q_x, q_z, q_x', q_z'] has 4 m entries.
class SpatialGalerkin : public ReducedMotion {
 public:
  /// Throws std::invalid_argument for pipes without equations in space, as `SpatialChain` does.
  SpatialGalerkin(const Pipe& pipe, Basis basis, Index least_nodes = 0);

  /// As for Galerkin, or that the tangent turns by more than half a turn, where the coordinates
  /// end.
  std::string unresolved(const double* q, Index stride) const;
};

}  // namespace pipedyn
