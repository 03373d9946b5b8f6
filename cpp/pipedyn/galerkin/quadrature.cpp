// SPDX-License-Identifier: MIT
#include "pipedyn/galerkin/quadrature.hpp"

#include <algorithm>
#include <numbers>
#include <stdexcept>

namespace pipedyn {

void add_inner(WritableSlab out, double factor, const Slab& a, const Slab& b) {
  out.noalias() += factor * a.transpose() * b;
}

Matrix inner(const Slab& a, const Eigen::Ref<const Vector>& weight, const Slab& b) {
  const Matrix weighted = weight.asDiagonal() * b;
  Matrix out = Matrix::Zero(a.cols(), b.cols());
  add_inner(out, 1.0, a, weighted);
  return out;
}

Quadrature::Quadrature(Index count) {
  if (count < 1) throw std::invalid_argument("a quadrature must have at least one node");
  node.resize(count);
  weight.resize(count);
  expansion.resize(count, count);
  const double degree = static_cast<double>(count);
  Vector values(count + 1);  // P_k(x)
  for (Index i = 0; 2 * i < count; ++i) {
    // Newton's method finds the zeros of P_count from the classical guesses, in descending order.
    double x = std::cos(std::numbers::pi * (static_cast<double>(i) + 0.75) / (degree + 0.5));
    double slope = 1.0, change = 1.0;
    for (int step = 0; step < 6 && std::abs(change) > 1e-15; ++step) {
      legendre_values(x, count + 1, values.data());
      slope = degree * (values[count - 1] - x * values[count]) / ((1.0 - x) * (1.0 + x));
      change = values[count] / slope;
      x -= change;
    }
    const Index p = count - 1 - i;  // node i is the mirror image of node p
    node[i] = 0.5 * (1.0 - x);
    node[p] = 0.5 * (1.0 + x);
    weight[i] = weight[p] = 1.0 / ((1.0 - x) * (1.0 + x) * slope * slope);
    legendre_values(x, count, values.data());
    for (Index k = 0; k < count; ++k) {
      const double value = (2.0 * static_cast<double>(k) + 1.0) * weight[p] * values[k];
      expansion(k, i) = k % 2 == 0 ? value : -value;
      expansion(k, p) = value;
    }
  }
  // Near the ends, rounded nodes have weights that err by 1e-13 of them, but constants must remain.
  expansion /= weight.sum();
  weight /= weight.sum();
}

Matrix Quadrature::integral_to(const Vector& s) const {
  return legendre_integrals(legendre_values(s, size() + 1), s) * expansion;
}

void legendre_values(double x, Index count, double* out) {
  for (Index k = 0; k < std::min<Index>(count, 2); ++k) out[k] = k == 0 ? 1.0 : x;
  for (Index k = 2; k < count; ++k) {  // no division waits for the polynomial before
    const double less = 1.0 - 1.0 / static_cast<double>(k), next = x * out[k - 1];
    out[k] = next + less * (next - out[k - 2]);
  }
}

Matrix legendre_values(const Vector& s, Index count) {
  Matrix out(s.size(), count);
  for (Index p = 0; p < s.size(); ++p) {
    legendre_values(2.0 * s[p] - 1.0, count, out.data() + p * count);
  }
  return out;
}

Matrix legendre_integrals(const Matrix& values, const Vector& first) {
  Matrix out(values.rows(), values.cols() - 1);
  out.col(0) = first;
  for (Index k = 1; k < out.cols(); ++k) {
    out.col(k) =
        (values.col(k + 1) - values.col(k - 1)) / (2.0 * (2.0 * static_cast<double>(k) + 1.0));
  }
  return out;
}

}  // namespace pipedyn
