// SPDX-License-Identifier: MIT
//
// Products and triangular solves of matrices or their blocks, compiled once and not for each pair
// of expressions: they are most of what Eigen takes to compile.
#pragma once

#include <Eigen/Cholesky>

#include "pipedyn/pipe.hpp"

namespace pipedyn {

using Slab = Eigen::Ref<const Matrix, 0, Eigen::OuterStride<>>;
using WritableSlab = Eigen::Ref<Matrix, 0, Eigen::OuterStride<>>;

/// out = a b; out overlaps neither.
void multiply(Vector& out, const Slab& a, const Eigen::Ref<const Vector>& b);

/// out = a b, row-major, of a only the upper triangle; out overlaps neither.
void multiply_upper(double* out, const Matrix& a, const Matrix& b);

/// out += factor a^T b; out overlaps neither.
void add_inner(WritableSlab out, double factor, const Slab& a, const Slab& b);

/// a^T diag(weight) b: of functions at a rule's nodes, one a column, the integrals of products.
Matrix inner(const Slab& a, const Eigen::Ref<const Vector>& weight, const Slab& b);

using Cholesky = Eigen::LLT<Matrix>;

/// b = a^-1 b for a symmetric a; false where that is not positive. factors: workspace.
bool solve_positive(Cholesky& factors, const Matrix& a, Matrix& b);

/// a = upper^T upper with the inverse of upper; false where a is not positive.
bool factor_positive(const Matrix& a, Matrix& upper, Matrix& inverse);

}  // namespace pipedyn
