// SPDX-License-Identifier: MIT
#include "pipedyn/linear/eigenpairs.hpp"

#include <algorithm>

namespace pipedyn {

namespace {

constexpr double eps = std::numeric_limits<double>::epsilon();
/// Error of a growth rate, in differences of those that its two vectors give. Measured on 228 high
/// modes of 120 Legendre functions, 200 beam functions and 200 segments, against roots to 19
/// digits: with this factor the error holds for 212. The others, where both vectors err by the
/// same, are off by up to 18 times as much, far less than lambda itself.
constexpr double vector_error = 3.0;

/// LAPACK's vectors, the first rows of each, made unit: of a conjugate pair real and imaginary
/// part.
ComplexTable complex_vectors(const std::vector<double>& vectors, const std::vector<double>& imag,
                             Index rows) {
  const Index size = static_cast<Index>(imag.size());
  ComplexTable result(rows * size);
  for (Index j = 0; j < size; ++j) {
    const double* const real = &vectors[(imag[j] < 0.0 ? j - 1 : j) * size];
    const double sign = imag[j] < 0.0 ? -1.0 : 1.0;
    double length = 0.0;
    for (Index i = 0; i < rows; ++i) {
      const Complex entry(real[i], imag[j] == 0.0 ? 0.0 : sign * real[size + i]);
      length += std::norm(entry);
      result[i * size + j] = entry;
    }
    for (Index i = 0; i < rows; ++i) result[i * size + j] /= std::sqrt(length);
  }
  return result;
}

}  // namespace

DenseOperator::DenseOperator(const Lapack& lapack, Matrix mass, Matrix velocity, Matrix stiffness,
                             double size)
    : Operator(mass.rows(), size),
      lapack_(lapack),
      mass_(std::move(mass)),
      velocity_(std::move(velocity)),
      stiffness_(std::move(stiffness)) {}

void DenseOperator::times(const Matrix& factor, const double* x, Index columns, double* out) const {
  // Row by row, as these are, they are their transposes column by column: out^T = x^T factor^T.
  int m = static_cast<int>(columns), n = static_cast<int>(dof);
  double one = 1.0, zero = 0.0;
  char plain = 'N';
  lapack_.dgemm(&plain, &plain, &m, &n, &n, &one, const_cast<double*>(x), &m,
                const_cast<double*>(factor.data()), &n, &zero, out, &m);
}

ComplexTable DenseOperator::multiply(const Complex* x, Index count) const {
  ComplexTable result(3 * dof * count);
  const Index columns = 2 * count;  // real and imaginary parts are columns of their own
  double* out = reinterpret_cast<double*>(result.data());
  for (const Matrix* const factor : {&mass_, &velocity_, &stiffness_}) {
    times(*factor, reinterpret_cast<const double*>(x), columns, out);
    out += dof * columns;
  }
  return result;
}

void DenseOperator::solve(Complex value, ComplexTable& x, ComplexTable& y) const {
  int n = static_cast<int>(dof), one = 1, info = 0;
  char plain = 'N', adjoint = 'C';
  ComplexTable lu(n * n);
  std::vector<int> pivots(n);
  for (Index j = 0; j < n; ++j) {
    for (Index i = 0; i < n; ++i) {
      lu[j * n + i] = value * (value * mass_(i, j) + velocity_(i, j)) + stiffness_(i, j);
    }
  }
  lapack_.zgetrf(&n, &n, lu.data(), &n, pivots.data(), &info);
  for (Index i = 0; i < n; ++i) {  // of a singular matrix, with one that differs in rounding
    if (lu[i * n + i] == 0.0) lu[i * n + i] = eps;
  }
  lapack_.zgetrs(&plain, &n, &one, lu.data(), &n, pivots.data(), x.data(), &n, &info);
  lapack_.zgetrs(&adjoint, &n, &one, lu.data(), &n, pivots.data(), y.data(), &n, &info);
}

std::vector<double> DenseOperator::hidden(const Pairs& pairs) const {
  const Index count = pairs.count;
  std::vector<double> result(count, 0.0);
  Matrix sizes(dof, count), rows(dof, count);
  for (Index k = 0; k < dof * count; ++k) sizes.data()[k] = std::abs(pairs.right[k]);
  int power = 2;
  for (const Matrix* const factor : {&mass_, &velocity_, &stiffness_}) {
    times(factor->cwiseAbs(), sizes.data(), count, rows.data());
    for (Index i = 0; i < count; ++i) {
      double sum = 0.0;
      for (Index k = 0; k < dof; ++k) sum += std::abs(pairs.left[k * count + i]) * rows(k, i);
      result[i] += std::pow(std::abs(pairs.values[i]), power) * sum;
    }
    --power;
  }
  return result;
}

Inverse DenseOperator::inverse(double shift, bool velocity_free, bool left, bool right) const {
  int n = static_cast<int>(dof), size = velocity_free ? n : 2 * n, info = 0;
  // As LAPACK has matrices, column by column.
  std::vector<double> shifted(n * n), step(size * size, 0.0);
  for (Index j = 0; j < n; ++j) {
    for (Index i = 0; i < n; ++i) {
      const double mass = mass_(i, j), velocity = velocity_(i, j);
      shifted[j * n + i] = shift * shift * mass + shift * velocity + stiffness_(i, j);
      step[j * size + i] = velocity_free ? -mass : -velocity - 2.0 * shift * mass;
      if (!velocity_free) step[(n + j) * size + i] = -mass;
    }
  }
  std::vector<int> pivots(n);
  lapack_.dgetrf(&n, &n, shifted.data(), &n, pivots.data(), &info);
  if (info != 0) return {};
  char plain = 'N', transposed = 'T', lefts = left ? 'V' : 'N', rights = right ? 'V' : 'N';
  lapack_.dgetrs(&plain, &n, &size, shifted.data(), &n, pivots.data(), step.data(), &size, &info);
  if (!velocity_free) {
    for (Index j = 0; j < n; ++j) step[j * size + n + j] = 1.0;
  }
  for (const double entry : step) {
    if (!std::isfinite(entry)) return {};
  }
  std::vector<double> real(size), imag(size), vl(left ? size * size : 1),
      vr(right ? size * size : 1), work(1);
  for (int length = -1;; length = static_cast<int>(work[0]), work.resize(length)) {
    lapack_.dgeev(&lefts, &rights, &size, step.data(), &size, real.data(), imag.data(), vl.data(),
                  &size, vr.data(), &size, work.data(), &length, &info);
    if (length >= 0) break;  // the first call asks for the best size of its workspace
  }
  if (info != 0) return {};
  Inverse result{std::vector<Complex>(size), {}, {}};
  if (right) result.right = complex_vectors(vr, imag, n);
  for (Index j = 0; j < size; ++j) result.mu[j] = {real[j], imag[j]};
  if (left) {
    lapack_.dgetrs(&transposed, &n, &size, shifted.data(), &n, pivots.data(), vl.data(), &size,
                   &info);
    result.left = complex_vectors(vl, imag, n);
  }
  return result;
}

Assessment assess(const Operator& p, const Pairs& pairs) {
  const Index count = pairs.count, table = p.dof * count, lefts = pairs.left == nullptr ? 0 : count;
  const ComplexTable products = p.multiply(pairs.right, count);
  const std::vector<double> hidden = lefts > 0 ? p.hidden(pairs) : std::vector<double>();
  const std::vector<double> reals(lefts);
  const std::vector<Complex> complexes(lefts);
  Assessment result{std::vector<double>(count), reals, complexes, complexes, complexes, complexes};
  for (Index i = 0; i < count; ++i) {
    const Complex value = pairs.values[i];
    double rest = 0.0, inertia = 0.0, resistance = 0.0, length = 0.0;
    Complex by_left = 0.0, by_right = 0.0, change = 0.0, error = 0.0;
    for (Index k = i; k < table; k += count) {
      const Complex x = pairs.right[k], mass = products[k], velocity = products[table + k];
      const Complex row = value * (value * mass + velocity) + products[2 * table + k];
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
                             : std::sqrt(rest) / (moving + p.size * std::sqrt(length));
    if (lefts == 0) continue;
    const double size = moving + p.size;
    const double lost = eps * (size + hidden[i]);
    const double uncertain =
        (result.residual[i] * size + lost) / std::abs(by_left) + eps * std::abs(value);
    result.uncertain[i] = std::isfinite(uncertain) ? uncertain : infinite;
    result.slope[i] = -change / by_left;
    result.correction[i] = -error / by_left;
    result.by_left[i] = by_left;
    result.by_right[i] = by_right;
  }
  return result;
}

Refined refine(const Operator& p, Refined guess, int most_steps) {
  Refined last = std::move(guess), best = last;
  last.residual = best.residual = infinite;
  const auto made_unit = [](ComplexTable& x) {
    double length = 0.0;
    for (const Complex entry : x) length += std::norm(entry);
    length = std::sqrt(length);
    for (Complex& entry : x) entry /= length;
    return std::isfinite(length) && length > 0.0;
  };
  for (last.steps = 1; last.steps <= most_steps; ++last.steps) {
    p.solve(last.value, last.right, last.left);
    if (!made_unit(last.right) || !made_unit(last.left)) break;
    const Pairs pair{1, &last.value, last.right.data(), last.left.data()};
    const Complex correction = assess(p, pair).correction[0];
    if (!std::isfinite(std::norm(correction))) break;
    last.value += correction;
    const double residual = assess(p, {1, &last.value, last.right.data()}).residual[0];
    if (!(residual < best.residual)) break;
    last.residual = residual;
    best = last;
    if (std::abs(correction) <= 4e-16 * std::abs(last.value)) break;
  }
  return std::isfinite(best.residual) ? best : last;
}

Growth growth(const Operator& p, const Pairs& pairs) {
  const Index count = pairs.count, table = p.dof * count;
  Growth result{std::vector<double>(count), std::vector<double>(count)};
  for (const Complex* const vectors : {pairs.right, pairs.left}) {
    const ComplexTable products = p.multiply(vectors, count);
    for (Index i = 0; i < count; ++i) {
      const double omega = pairs.values[i].imag();
      double kinetic = 0.0, size = 0.0;
      Complex velocity = 0.0, place = 0.0;
      for (Index k = i; k < table; k += count) {
        const Complex x = std::conj(vectors[k]);
        const Complex by_velocity = x * products[table + k], by_place = x * products[2 * table + k];
        kinetic += (x * products[k]).real();
        velocity += by_velocity;
        place += by_place;
        size += std::abs(omega) * std::abs(by_velocity) + std::abs(by_place);
      }
      const double balance = 2.0 * omega * kinetic + velocity.imag();
      const double rate = -(omega * velocity.real() + place.imag()) / balance;
      if (vectors == pairs.left) {
        result.error[i] += vector_error * std::abs(result.rate[i] - rate);
      } else {  // rounding of two sums of dof terms
        result.rate[i] = rate;
        result.error[i] = 2.0 * static_cast<double>(p.dof + 2) * eps * size / std::abs(balance);
      }
    }
  }
  return result;
}

}  // namespace pipedyn
