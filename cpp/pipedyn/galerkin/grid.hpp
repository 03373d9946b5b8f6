// SPDX-License-Identifier: MIT
//
// How many quadrature nodes a reduced model's motion needs. Its integrands are products of the
// slopes Theta_i and of exp(+-i theta(s)) at two places, entire functions of s. On the ellipse with
// foci 0 and 1 whose axes sum to exp(eta) / 2, with Chebyshev coefficients c_ik of Theta_i,
//
//   |Im theta| <= sum_i |q_i| A_i,   A_i = sum_k |c_ik| sinh(k eta),
//   |Theta_i| / max |Theta_i| <= G = max_i sum_k |c_ik| cosh(k eta) / sum_k |c_ik|,
//
// and Q Gauss nodes miss about a fraction exp(-2 Q eta + 2 |Im theta|) of an integrand, times a G
// for each slope in it (after Trefethen 2008, theorem 4.5). A grid of Q nodes is taken when one of
// a few eta shows this to be below the tolerance. How many G to count was found by measurement, and
// so was the tolerance with drag, where integrals that end at the zeros of v_n miss exp(-Q eta).
// A mass per length that is a polynomial takes half its degree more.
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

/// The next multiple of a number.
inline Index whole(Index count, Index multiple) {
  return (count + multiple - 1) / multiple * multiple;
}

/// Passed by amplitudes q with sum_i |q_i| cost_i <= budget. Of the tests for so many nodes on a
/// panel amplitudes need pass one.
struct NodeTest {
  double budget;
  Vector cost;  // (m,)

  double cost_of(const double* q, Index stride) const {
    double sum = 0.0;
    for (Index i = 0; i < cost.size(); ++i) sum += std::abs(q[i * stride]) * cost[i];
    return sum;
  }
};

/// Functions orthonormal with the straight pipe's mass: in them a mass matrix is solved without
/// losing the digits that its condition number in the basis (1e6 for 8 Legendre functions) takes.
struct Orthonormal {
  bool identity;    // as for beam modes
  Matrix to_basis;  // T, upper triangular: their combinations of the basis, (m, m)
  Matrix inverse;   // upper triangular

  /// Throws std::invalid_argument where the basis is dependent to rounding.
  explicit Orthonormal(const Basis& basis);
  /// The basis' own functions, whether or not they are orthonormal.
  explicit Orthonormal(Index m);
};

/// The panels between the places of terms and supports, the pipe's steps and the basis' joints, on
/// which integrands are smooth, with what the terms add to the pipe. Immutable.
struct Panels {
  Vector ends;                   // from 0 to 1, (P + 1,)
  Vector mass;                   // at the end of each, (P,)
  Vector inertia;                // rotary inertia there, (P,); empty where all are 0
  double mass_per_length = 0.0;  // all along, the pipe's 1 not counted
  double normal_mass = 0.0;      // that of what moves across the pipe alone
  std::vector<PanelTerm> loads;  // terms that have one
  std::vector<Index> held;       // those at whose ends the pipe is held across
  Profile pipe_mass;             // m
  Vector turned;                 // of a root's spring sqrt(k_r) Theta_i(0), (m,), else empty
  Matrix elastic;  // integrals of e w_i'' w_j'' (m, m) where the stiffness varies, else empty

  Panels(const Basis& basis, const Pipe& pipe);

  Index count() const { return mass.size(); }
  /// Mass beyond a place of a uniform pipe, its own with the terms'; at a term's own place with it
  /// unless after.
  double mass_beyond(double s) const;
};

/// One rule on each panel with the slopes at its points, each panel's nodes and its end. Immutable.
struct Grid {
  Vector places;      // arc lengths of the points, (N,)
  Vector measure;     // weight, and 1 at panels' ends
  Vector mass;        // at each point, (N,)
  Matrix slope;       // Theta_i, (N, m padded)
  GridTables tables;  // of these and of what follows

  Grid(const Basis& basis, const Orthonormal& orthonormal, const Panels& panels, Index nodes);
  Grid(const Grid&) = delete;

 private:
  Quadrature rule_;
  Matrix slope_by_function_, orthonormal_, from_basis_, from_sums_, from_differences_, recurrence_;
  Vector inertia_;
  Matrix elastic_, elastic_forces_;
  Vector turned_, turned_forces_;
  Vector length_, arc_, weight_, beyond_, density_, stiffness_;

  void set_masses(const Panels& panels);
};

/// Grids of growing size, each built when it is first taken. Serves many threads.
class Grids {
 public:
  /// least_nodes: start from at least so many on each panel.
  Grids(Basis basis, const Pipe& pipe, Index least_nodes);

  const Basis& basis() const { return basis_; }
  const Panels& panels() const { return panels_; }
  const Orthonormal& orthonormal() const { return orthonormal_; }
  Index count() const { return static_cast<Index>(slots_.size()); }

  /// Number of the grid for amplitudes q with the given stride, O(m) a grid tried from a guess on.
  /// The largest serves all beyond. error: of rates, relative, that is enough; the least if 0.
  Index choose(const double* q, Index stride, Index guess = 0, double error = 0.0) const;

  /// Whether the grid chosen for q has the nodes that q takes; the largest may not.
  bool resolves(Index number, const double* q, Index stride) const;

  /// Factor up to which the largest grid has the nodes that multiples of q take.
  double resolved(const double* q) const;
  /// Nodes on a panel of the largest grid.
  Index most_nodes() const { return slots_.back().nodes; }

  /// O(Q^3 + N m) at the first call for this number, then free.
  const Grid& operator[](Index number) const;

 private:
  struct Slot {
    Index nodes = 0;
    std::vector<std::vector<NodeTest>> tests;  // of each panel
    std::once_flag built;
    std::unique_ptr<const Grid> grid;

    /// Whether amplitudes q with the given stride pass a test of each panel, O(m) a test, budgets
    /// being so much larger.
    bool resolves(const double* q, Index stride, double more = 0.0) const;
  };

  Basis basis_;
  Panels panels_;
  Orthonormal orthonormal_;
  bool drag_;
  mutable std::deque<Slot> slots_;
};

}  // namespace pipedyn
