// SPDX-License-Identifier: MIT
//
// Motion of the reduced model with fittings, geometrically exact: the equations of
// galerkin_motion.hpp, to which a fitting with mass mu and stiffness k at the arc length s_f adds
// the virtual work
//
//   J_i(s_f) . (mu a(s_f) - mu gamma (0, 1) + k x(s_f) (1, 0)),
//
// and to the energy mu |v(s_f)|^2 / 2 - mu gamma (y(s_f) - s_f) + k x(s_f)^2 / 2. A spring pulls
// along x alone and is linear in x; the jet has the pipe's section at any mass.
//
// The quadrature is Gauss collocation on each panel between fittings: integrals from the clamp to
// the points are block lower triangular, and W S + S^T W = w w^T holds as on one panel, so that the
// energy balance holds to rounding. What a fitting does is one more load at a panel's end.
#pragma once

#include <deque>
#include <memory>
#include <mutex>
#include <vector>

#include "pipedyn/chain/motion.hpp"
#include "pipedyn/galerkin/fitting.hpp"
#include "pipedyn/galerkin/grid.hpp"

namespace pipedyn {

/// Points of a quadrature on panels, and what does not change with the state there. Immutable.
///
/// Points are, panel by panel, the n Gauss nodes and the panel's end, whose weight is 0; the last
/// is the free end.
class PanelGrid {
 public:
  /// ends: of the panels, from 0 to 1; mass: fitted at the end of each panel, (panels,).
  PanelGrid(const Basis& basis, const Orthonormal& orthonormal, const Vector& ends,
            const Vector& mass, Index nodes);

  Index nodes() const { return rule_.size(); }
  Index panels() const { return length_.size(); }
  Index points() const { return weight_.size(); }
  Index end_of(Index panel) const { return (panel + 1) * (nodes() + 1) - 1; }

  const Vector& weight() const { return weight_; }            // of the quadrature, (points,)
  const Vector& mass() const { return mass_; }                // the pipe's and fitted, (points,)
  const Vector& hanging() const { return hanging_; }          // weight by mass beyond, (points,)
  const Matrix& slope() const { return slope_; }              // Theta_i, (points, m)
  const Matrix& orthonormal() const { return orthonormal_; }  // Theta T, (points, m)

  /// Integrals from 0 to each point of what f is at the nodes, (points, columns),
  /// O(n points columns).
  void integrate(const Matrix& f, Matrix& out) const;
  /// Transposed: of loads at the points, what each node's turning bears, (points, columns).
  void integrate_beyond(const Matrix& load, Matrix& out) const;

  /// Weights that integrate sign(v) f for a smooth f, given v at the points, panel by panel as
  /// GalerkinKernel's. A zero between a joint and the node after it is not seen: it would count by
  /// the cube of that distance, 1e-9 at 31 nodes.
  void signed_weights(const Vector& v, Vector& weights) const;

 private:
  Quadrature rule_;
  Matrix integral_;  // on [0, 1] to the nodes and 1, last column 0, (n + 1, n + 1)
  Vector length_, weight_, mass_, hanging_, arc_;
  Matrix slope_, orthonormal_, recurrence_;
  GridTables tables_;  // what signed weights read, on [0, 1]
};

/// Immutable; one model may serve many threads. Members of a batch go one after another. A state
/// y = [q, q'] has 2 m entries; a batch holds one a column.
class FittedMotion {
 public:
  /// least_nodes: use at least so many quadrature nodes on each panel, to measure what fewer miss.
  /// Throws std::invalid_argument where the basis is dependent to rounding, or unless 0 < at <= 1
  /// for each fitting.
  FittedMotion(const Pipe& pipe, Basis basis, const Fittings& fittings, Index least_nodes = 0);

  Index dof() const { return basis_.size(); }

  /// Quadrature nodes on each panel that a configuration is given. Throws std::invalid_argument
  /// unless q has m entries.
  Index nodes(const Vector& q) const;

  /// dy/dtau (2 m, members), O(N n m + N m^2 + m^3) a member with N points, n of them on a panel.
  /// NaN where the mass matrix is singular to rounding, or q bends more than the largest grid
  /// resolves.
  void rhs(const Batch& batch, double* rates) const;
  /// d(dy/dtau)/dy (2 m, 2 m), row-major, at the same order of cost. Drag's share is 2 |v_n| dv_n,
  /// 0 where v_n = 0.
  void jacobian(const double* y, double u, double* out) const;
  /// Kinetic, elastic and gravity's energy of each member, O(N n + N m); 0 at rest on the straight
  /// pipe.
  void energy(const Batch& batch, double* out) const;
  /// What flow, damping (joints) and drag add to the energy in unit time; their sum is dE/dtau.
  void power(const Batch& batch, const PowerParts& out) const;

  /// Operators about a configuration q at rest; stiffness and flux are the derivatives of the
  /// forces of bending, springs and gravity and of the follower force. Throws std::invalid_argument
  /// unless q has m entries.
  Operators operators(const Vector& q) const;

 private:
  struct Slot {
    Index nodes = 0;
    std::vector<std::vector<NodeTest>> tests;  // of each panel
    std::once_flag built;
    std::unique_ptr<const PanelGrid> grid;
  };

  /// The grid for amplitudes with the given stride; the largest serves all beyond. Built when it is
  /// first taken.
  const PanelGrid& grid_for(const double* q, Index stride) const;
  /// Whether that grid has the nodes that q takes; the largest may not.
  bool resolves(const PanelGrid& grid, const double* q) const;
  void accelerations(const PanelGrid& grid, const Vector& q, const Vector& rate, double u,
                     Vector& out) const;

  Pipe pipe_;
  Basis basis_;
  Orthonormal orthonormal_;
  Vector ends_;              // of the panels of the quadrature
  Vector mass_, stiffness_;  // fitted at the end of each panel
  Vector elastic_;           // k_i
  mutable std::deque<Slot> slots_;
};

}  // namespace pipedyn
