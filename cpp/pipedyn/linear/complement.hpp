// SPDX-License-Identifier: MIT
//
// What constraints leave free, without a matrix of it: an orthonormal basis by reflections, in
// O(n c) for c constraints on n coordinates.
#pragma once

#include "pipedyn/linear/spectrum.hpp"
#include "pipedyn/pipe.hpp"

namespace pipedyn {

/// An orthonormal basis Z of all that is orthogonal to columns (n, c) of full rank, c < n.
class Complement {
 public:
  explicit Complement(const Eigen::MatrixXd& columns);

  Index size() const { return packed_.rows(); }
  Index dof() const { return size() - packed_.cols(); }

  /// Z z, of z (dof, r).
  Matrix spread(const Matrix& z) const;
  /// Z^T x, of x (n, r).
  Matrix gathered(Matrix x) const;
  ComplexTable gathered(const ComplexTable& x) const;

 private:
  Eigen::MatrixXd packed_;  // the reflections' vectors below the diagonal
  Vector factors_;          // and their factors
};

}  // namespace pipedyn
