// SPDX-License-Identifier: MIT
//
// What constraints leave free, without a matrix of it: an orthonormal basis by reflections, in
// O(n c) for c constraints on n coordinates.
#pragma once

#include <Eigen/QR>

#include "pipedyn/linear/spectrum.hpp"
#include "pipedyn/pipe.hpp"

namespace pipedyn {

/// An orthonormal basis Z of all that is orthogonal to columns (n, c) of full rank, c < n.
class Complement {
 public:
  explicit Complement(const Eigen::MatrixXd& columns)
      : size_(columns.rows()), held_(columns.cols()) {
    if (held_ > 0) reflections_.compute(columns);
  }

  Index size() const { return size_; }
  Index dof() const { return size_ - held_; }

  /// Z z, of z (dof, r).
  Matrix spread(const Matrix& z) const {
    if (held_ == 0) return z;
    Matrix x = Matrix::Zero(size_, z.cols());
    x.bottomRows(dof()) = z;
    x.applyOnTheLeft(reflections_.householderQ());
    return x;
  }
  /// Z^T x, of x (n, r).
  Matrix gathered(Matrix x) const {
    if (held_ == 0) return x;
    x.applyOnTheLeft(reflections_.householderQ().transpose());
    return x.bottomRows(dof());
  }
  ComplexTable gathered(const ComplexTable& x) const {
    if (held_ == 0) return x;
    ComplexTable z(dof(), x.cols());
    z.real() = gathered(Matrix(x.real()));
    z.imag() = gathered(Matrix(x.imag()));
    return z;
  }

 private:
  Index size_, held_;
  Eigen::HouseholderQR<Eigen::MatrixXd> reflections_;
};

}  // namespace pipedyn
