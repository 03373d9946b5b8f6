// SPDX-License-Identifier: MIT
//
// Products of two matrices or their blocks, compiled once and not for each pair of expressions.
#pragma once

#include "pipedyn/pipe.hpp"

namespace pipedyn {

using Slab = Eigen::Ref<const Matrix, 0, Eigen::OuterStride<>>;
using WritableSlab = Eigen::Ref<Matrix, 0, Eigen::OuterStride<>>;

/// out += factor a^T b; out overlaps neither.
void add_inner(WritableSlab out, double factor, const Slab& a, const Slab& b);

/// a^T diag(weight) b: of functions at a rule's nodes, one a column, the integrals of products.
Matrix inner(const Slab& a, const Vector& weight, const Slab& b);

}  // namespace pipedyn
