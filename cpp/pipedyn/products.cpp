// SPDX-License-Identifier: MIT
#include "pipedyn/products.hpp"

namespace pipedyn {

void multiply(Vector& out, const Slab& a, const Eigen::Ref<const Vector>& b) {
  out.noalias() = a * b;
}

void multiply_upper(double* out, const Matrix& a, const Matrix& b) {
  const Index columns = b.cols();
  for (Index i = 0; i < a.rows(); ++i, out += columns) {
    for (Index k = 0; k < columns; ++k) out[k] = 0.0;
    for (Index j = i; j < a.cols(); ++j) {
      const double factor = a(i, j);
      const double* const row = b.data() + j * columns;
      for (Index k = 0; k < columns; ++k) out[k] += factor * row[k];
    }
  }
}

void add_inner(WritableSlab out, double factor, const Slab& a, const Slab& b) {
  out.noalias() += factor * a.transpose() * b;
}

Matrix inner(const Slab& a, const Eigen::Ref<const Vector>& weight, const Slab& b) {
  const Matrix weighted = weight.asDiagonal() * b;
  Matrix out = Matrix::Zero(a.cols(), b.cols());
  add_inner(out, 1.0, a, weighted);
  return out;
}

bool solve_positive(Cholesky& factors, const Matrix& a, Matrix& b) {
  factors.compute(a);
  factors.solveInPlace(b);
  return factors.info() == Eigen::Success;
}

bool factor_positive(const Matrix& a, Matrix& upper, Matrix& inverse) {
  const Cholesky factors(a);
  upper = factors.matrixU();
  inverse.setIdentity(a.rows(), a.cols());
  factors.matrixU().solveInPlace(inverse);
  return factors.info() == Eigen::Success;
}

}  // namespace pipedyn
