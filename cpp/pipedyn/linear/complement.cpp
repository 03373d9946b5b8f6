// SPDX-License-Identifier: MIT
#include "pipedyn/linear/complement.hpp"

#include <algorithm>
#include <cmath>

namespace pipedyn {

namespace {

/// Number of columns that are reflected at a time, without memory from the heap.
constexpr int together = 16;

/// Applies the Householder reflection 1 - 2 v v^T to x; v, of length 1, is 0 before row `first`.
void reflect(const Vector& v, Index first, Eigen::Ref<Matrix> x) {
  Eigen::Matrix<double, 1, Eigen::Dynamic, Eigen::RowMajor, 1, together> along;
  for (Index j = 0; j < x.cols(); j += together) {
    auto some = x.middleCols(j, std::min<Index>(together, x.cols() - j));
    along.setZero(some.cols());
    for (Index i = first; i < v.size(); ++i) along += (2.0 * v[i]) * some.row(i);
    for (Index i = first; i < v.size(); ++i) some.row(i) -= v[i] * along;
  }
}

}  // namespace

Complement::Complement(Matrix columns) : size_(columns.rows()), reflected_(columns.cols()) {
  // Each reflection maps its column, without the entries before j, onto axis j.
  for (Index j = 0; j < columns.cols(); ++j) {
    Vector& v = reflected_[j] = columns.col(j);
    v.head(j).setZero();
    v[j] += std::copysign(v.norm(), v[j]);
    v.normalize();
    reflect(v, j, columns);
  }
}

Matrix Complement::lifted(const Matrix& z) const {
  Matrix x = Matrix::Zero(size_, z.cols());
  x.bottomRows(dof()) = z;
  for (Index j = size_ - dof() - 1; j >= 0; --j) reflect(reflected_[j], j, x);
  return x;
}

void Complement::project(Eigen::Ref<Matrix> x) const {
  for (Index j = 0; j < size_ - dof(); ++j) reflect(reflected_[j], j, x);
}

}  // namespace pipedyn
