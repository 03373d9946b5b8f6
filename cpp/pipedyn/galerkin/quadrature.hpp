// SPDX-License-Identifier: MIT
//
// Gauss-Legendre quadrature on [0, 1], and the integral from 0 to any point of the polynomial that
// interpolates a function at its nodes. With x = 2 s - 1 and the antiderivatives I_0 = s,
// I_k = (P_{k+1} - P_{k-1}) / (2 (2 k + 1)),
//
//   int_0^s f = sum_k I_k(s) sum_p expansion(k, p) f(s_p),
//   expansion(k, p) = (2 k + 1) w_p P_k(x_p).
//
// With s at the nodes, these integrals form the matrix S of Gauss collocation, for which
// W S + S^T W = w w^T: a discrete integration by parts without error, for any number of nodes.
#pragma once

#include "pipedyn/pipe.hpp"

namespace pipedyn {

using Slab = Eigen::Ref<const Matrix, 0, Eigen::OuterStride<>>;
using WritableSlab = Eigen::Ref<Matrix, 0, Eigen::OuterStride<>>;

/// Computes out += factor a^T b; out overlaps neither a nor b. Compiled once, not for each pair of
/// expressions.
void add_inner(WritableSlab out, double factor, const Slab& a, const Slab& b);

/// Returns a^T diag(weight) b. If the columns of a and b are functions at the nodes of a
/// quadrature, these are the integrals of their products.
Matrix inner(const Slab& a, const Eigen::Ref<const Vector>& weight, const Slab& b);

struct Quadrature {
  Vector node;       // s_p, ascending, shape (count,)
  Vector weight;     // w_p, shape (count,)
  Matrix expansion;  // the matrix in the formula above, (count, count)

  /// Computes nodes and weights in O(count^2). Throws std::invalid_argument if count < 1.
  explicit Quadrature(Index count);

  Index size() const { return node.size(); }

  /// Weights of the nodes in the integral from 0 to each point s, shape (len(s), count), in
  /// O(len(s) count^2).
  Matrix integral_to(const Vector& s) const;
};

/// Legendre polynomials P_k for k < count: at x, written to out, or at 2 s - 1, (len(s), count).
void legendre_values(double x, Index count, double* out);
Matrix legendre_values(const Vector& s, Index count);

/// Integrals from 0 to s of P_k(2 s - 1), or of such integrals. values: the integrands at the
/// points, (len(s), count); first: the integral of the first one. Returns (len(s), count - 1).
Matrix legendre_integrals(const Matrix& values, const Vector& first);

}  // namespace pipedyn
