// SPDX-License-Identifier: MIT
#include "pipedyn/linear/eigenpairs.hpp"

#include <algorithm>
#include <limits>

#include "pipedyn/products.hpp"

namespace pipedyn {

namespace {

constexpr double eps = std::numeric_limits<double>::epsilon();
constexpr double infinite = std::numeric_limits<double>::infinity();

/// LAPACK's vectors, the first rows of each: of a conjugate pair real and imaginary part.
ComplexTable complex_vectors(const std::vector<double>& vectors, const std::vector<double>& imag,
                             Index rows) {
  const Index size = static_cast<Index>(imag.size());
  ComplexTable result(rows * size);
  for (Index j = 0; j < size; ++j) {
    const double* const real = &vectors[(imag[j] < 0.0 ? j - 1 : j) * size];
    for (Index i = 0; i < rows; ++i) {
      const double part = imag[j] == 0.0 ? 0.0 : real[size + i];
      result[i * size + j] = {real[i], imag[j] < 0.0 ? -part : part};
    }
  }
  return result;
}

}  // namespace

Inverse inverse(const Lapack& lapack, const Quadratic& p, double shift, bool velocity_free,
                bool left) {
  int n = static_cast<int>(p.mass.rows()), size = velocity_free ? n : 2 * n, info = 0;
  // As LAPACK has matrices, column by column.
  std::vector<double> shifted(n * n), step(size * size, 0.0);
  for (Index j = 0; j < n; ++j) {
    for (Index i = 0; i < n; ++i) {
      const double mass = p.mass(i, j), velocity = p.velocity(i, j);
      shifted[j * n + i] = shift * shift * mass + shift * velocity + p.stiffness(i, j);
      step[j * size + i] = velocity_free ? -mass : -velocity - 2.0 * shift * mass;
      if (!velocity_free) step[(n + j) * size + i] = -mass;
    }
  }
  std::vector<int> pivots(n);
  lapack.dgetrf(&n, &n, shifted.data(), &n, pivots.data(), &info);
  if (info != 0) return {};
  char plain = 'N', transposed = 'T', wanted = left ? 'V' : 'N', always = 'V';
  lapack.dgetrs(&plain, &n, &size, shifted.data(), &n, pivots.data(), step.data(), &size, &info);
  if (!velocity_free) {
    for (Index j = 0; j < n; ++j) step[j * size + n + j] = 1.0;
  }
  for (const double entry : step) {
    if (!std::isfinite(entry)) return {};
  }
  std::vector<double> real(size), imag(size), vl(left ? size * size : 1), vr(size * size), work(1);
  for (int length = -1;; length = static_cast<int>(work[0]), work.resize(length)) {
    lapack.dgeev(&wanted, &always, &size, step.data(), &size, real.data(), imag.data(), vl.data(),
                 &size, vr.data(), &size, work.data(), &length, &info);
    if (length >= 0) break;  // the first call asks for the best size of its workspace
  }
  if (info != 0) return {};
  Inverse result{std::vector<Complex>(size), complex_vectors(vr, imag, n), {}};
  for (Index j = 0; j < size; ++j) result.mu[j] = {real[j], imag[j]};
  if (left) {
    lapack.dgetrs(&transposed, &n, &size, shifted.data(), &n, pivots.data(), vl.data(), &size,
                  &info);
    result.left = complex_vectors(vl, imag, n);
  }
  return result;
}

Assessment assess(const Pairs& pairs, const Quadratic& p) {
  const Index dof = pairs.dof, count = pairs.count, table = dof * count;
  ComplexTable products(3 * table);
  std::vector<double> formed(count, 0.0);
  Matrix sizes(dof, count), rows(dof, count);
  for (Index k = 0; k < table; ++k) sizes.data()[k] = std::abs(pairs.right[k]);
  const auto* const parts = reinterpret_cast<const double*>(pairs.right);
  const Eigen::Map<const Matrix> x(parts, dof, 2 * count);  // real and imaginary parts
  Complex* out = products.data();
  int power = 2;
  for (const auto* const factor : {&p.mass, &p.velocity, &p.stiffness}) {
    multiply(Eigen::Map<Matrix>(reinterpret_cast<double*>(out), dof, 2 * count), *factor, x);
    out += table;
    if (pairs.left == nullptr) continue;
    // |y|^T (|lambda^2 M| + |lambda C| + |K|) |x|: no residual shows rounding of entries.
    multiply(rows, Matrix(factor->cwiseAbs()), sizes);
    for (Index i = 0; i < count; ++i) {
      double sum = 0.0;
      for (Index k = 0; k < dof; ++k) sum += std::abs(pairs.left[k * count + i]) * rows(k, i);
      formed[i] += std::pow(std::abs(pairs.values[i]), power) * sum;
    }
    --power;
  }
  const Complex* const mass = products.data();
  return assess(pairs, {mass, mass + table, mass + 2 * table, formed.data()});
}

Assessment assess(const Pairs& pairs, const Products& products) {
  const Index count = pairs.count, lefts = pairs.left == nullptr ? 0 : count;
  const std::vector<double> reals(lefts);
  const std::vector<Complex> complexes(lefts);
  Assessment result{std::vector<double>(count), reals, complexes, complexes, complexes, complexes};
  for (Index i = 0; i < count; ++i) {
    const Complex value = pairs.values[i];
    double rest = 0.0, inertia = 0.0, resistance = 0.0, length = 0.0;
    Complex by_left = 0.0, by_right = 0.0, change = 0.0, error = 0.0;
    for (Index k = i; k < pairs.dof * count; k += count) {
      const Complex x = pairs.right[k], mass = products.mass[k], velocity = products.velocity[k];
      const Complex row = value * (value * mass + velocity) + products.stiffness[k];
      rest += std::norm(row);
      inertia += std::norm(mass);
      resistance += std::norm(velocity);
      length += std::norm(x);
      if (lefts == 0) continue;
      const Complex dual = std::conj(pairs.left[k]), rate = 2.0 * value * mass + velocity;
      by_left += dual * rate;
      by_right += std::conj(x) * rate;
      error += dual * row;
      if (pairs.by_speed != nullptr) change += dual * pairs.by_speed[k];
    }
    const double moving =
        std::norm(value) * std::sqrt(inertia) + std::abs(value) * std::sqrt(resistance);
    result.residual[i] = pairs.residual != nullptr
                             ? pairs.residual[i]
                             : std::sqrt(rest) / (moving + pairs.size * std::sqrt(length));
    if (lefts == 0) continue;
    const double size = moving + pairs.size;
    const double lost = eps * (size + (products.formed == nullptr ? 0.0 : products.formed[i]));
    const double uncertain = (result.residual[i] * size + lost) / std::abs(by_left);
    result.uncertain[i] = std::isfinite(uncertain) ? uncertain : infinite;
    result.slope[i] = -change / by_left;
    result.correction[i] = -error / by_left;
    result.by_left[i] = by_left;
    result.by_right[i] = by_right;
  }
  return result;
}

}  // namespace pipedyn
