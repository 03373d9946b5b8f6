// SPDX-License-Identifier: MIT
#include "pipedyn/linear/eigenpairs.hpp"

namespace pipedyn {

namespace {

/// Error of a growth rate, in differences of those that its two vectors give. Measured on 228 high
/// modes of 120 Legendre functions, 200 beam functions and 200 segments, against roots to 19
/// digits: with this factor the error holds for 212. The others, where both vectors err by the
/// same, are off by up to 18 times as much, far less than lambda itself.
constexpr double vector_error = 3.0;

/// Most steps of a refinement: from a good guess two or three are taken.
constexpr int most_refinements = 6;

/// LAPACK's vectors, the first rows of each, made unit: of a conjugate pair real and imaginary
/// part.
ComplexTable complex_vectors(const Eigen::MatrixXd& vectors, const Reals& imag, Index rows) {
  ComplexTable result = ComplexTable::Zero(rows, imag.size());
  for (Index j = 0; j < imag.size(); ++j) {
    const Index first = imag[j] < 0.0 ? j - 1 : j;
    auto column = result.col(j);
    column.real() = vectors.col(first).head(rows);
    if (imag[j] > 0.0) column.imag() = vectors.col(j + 1).head(rows);
    if (imag[j] < 0.0) column.imag() = -vectors.col(j).head(rows);
    column /= column.norm();
  }
  return result;
}

bool make_unit(ComplexVector& x) {
  const double length = x.norm();
  x /= length;
  return std::isfinite(length) && length > 0.0;
}

}  // namespace

Pairs Pairs::take(const std::vector<Index>& which) const {
  const Index count = static_cast<Index>(which.size());
  const bool lefts = left.cols() > 0, residuals = residual.size() > 0;
  Pairs result{Values(count), ComplexTable(right.rows(), count),
               ComplexTable(right.rows(), lefts ? count : 0), Reals(residuals ? count : 0)};
  for (Index i = 0; i < count; ++i) {
    result.values[i] = values[which[i]];
    result.right.col(i) = right.col(which[i]);
    if (lefts) result.left.col(i) = left.col(which[i]);
    if (residuals) result.residual[i] = residual[which[i]];
  }
  return result;
}

DenseOperator::DenseOperator(const Lapack& lapack, Matrix mass, Matrix velocity, Matrix stiffness,
                             Matrix velocity_rate, Matrix stiffness_rate, double size)
    : Operator(mass.rows(), size),
      lapack_(lapack),
      mass_(std::move(mass)),
      velocity_(std::move(velocity)),
      stiffness_(std::move(stiffness)),
      velocity_rate_(std::move(velocity_rate)),
      stiffness_rate_(std::move(stiffness_rate)) {}

Eigen::MatrixXd DenseOperator::times(const Matrix& factor, const Eigen::MatrixXd& x) const {
  // The factor, row by row, is its transpose column by column.
  int n = static_cast<int>(dof), columns = static_cast<int>(x.cols());
  double one = 1.0, zero = 0.0;
  char plain = 'N', transposed = 'T';
  Eigen::MatrixXd result(dof, x.cols());
  lapack_.dgemm(&transposed, &plain, &n, &columns, &n, &one, const_cast<double*>(factor.data()), &n,
                const_cast<double*>(x.data()), &n, &zero, result.data(), &n);
  return result;
}

ComplexTable DenseOperator::times(const Matrix& factor, const ComplexTable& x) const {
  const Index count = x.cols();
  Eigen::MatrixXd parts(dof, 2 * count);
  parts.leftCols(count) = x.real();
  parts.rightCols(count) = x.imag();
  parts = times(factor, parts);
  ComplexTable result(dof, count);
  result.real() = parts.leftCols(count);
  result.imag() = parts.rightCols(count);
  return result;
}

Products DenseOperator::multiply(const ComplexTable& x) const {
  return {times(mass_, x), times(velocity_, x), times(stiffness_, x)};
}

ComplexTable DenseOperator::by_speed(const Values& values, const ComplexTable& x) const {
  ComplexTable result = times(velocity_rate_, x);
  for (Index i = 0; i < x.cols(); ++i) result.col(i) *= values[i];
  return result + times(stiffness_rate_, x);
}

Operator::Solver DenseOperator::factor(Complex value) const {
  int n = static_cast<int>(dof), info = 0;
  ComplexTable lu = (value * value) * mass_ + value * velocity_ + stiffness_.cast<Complex>();
  std::vector<int> pivots(n);
  lapack_.zgetrf(&n, &n, lu.data(), &n, pivots.data(), &info);
  for (Index i = 0; i < n; ++i) {  // of a singular matrix, with one that differs in rounding
    if (lu(i, i) == 0.0) lu(i, i) = eps;
  }
  return [zgetrs = lapack_.zgetrs, lu = std::move(lu), pivots = std::move(pivots)](
             ComplexVector& x, bool adjoint) mutable {
    int rows = static_cast<int>(x.size()), one = 1, status = 0;
    char kind = adjoint ? 'C' : 'N';
    zgetrs(&kind, &rows, &one, lu.data(), &rows, pivots.data(), x.data(), &rows, &status);
  };
}

Reals DenseOperator::hidden(const Pairs& pairs) const {
  const Reals size = pairs.values.abs();
  const Eigen::MatrixXd x = pairs.right.cwiseAbs(), y = pairs.left.cwiseAbs();
  const auto both = [&](const Matrix& factor) -> Reals {
    return y.cwiseProduct(times(factor.cwiseAbs(), x)).colwise().sum().transpose().array();
  };
  return size * (size * both(mass_) + both(velocity_)) + both(stiffness_);
}

Inverse DenseOperator::inverse(double shift, bool velocity_free, bool left, Index) const {
  int n = static_cast<int>(dof), size = velocity_free ? n : 2 * n, info = 0;
  Eigen::MatrixXd shifted = shift * shift * mass_ + shift * velocity_ + stiffness_;
  Eigen::MatrixXd step = Eigen::MatrixXd::Zero(size, size);
  if (velocity_free) {
    step = -mass_;
  } else {
    step.topLeftCorner(n, n) = -velocity_ - 2.0 * shift * mass_;
    step.topRightCorner(n, n) = -mass_;
  }
  std::vector<int> pivots(n);
  lapack_.dgetrf(&n, &n, shifted.data(), &n, pivots.data(), &info);
  if (info != 0) return {};
  char plain = 'N', transposed = 'T', wanted = left ? 'V' : 'N', always = 'V';
  lapack_.dgetrs(&plain, &n, &size, shifted.data(), &n, pivots.data(), step.data(), &size, &info);
  if (!velocity_free) step.bottomLeftCorner(n, n).setIdentity();
  if (!step.allFinite()) return {};
  Reals real(size), imag(size), work(1);
  Eigen::MatrixXd vl(size, left ? size : 0), vr(size, size);
  for (int length = -1;; length = static_cast<int>(work[0]), work.resize(length)) {
    lapack_.dgeev(&wanted, &always, &size, step.data(), &size, real.data(), imag.data(), vl.data(),
                  &size, vr.data(), &size, work.data(), &length, &info);
    if (length >= 0) break;  // the first call asks for the best size of its workspace
  }
  if (info != 0) return {};
  Inverse result{Values(size), complex_vectors(vr, imag, n), ComplexTable(n, 0)};
  result.mu.real() = real;
  result.mu.imag() = imag;
  if (left) {
    lapack_.dgetrs(&transposed, &n, &size, shifted.data(), &n, pivots.data(), vl.data(), &size,
                   &info);
    result.left = complex_vectors(vl, imag, n);
  }
  return result;
}

Assessment assess(const Operator& p, const Pairs& pairs, bool slopes) {
  const Index count = pairs.values.size(), lefts = pairs.left.cols();
  const Products products = p.multiply(pairs.right);
  const Reals hidden = lefts > 0 ? p.hidden(pairs) : Reals();
  ComplexTable by_speed;
  if (slopes) by_speed = p.by_speed(pairs.values, pairs.right);
  Assessment result{Reals(count),  Reals(lefts),  Values::Zero(lefts),
                    Values(lefts), Values(lefts), Values(lefts)};
  for (Index i = 0; i < count; ++i) {
    const Complex value = pairs.values[i];
    const auto x = pairs.right.col(i), mass = products.mass.col(i);
    const auto velocity = products.velocity.col(i);
    const ComplexVector row = value * (value * mass + velocity) + products.stiffness.col(i);
    const double moving = std::norm(value) * mass.norm() + std::abs(value) * velocity.norm();
    result.residual[i] =
        pairs.residual.size() > 0 ? pairs.residual[i] : row.norm() / (moving + p.size * x.norm());
    if (lefts == 0) continue;
    const auto y = pairs.left.col(i);
    const ComplexVector rate = 2.0 * value * mass + velocity;
    const Complex by_left = y.dot(rate);
    const double size = moving + p.size;
    const double lost = result.residual[i] * size + eps * (size + hidden[i]);
    const double uncertain = lost / std::abs(by_left) + eps * std::abs(value);
    result.uncertain[i] = std::isfinite(uncertain) ? uncertain : infinite;
    if (slopes) result.slope[i] = -y.dot(by_speed.col(i)) / by_left;
    result.correction[i] = -y.dot(row) / by_left;
    result.by_left[i] = by_left;
    result.by_right[i] = x.dot(rate);
  }
  return result;
}

Pair refine(const Operator& p, const Pair& guess, int& steps) {
  const ComplexVector seed = Eigen::VectorXd::LinSpaced(p.dof, 1.0, 0.5).cast<Complex>();
  Pair last = guess;
  last.left = seed;
  if (last.right.size() == 0) last.right = seed;
  last.residual = infinite;
  Pair best = last;
  for (int step = 0; step < most_refinements; ++step) {
    const Operator::Solver solve = p.factor(last.value);
    ++steps;
    solve(last.right, false);
    solve(last.left, true);
    if (!make_unit(last.right) || !make_unit(last.left)) break;
    Pairs pair{Values::Constant(1, last.value), last.right, last.left, {}};
    const Complex correction = assess(p, pair, false).correction[0];
    if (!std::isfinite(std::norm(correction))) break;
    last.value = pair.values[0] += correction;
    pair.left.resize(p.dof, 0);
    last.residual = assess(p, pair, false).residual[0];
    if (!(last.residual < best.residual)) break;
    best = last;
    if (std::abs(correction) <= 4e-16 * std::abs(last.value)) break;
  }
  if (std::isfinite(best.residual)) return best;
  last.residual = infinite;
  return last;
}

Growth growth(const Operator& p, const Pairs& pairs) {
  const Index count = pairs.values.size();
  Growth result{Reals(count), Reals(count)};
  for (const ComplexTable* const vectors : {&pairs.right, &pairs.left}) {
    const Products products = p.multiply(*vectors);
    for (Index i = 0; i < count; ++i) {
      const double omega = pairs.values[i].imag();
      const auto x = vectors->col(i).conjugate();
      const ComplexVector by_velocity = x.cwiseProduct(products.velocity.col(i));
      const ComplexVector by_place = x.cwiseProduct(products.stiffness.col(i));
      const double kinetic = x.cwiseProduct(products.mass.col(i)).sum().real();
      const Complex velocity = by_velocity.sum(), place = by_place.sum();
      const double balance = 2.0 * omega * kinetic + velocity.imag();
      const double rate = -(omega * velocity.real() + place.imag()) / balance;
      if (vectors == &pairs.left) {
        result.error[i] += vector_error * std::abs(result.rate[i] - rate);
      } else {  // rounding of two sums of dof terms
        const double size = std::abs(omega) * by_velocity.lpNorm<1>() + by_place.lpNorm<1>();
        result.rate[i] = rate;
        result.error[i] = 2.0 * static_cast<double>(p.dof + 2) * eps * size / std::abs(balance);
      }
    }
  }
  return result;
}

}  // namespace pipedyn
