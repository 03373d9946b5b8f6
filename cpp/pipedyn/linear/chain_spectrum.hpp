// SPDX-License-Identifier: MIT
//
// Roots of a straight chain by the recursion of chain/impedance.hpp, O(n) for one of them.
//
// Starts are LAPACK's roots of the chain, or for few of a long one those of a coarser chain. All
// are corrected at once by the method of Ehrlich and Aberth, Newton's on what the others leave of
// the determinant,
//   1 / (d log det P / dlambda - sum_k 1 / (lambda - lambda_k)),
// so that no two end on one root. That none is missing is checked by the same expression without
// the root itself: it vanishes if all roots are there, and its mean over a circle, times lambda,
// is the number of those missing inside.
#pragma once

#include <optional>
#include <vector>

#include "pipedyn/chain/chain.hpp"
#include "pipedyn/linear/eigenpairs.hpp"

namespace pipedyn {

/// Roots sorted by |lambda|, of conjugates the upper first; (count) of each.
struct ChainRoots {
  std::vector<Complex> values;
  std::vector<double> residual;             // |Y|^T |T X| / (|Y|^T |T| |X|)
  std::vector<double> uncertain;            // how far residual and rounding may have moved lambda
  std::vector<Complex> slope;               // d lambda / du
  std::vector<Complex> by_left, by_right;   // y^H (dP/dlambda) x and x^H (dP/dlambda) x
  ComplexTable right, left;                 // x and y in elastic coordinates, unit; (n, count)

  std::size_t count() const { return values.size(); }
};

/// A root with its conjugate, or (`alone`) one of which no conjugate is implied.
struct Approximation {
  Complex value;
  bool alone = false;
};
using Approximations = std::vector<Approximation>;

class ChainSpectrum {
 public:
  /// The chain must outlive it. scale: joint angles of the elastic coordinates, (n).
  ChainSpectrum(const Chain& chain, const Lapack& lapack, Vector scale)
      : chain_(chain), lapack_(lapack), scale_(std::move(scale)) {}

  /// The `count` roots of least |lambda|; none where they could not be told from one another, or
  /// where some may be missing.
  std::optional<ChainRoots> lowest(double u, Index count, bool vectors) const;

  /// The root next to a guess, by at most so many steps of Newton's method.
  ChainRoots near(double u, Complex guess, int most_steps) const;

 private:
  const Chain& chain_;
  const Lapack lapack_;
  const Vector scale_;

  bool has_rate(double u) const;
  ChainRoots at(double u, std::vector<Complex> values, bool vectors,
                std::vector<Complex>& corrections) const;
  ChainRoots polished(double u, const Approximations& roots, bool squared, bool vectors) const;
  bool is_complete(double u, const Approximations& roots) const;
  bool has_all_within(double u, double radius, const Approximations& roots) const;
  bool separated(double u, const Approximations& roots, std::size_t least) const;
};

}  // namespace pipedyn
