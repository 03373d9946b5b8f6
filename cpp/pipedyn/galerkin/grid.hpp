// SPDX-License-Identifier: MIT
//
// The number of quadrature nodes that a motion of the reduced model needs. Its integrands are
// products of the slopes Theta_i and of exp(+-i theta(s)) at two places, entire functions of s. On
// the ellipse with foci 0 and 1 whose axes sum to exp(eta) / 2, with Chebyshev coefficients c_ik of
// Theta_i,
//
//   |Im theta| <= sum_i |q_i| A_i,   A_i = sum_k |c_ik| sinh(k eta),
//   |Theta_i| / max |Theta_i| <= G = max_i sum_k |c_ik| cosh(k eta) / sum_k |c_ik|,
//
// and the relative error of Q Gauss nodes is about exp(-2 Q eta + 2 |Im theta|) for an integrand,
// times one factor G for each slope in it (after Trefethen 2008, theorem 4.5). A grid of Q nodes is
// chosen if this error is below the tolerance for at least one of a few values of eta. The number
// of factors G to count was found by measurement, and so was the tolerance with drag, whose
// integrals end at the zeros of v_n and have an error of exp(-Q eta). A mass per length that is a
// polynomial needs additional nodes, half its degree, and so does an applied force.
#pragma once

#include <cmath>
#include <deque>
#include <memory>
#include <mutex>
#include <vector>

#include "pipedyn/galerkin/basis.hpp"
#include "pipedyn/galerkin/kernel.hpp"
#include "pipedyn/galerkin/quadrature.hpp"

namespace pipedyn {

/// The least multiple of `multiple` that is not less than count.
inline Index whole(Index count, Index multiple) {
  return (count + multiple - 1) / multiple * multiple;
}

/// Bounds of the slopes on the ellipse about a panel whose semi-axes are cosh(eta) and sinh(eta):
/// amplitudes q need `demand` + sum_i |q_i| cost_i <= 2 Q eta of Q nodes.
struct Ellipse {
  double eta, demand;
  Vector cost;  // (m,)

  double cost_of(const double* q, Index stride) const {
    double sum = 0.0;
    for (Index i = 0; i < cost.size(); ++i) sum += std::abs(q[i * stride]) * cost[i];
    return sum;
  }
};

/// The panels between the places of terms and supports, the steps of the pipe and the joints of the
/// basis, on which integrands are smooth, with what the terms add to the pipe. Immutable.
struct Panels {
  Vector ends;                   // ends of panels from 0 to 1, (P + 1,)
  Vector mass;                   // point mass at the end of each panel, (P,)
  Vector inertia;                // rotary inertia there, (P,)
  double mass_per_length = 0.0;  // mass of terms all along, without the 1 of the pipe
  double normal_mass = 0.0;      // mass per length that moves across the pipe alone
  std::vector<PanelTerm> loads;  // terms that have a load
  Index applied_degree = 0;      // of the polynomials of applied forces along the pipe
  std::vector<Index> held;       // panels at whose ends the pipe is held across
  Profile pipe_mass;             // m(s), the mass per length
  Profile pipe_stiffness;        // e(s), the bending stiffness
  double rotary_inertia;         // rotary inertia per length
  Matrix damped;                 // integrals of e w_i'' w_j'', (m, m)
  Matrix elastic;                // these and k_r w_i'(0) w_j'(0) of a spring at the root, (m, m)

  Panels(const Basis& basis, const Pipe& pipe);

  Index count() const { return mass.size(); }
};

/// A Gauss quadrature on each panel, with the slopes at its points: the nodes of each panel and its
/// end. Immutable. Its tables contain matrices of the panels that it is made of.
struct Grid {
  Vector places;      // arc lengths of the points, (N,)
  Matrix slope;       // Theta_i at the points, (N, m padded)
  GridTables tables;  // pointers to the panels' matrices, to the slopes and to what is kept

  /// from_basis: takes amplitudes to the orthonormal coordinates of the tables; upper triangular,
  /// (m, m).
  Grid(const Basis& basis, const Matrix& from_basis, const Panels& panels, Index nodes);
  Grid(const Grid&) = delete;

 private:
  std::vector<Matrix> kept_;
  std::vector<Index> turning_at_;
  std::vector<double> inertia_;

  const double* keep(Matrix table) { return kept_.emplace_back(std::move(table)).data(); }
};

/// Grids of growing size, each built when it is first used. Several threads may share it.
class Grids {
 public:
  /// least_nodes: least number of nodes on each panel.
  Grids(Basis basis, const Pipe& pipe, Index least_nodes);

  const Basis& basis() const { return basis_; }
  const Panels& panels() const { return panels_; }
  Index count() const { return static_cast<Index>(slots_.size()); }

  /// Number of the smallest grid that is fine enough for amplitudes q with the given stride, in
  /// O(m). Amplitudes beyond all grids get the largest. error: relative error of the rates that is
  /// enough; 0 for the least one.
  Index choose(const double* q, Index stride, double error = 0.0) const;

  /// Whether the grid chosen for q has as many nodes as q needs; the largest grid may have too few.
  bool resolves(Index number, const double* q, Index stride) const;

  /// Largest factor by which q may be multiplied such that the largest grid still has enough nodes.
  double resolved(const double* q) const;
  /// Number of nodes on a panel of the largest grid.
  Index most_nodes() const { return slots_.back().nodes; }

  /// The grid of this number: costs O(Q^3 + N m) at the first call and nothing afterwards.
  const Grid& operator[](Index number) const;

 private:
  struct Slot {
    Index nodes = 0;
    std::once_flag built;
    std::unique_ptr<const Grid> grid;
  };

  /// Number of nodes on each panel that amplitudes q with the given stride need at least, not less
  /// than those of the smallest grid; infinite for NaN. allowed: logarithm of the factor by which
  /// errors may be larger.
  double needed(const double* q, Index stride, double allowed = 0.0) const;

  Basis basis_;
  Panels panels_;
  Matrix from_basis_;
  bool drag_;
  double more_nodes_;                           // for a mass per length that varies
  std::vector<std::vector<Ellipse>> ellipses_;  // about each panel
  mutable std::deque<Slot> slots_;
};

}  // namespace pipedyn
