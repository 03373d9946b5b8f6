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
#pragma once

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

/// Absolute Chebyshev coefficients of the slopes on an interval, (count, m); those of rounding's
/// size are 0.
Matrix slope_series(const Basis& basis, double low = 0.0, double high = 1.0);

/// Passed by amplitudes q with sum_i |q_i| cost_i <= budget.
struct NodeTest {
  double budget;
  Vector cost;  // (m,)
};

/// Tests for so many nodes on the series' interval, of which amplitudes need pass one. drag:
/// integrals end at inner points.
std::vector<NodeTest> node_tests(const Matrix& series, Index nodes, bool drag);

/// Whether amplitudes q with the given stride pass one of the tests, O(m) a test.
bool passes(const std::vector<NodeTest>& tests, const double* q, Index stride);

/// Least number of nodes on an interval.
Index least_nodes(bool drag);

/// Throws std::invalid_argument unless a model with m functions is given so many amplitudes.
void require_amplitudes(Index entries, Index m);

/// Functions orthonormal with the straight pipe's mass: in them a mass matrix is solved without
/// losing the digits that its condition number in the basis (1e6 for 8 Legendre functions) takes.
struct Orthonormal {
  bool identity;    // as for beam modes
  Matrix to_basis;  // T, upper triangular: their combinations of the basis, (m, m)
  Matrix inverse;   // upper triangular

  /// Throws std::invalid_argument where the basis is dependent to rounding.
  explicit Orthonormal(const Basis& basis);
};

/// One rule with the slopes at its points (the nodes and the free end). Immutable.
class Grid {
 public:
  Grid(const Basis& basis, const Orthonormal& orthonormal, Index nodes);

  Index nodes() const { return rule_.size(); }
  const Quadrature& rule() const { return rule_; }
  const Matrix& slope() const { return slope_; }              // Theta_i, (Q + 1, m)
  const Matrix& orthonormal() const { return orthonormal_; }  // Theta T, (Q + 1, m padded)
  const GridTables& tables() const { return tables_; }

 private:
  Quadrature rule_;
  Matrix slope_, slope_by_function_, orthonormal_;
  Matrix from_sums_, from_differences_, expansion_, recurrence_;
  Vector arc_, folded_weight_, stiffness_;
  GridTables tables_;
};

/// Grids of growing size, each built when it is first taken. Serves many threads.
class Grids {
 public:
  /// least_nodes: start from at least so many; drag: integrals end at inner points.
  Grids(Basis basis, bool drag, Index least_nodes);

  const Basis& basis() const { return basis_; }
  const Orthonormal& orthonormal() const { return orthonormal_; }
  Index count() const { return static_cast<Index>(slots_.size()); }

  /// Number of the grid for amplitudes q with the given stride, O(m) a grid tried. The largest
  /// serves all beyond.
  Index choose(const double* q, Index stride) const;

  /// Whether the grid chosen for q has the nodes that q takes; the largest may not.
  bool resolves(Index number, const double* q, Index stride) const;

  /// O(Q^3) at the first call for this number, then free.
  const Grid& operator[](Index number) const;

 private:
  struct Slot {
    Index nodes = 0;
    std::vector<NodeTest> tests;
    std::once_flag built;
    std::unique_ptr<const Grid> grid;
  };

  Basis basis_;
  Orthonormal orthonormal_;
  mutable std::deque<Slot> slots_;
};

}  // namespace pipedyn
