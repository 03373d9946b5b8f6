// SPDX-License-Identifier: MIT
//
// Roots of a determinant: starts, their simultaneous corrections, and what counts them. See
// structured.hpp.
#pragma once

#include <vector>

#include "pipedyn/linear/determinant.hpp"
#include "pipedyn/linear/eigenproblem.hpp"

namespace pipedyn {

/// Where the log-derivative counts roots: this far from the real axis, in rad, near which the
/// unstable ones of a buckled pipe lie, and from the imaginary one.
inline constexpr double ray = 0.3;
/// Of starts: six to ten do; roots in the cluster at -1 / delta, of which LAPACK finds only where
/// it lies, took up to 150.
inline constexpr int most_corrections = 300;

/// A root with its conjugate, or (`alone`) one of which no conjugate is implied.
struct Approximation {
  Complex value;
  bool alone = false;
  bool settled = false;  // zero by structure, or better known than its vectors would make it
  Complex slope = 0.0;   // d lambda / du, 0 where not known
  // The same at a speed that lies lower by `since`, 0 where not known.
  double since = 0.0;
  Complex value_before = 0.0, slope_before = 0.0;
};
using Approximations = std::vector<Approximation>;

/// d log det P / dlambda - sum_k 1 / (lambda - lambda_k), but for roots k at lambda itself.
Values log_derivatives(const Determinant& of, double u, const Values& at,
                       const Approximations& roots = {});

/// Number of roots, with the conjugates that are implied.
Index roots_in(const Approximations& all);

/// As `by_size` does.
void sort_by_size(Approximations& all);

/// LAPACK's roots; where roots come in conjugate pairs, the upper of each.
Approximations dense_roots(const DenseOperator& p, bool squared);

/// Roots at rest, as near as modes that damping does not couple have them: from eigenvectors x of
/// K x = omega^2 M x, with loss factor mu, lambda^2 + lambda x^T D x + omega^2 + i mu x^T K_el x =
/// 0.
Approximations modal_roots(const DenseOperator& at_rest, const Modes& modes, double loss);

/// Number of roots that are zero: near zero det P is lambda to that power.
Index roots_at_zero(const Determinant& of, double u);

/// Puts so many zeros in place of the least of sorted roots.
void put_zeros(Approximations& roots, Index count);

/// Adds starts of the stiff roots, where roots are counted: of those below |lambda| = r there are
/// about Re(lambda d log det P / dlambda).
void add_stiff(const Determinant& of, Index dof, double u, Approximations& roots);

/// Makes one root with its conjugate of two conjugates that were found each by itself; for roots
/// that come in conjugate pairs.
void join_conjugates(Approximations& roots);

/// Where the roots of one speed are expected further on by so much; in the cluster at -1 / delta,
/// where rounding makes the slopes, as they were. Of two that meet on the real axis within that
/// their sum and product are expected, which are smooth in u, and neither implies a conjugate; so
/// where roots come in conjugate pairs.
Approximations expected(const Approximations& roots, double further, Complex delta, bool paired);

/// Ehrlich's and Aberth's corrections of all roots until each is as good as rounding lets it. Those
/// that are not after so many have twice as many more, for which they begin again beside the real
/// axis if they are near it, as symmetry may have held them. Whether all are then.
bool correct(const Determinant& of, double u, Approximations& roots, int most = most_corrections);

/// Whether no root is missing, and none in place of another: of all roots what is left of the
/// log-derivative vanishes, here at points between the least |lambda| and the greatest.
bool has_all(const Determinant& of, double u, const Approximations& roots);

/// Two oscillating roots about to meet, each of which scatters by the square root of rounding, from
/// their sum and that of their squares, which do not: moments of d log det P / dlambda on a circle
/// about both.
void separate(const Determinant& of, double u, bool squared, Approximations& roots);

}  // namespace pipedyn
