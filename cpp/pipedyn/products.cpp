// SPDX-License-Identifier: MIT
#include "pipedyn/products.hpp"

namespace pipedyn {

void add_inner(WritableSlab out, double factor, const Slab& a, const Slab& b) {
  out.noalias() += factor * a.transpose() * b;
}

Matrix inner(const Slab& a, const Vector& weight, const Slab& b) {
  const Matrix weighted = weight.asDiagonal() * b;
  Matrix out = Matrix::Zero(a.cols(), b.cols());
  add_inner(out, 1.0, a, weighted);
  return out;
}

}  // namespace pipedyn
