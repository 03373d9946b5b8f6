// SPDX-License-Identifier: MIT
#include "pipedyn/linear/operator.hpp"

#include <algorithm>

namespace pipedyn {

namespace {

/// LAPACK's vectors, the first rows of each, made unit: of a conjugate pair real and imaginary
/// part.
ComplexTable complex_vectors(const Eigen::MatrixXd& vectors, const Reals& imag, Index rows) {
  ComplexTable result = ComplexTable::Zero(rows, imag.size());
  for (Index j = 0; j < imag.size(); ++j) {
    auto column = result.col(j);
    column.real() = vectors.col(imag[j] < 0.0 ? j - 1 : j).head(rows);
    if (imag[j] > 0.0) column.imag() = vectors.col(j + 1).head(rows);
    if (imag[j] < 0.0) column.imag() = -vectors.col(j).head(rows);
    column /= column.norm();
  }
  return result;
}

}  // namespace

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

ComplexTable DenseOperator::times(int matrix, const ComplexTable& x) const {
  Eigen::MatrixXd parts(dof, 2 * x.cols());
  parts << x.real(), x.imag();
  parts = times(matrices_[matrix], parts);
  ComplexTable result(dof, x.cols());
  result.real() = parts.leftCols(x.cols());
  result.imag() = parts.rightCols(x.cols());
  return result;
}

Products DenseOperator::multiply(const ComplexTable& x) const {
  return {times(0, x), times(1, x), times(2, x)};
}

ComplexTable DenseOperator::by_speed(const Values& values, const ComplexTable& x) const {
  return times(3, x) * values.matrix().asDiagonal() + times(4, x);
}

Solver DenseOperator::factor(Complex value) const {
  const auto& [mass, velocity, stiffness, velocity_rate, stiffness_rate] = matrices_;
  int n = static_cast<int>(dof), info = 0;
  ComplexTable lu = value * value * mass + value * velocity + stiffness.cast<Complex>();
  std::vector<int> pivots(n);
  lapack_.zgetrf(&n, &n, lu.data(), &n, pivots.data(), &info);
  for (Index i = 0; i < n; ++i) {  // of a singular matrix, with one that differs in rounding
    if (lu(i, i) == 0.0) lu(i, i) = eps;
  }
  return [zgetrs = lapack_.zgetrs, lu = std::move(lu), pivots = std::move(pivots)](
             ComplexTable x, bool adjoint) mutable {
    int rows = static_cast<int>(lu.rows()), columns = static_cast<int>(x.cols()), status = 0;
    char kind = adjoint ? 'C' : 'N';
    zgetrs(&kind, &rows, &columns, lu.data(), &rows, pivots.data(), x.data(), &rows, &status);
    return x;
  };
}

Reals DenseOperator::hidden(const Values& values, const ComplexTable& right,
                            const ComplexTable& left) const {
  const Eigen::MatrixXd x = right.cwiseAbs(), y = left.cwiseAbs();
  Reals result = Reals::Zero(values.size());
  for (int k = 0; k < 3; ++k) {
    const Eigen::MatrixXd rows = times(matrices_[k].cwiseAbs(), x);
    result = result * values.abs() + y.cwiseProduct(rows).colwise().sum().transpose().array();
  }
  return result;
}

Values DenseOperator::missed(const Pairs& of_fewer, const std::vector<Index>& shared) const {
  std::vector<Index> others;
  for (Index k = 0; k < dof; ++k) {
    if (std::find(shared.begin(), shared.end(), k) == shared.end()) others.push_back(k);
  }
  int more = static_cast<int>(others.size()), one = 1, info = 0;
  char plain = 'N';
  const Index fewer = static_cast<Index>(shared.size());
  // Rows of P_21, P_12^T and P_22, of M, C and K each.
  Matrix down[3], up[3], own[3];
  for (int part = 0; part < 3; ++part) {
    down[part].resize(more, fewer);
    up[part].resize(more, fewer);
    own[part].resize(more, more);
    for (int r = 0; r < more; ++r) {
      for (Index c = 0; c < fewer; ++c) {
        down[part](r, c) = matrices_[part](others[r], shared[c]);
        up[part](r, c) = matrices_[part](shared[c], others[r]);
      }
      for (int c = 0; c < more; ++c) own[part](r, c) = matrices_[part](others[r], others[c]);
    }
  }
  std::vector<int> pivots(more);
  ComplexTable block(more, more);
  ComplexVector beyond(more), onto(more);
  Values result(of_fewer.size());
  for (Index i = 0; i < result.size(); ++i) {
    const Complex value = of_fewer.values[i], square = value * value;
    if (i > 0 && value.imag() != 0.0 && value == std::conj(of_fewer.values[i - 1])) {
      result[i] = std::conj(result[i - 1]);
      continue;
    }
    const auto times = [&](const Matrix(&rows)[3], int r, const ComplexTable& x, double sign) {
      double sums[6] = {};
      for (int part = 0; part < 3; ++part) {
        for (Index c = 0; c < fewer; ++c) {
          sums[2 * part] += rows[part](r, c) * x(c, i).real();
          sums[2 * part + 1] += rows[part](r, c) * x(c, i).imag();
        }
      }
      return square * Complex(sums[0], sign * sums[1]) + value * Complex(sums[2], sign * sums[3]) +
             Complex(sums[4], sign * sums[5]);
    };
    for (int r = 0; r < more; ++r) {
      beyond[r] = times(down, r, of_fewer.right, 1.0);
      onto[r] = times(up, r, of_fewer.left, -1.0);
      for (int c = 0; c < more; ++c) {
        block(r, c) = square * own[0](r, c) + value * own[1](r, c) + own[2](r, c);
      }
    }
    lapack_.zgetrf(&more, &more, block.data(), &more, pivots.data(), &info);
    if (info == 0) {
      lapack_.zgetrs(&plain, &more, &one, block.data(), &more, pivots.data(), beyond.data(), &more,
                     &info);
    }
    Complex sum = info == 0 ? 0.0 : infinite;
    for (int r = 0; r < more; ++r) sum += onto[r] * beyond[r];
    result[i] = sum / of_fewer.by_left[i];
  }
  return result;
}

std::shared_ptr<DenseOperator> Pencil::operator()(double u) const {
  const auto& [mass, velocity, damping, stiffness, flux] = matrices;
  const double thrust = centrifugal * u * u;
  DenseOperator::Matrices there{mass, u * velocity + damping, stiffness + thrust * flux, velocity,
                                2.0 * centrifugal * u * flux};
  return std::make_shared<DenseOperator>(lapack, std::move(there), size + thrust);
}

Inverse DenseOperator::inverse(double shift, bool velocity_free, char left, char right) const {
  const auto& [mass, velocity, stiffness, velocity_rate, stiffness_rate] = matrices_;
  int n = static_cast<int>(dof), size = velocity_free ? n : 2 * n, info = 0;
  Eigen::MatrixXd shifted = shift * shift * mass + shift * velocity + stiffness;
  Eigen::MatrixXd step = Eigen::MatrixXd::Zero(size, size);
  step.topRightCorner(n, n) = -mass;
  if (!velocity_free) step.topLeftCorner(n, n) = -velocity - 2.0 * shift * mass;
  std::vector<int> pivots(n);
  lapack_.dgetrf(&n, &n, shifted.data(), &n, pivots.data(), &info);
  if (info != 0) return {};
  char plain = 'N', transposed = 'T';
  const bool lefts = left == 'V', rights = right == 'V';
  lapack_.dgetrs(&plain, &n, &size, shifted.data(), &n, pivots.data(), step.data(), &size, &info);
  if (!velocity_free) step.bottomLeftCorner(n, n).setIdentity();
  if (!step.allFinite()) return {};
  Reals real(size), imag(size), work(1);
  Eigen::MatrixXd vl(size, lefts ? size : 0), vr(size, rights ? size : 0);
  for (int length = -1;; length = static_cast<int>(work[0]), work.resize(length)) {
    lapack_.dgeev(&left, &right, &size, step.data(), &size, real.data(), imag.data(), vl.data(),
                  &size, vr.data(), &size, work.data(), &length, &info);
    if (length >= 0) break;  // the first call asks for the best size of its workspace
  }
  if (info != 0) return {};
  Values mu(size);
  mu.real() = real;
  mu.imag() = imag;
  if (lefts) {
    lapack_.dgetrs(&transposed, &n, &size, shifted.data(), &n, pivots.data(), vl.data(), &size,
                   &info);
  }
  return {mu, rights ? complex_vectors(vr, imag, n) : ComplexTable(n, 0),
          lefts ? complex_vectors(vl, imag, n) : ComplexTable(n, 0)};
}

}  // namespace pipedyn
