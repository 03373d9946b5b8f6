// SPDX-License-Identifier: MIT
//
// The motions that constraints leave free: an orthonormal basis of them by reflections, which are
// applied in O(n c) for c constraints on n coordinates, without a matrix of the basis.
#pragma once

#include <vector>

#include "pipedyn/linear/spectrum.hpp"
#include "pipedyn/pipe.hpp"

namespace pipedyn {

/// An orthonormal basis Z of all vectors that are orthogonal to the given columns (n, c), which
/// have full rank; c < n.
class Complement {
 public:
  explicit Complement(Matrix columns);

  Index size() const { return size_; }
  Index dof() const { return size_ - static_cast<Index>(reflected_.size()); }

  /// Z z for coefficients z (dof, r).
  Matrix lifted(const Matrix& z) const;
  /// Z^T x for vectors x (n, r).
  Matrix projected(Matrix x) const {
    project(x);
    return x.bottomRows(dof());
  }
  /// The same in the last rows of x, without further memory.
  void project(Eigen::Ref<Matrix> x) const;

 private:
  Index size_;
  std::vector<Vector> reflected_;  // unit normal of the plane of each reflection
};

}  // namespace pipedyn
