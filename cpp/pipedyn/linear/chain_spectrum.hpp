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
  std::vector<double> residual;            // |Y|^T |T X| / (|Y|^T |T| |X|)
  std::vector<double> uncertain;           // how far residual and rounding may have moved lambda
  std::vector<Complex> slope;              // d lambda / du
  std::vector<Complex> by_left, by_right;  // y^H (dP/dlambda) x and x^H (dP/dlambda) x
  std::vector<Complex> correction;         // of lambda by its vectors, 0 where it is rounding
  ComplexTable right, left;                // x and y in elastic coordinates, unit; (rows, count)
  std::size_t rows;                        // n, or 0 where vectors were not asked for

  ChainRoots(std::vector<Complex> at, std::size_t rows);
  std::size_t count() const { return values.size(); }
  /// Takes a root of others, or its conjugate, to place k.
  void take(std::size_t k, const ChainRoots& others, std::size_t i, bool conjugate);
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
  ChainRoots at(double u, const std::vector<Complex>& values, bool vectors) const;
  ChainRoots vectors_at(double u, const std::vector<Complex>& values, bool vectors,
                        bool loaded) const;
  ChainRoots polished(double u, const Approximations& roots, bool squared, bool vectors) const;
  bool is_complete(double u, const Approximations& roots) const;
  bool has_all_within(double u, double radius, const Approximations& roots) const;
  bool separated(double u, const Approximations& roots, std::size_t least) const;
};

}  // namespace pipedyn
