// SPDX-License-Identifier: MIT
//
// Roots of a determinant: their starts, their simultaneous corrections, and the counts of them. See
// structured.hpp.
#pragma once

#include <vector>

#include "pipedyn/linear/determinant.hpp"
#include "pipedyn/linear/eigenproblem.hpp"

namespace pipedyn {

/// Angle in rad from the real axis of the points at which the log-derivative counts roots: away
/// from the real axis, near which the unstable roots of a buckled pipe lie, and from the imaginary
/// axis.
inline constexpr double ray = 0.3;
/// Most corrections of starts: six to ten are enough for most, but roots in the cluster at -1 /
/// delta, of which LAPACK finds only the place of the cluster, took up to 150.
inline constexpr int most_corrections = 300;

/// A root that stands also for its conjugate, or (`alone`) for itself only.
struct Approximation {
  Complex value;
  bool alone = false;
  bool settled = false;  // zero by structure, or known better than by its vectors
  Complex slope = 0.0;   // d lambda / du, 0 where it is not known
  // Value and slope at a speed that is lower by `since`; since = 0 where they are not known.
  double since = 0.0;
  Complex value_before = 0.0, slope_before = 0.0;
};
using Approximations = std::vector<Approximation>;

/// Memory that a search for roots uses at one speed after another.
struct RootsMemory {
  Values at, found, known;   // points, log-derivatives there, roots with their conjugates
  std::vector<double> last;  // relative corrections
  std::vector<char> marks;   // of roots
  std::vector<std::size_t> active, every;
  std::vector<Index> order;
  Approximations roots;
};

/// d log det P / dlambda - sum_k 1 / (lambda - lambda_k) over all roots and their implied
/// conjugates, without roots at lambda itself, in the memory until the next call.
Eigen::Ref<Values> log_derivatives(const Determinant& of, double u, const ValuesRef& at,
                                   const Approximations& roots, RootsMemory& memory);

/// Number of roots, including the conjugates that are implied.
Index roots_in(const Approximations& all);

/// Sorts roots in the order of `by_size`.
void sort_by_size(Approximations& all, RootsMemory& memory);

/// Roots of P by LAPACK; where roots come in conjugate pairs, the upper root of each.
Approximations dense_roots(const DenseOperator& p, bool squared);

/// Approximate roots at rest, which neglect that damping couples modes: with eigenvectors x of K
/// x = omega^2 M x and loss factor mu they solve lambda^2 + lambda x^T D x + omega^2 + i mu x^T
/// K_el x = 0. Modes without vectors give the roots of the pipe without damping.
Approximations modal_roots(const DenseOperator& at_rest, const Modes& modes, double loss);

/// Number of roots that are zero: near zero det P goes like lambda to this power.
Index roots_at_zero(const Determinant& of, double u);

/// Replaces the least of sorted roots by `count` zeros.
void put_zeros(Approximations& roots, Index count);

/// Adds starts of the stiff roots, at places found by counting roots: about Re(lambda d log det
/// P / dlambda) of them are below |lambda| = r.
void add_stiff(const Determinant& of, Index dof, double u, Approximations& roots);

/// Joins two conjugates that were found separately into one root that implies its conjugate; for
/// roots that come in conjugate pairs. values: the roots, better known. left: their indices, on
/// return those of the roots that are left.
void join_conjugates(Approximations& roots, const Values& values, std::vector<Index>& left);

/// Roots expected at a speed that is higher by `further` than that of the given roots, by the cubic
/// through two speeds, or along the slope if only one is known. Roots in the cluster at -1 / delta,
/// where slopes are rounding, stay as they were. Where roots come in conjugate pairs (`paired`),
/// two that meet on the real axis before that speed are extrapolated together; neither of them
/// implies a conjugate.
/// They are written to `result`.
void expected(const Approximations& roots, double further, Complex delta, bool paired,
              Approximations& result, RootsMemory& memory);

/// Corrects all roots by the method of Ehrlich and Aberth until each is as good as rounding lets it
/// be. Roots that are not after `most` corrections get twice as many more; of these, roots near the
/// real axis begin again beside it, as symmetry may have held them there. Returns whether all roots
/// are good then.
bool correct(const Determinant& of, double u, Approximations& roots, RootsMemory& memory,
             int most = most_corrections);

/// Whether no root is missing, and none in the place of another: then the log-derivative less the
/// sum over all roots vanishes. It is tested at points between the least |lambda| and the greatest.
bool has_all(const Determinant& of, double u, const Approximations& roots, RootsMemory& memory);

/// Improves two oscillating roots that are about to meet. Each of them scatters by the square root
/// of rounding, but their sum and the sum of their squares do not: these are moments of d log det
/// P / dlambda on a circle about both.
void separate(const Determinant& of, double u, bool squared, Approximations& roots,
              RootsMemory& memory);

}  // namespace pipedyn
