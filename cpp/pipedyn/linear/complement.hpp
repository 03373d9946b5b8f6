// SPDX-License-Identifier: MIT
//
// What constraints leave free, without a matrix of it: an orthonormal basis by reflections, in
// O(n c) for c constraints on n coordinates.
#pragma once

#include <vector>

#include "pipedyn/linear/spectrum.hpp"
#include "pipedyn/pipe.hpp"

namespace pipedyn {

/// An orthonormal basis Z of all that is orthogonal to columns (n, c) of full rank, c < n.
class Complement {
 public:
  explicit Complement(Matrix columns);

  Index size() const { return size_; }
  Index dof() const { return size_ - static_cast<Index>(reflected_.size()); }

  /// Z z, of z (dof, r).
  Matrix spread(const Matrix& z) const;
  /// Z^T x, of x (n, r).
  Matrix gathered(Matrix x) const;
  ComplexTable gathered(const ComplexTable& x) const;

 private:
  Index size_;
  std::vector<Vector> reflected_;  // the unit vector of each reflection
};

}  // namespace pipedyn
