// SPDX-License-Identifier: MIT
#include "pipedyn/linear/operator.hpp"

#include <algorithm>
#include <cmath>
#include <type_traits>

namespace pipedyn {

namespace {

/// Unit complex vectors from the first rows of LAPACK's vectors, in which a conjugate pair is given
/// by its real and imaginary parts.
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

std::optional<SymmetricPairs> symmetric_pairs(const Lapack& lapack, Eigen::MatrixXd a,
                                              Eigen::MatrixXd b, bool vectors, double least_pivot) {
  int n = static_cast<int>(a.rows()), kind = 1, info = 0;
  int size = vectors ? 1 + 6 * n + 2 * n * n : 1 + 2 * n, integers = vectors ? 3 + 5 * n : 1;
  char asked = vectors ? 'V' : 'N', lower = 'L';
  Reals values(n), work(size);
  std::vector<int> whole(integers);
  lapack.dsygvd(&kind, &asked, &lower, &n, a.data(), &n, b.data(), &n, values.data(), work.data(),
                &size, whole.data(), &integers, &info);
  const auto pivots = b.diagonal();
  if (info != 0 || !(pivots.minCoeff() > least_pivot * pivots.maxCoeff())) return {};
  return SymmetricPairs{std::move(values), std::move(a)};
}

Values general_values(const Lapack& lapack, Eigen::MatrixXd a, Eigen::MatrixXd b) {
  int n = static_cast<int>(a.rows()), size = std::max(8 * n, 1), one = 1, info = 0;
  char none = 'N';
  Reals real(n), imag(n), below(n), work(size);
  lapack.dggev(&none, &none, &n, a.data(), &n, b.data(), &n, real.data(), imag.data(), below.data(),
               nullptr, &one, nullptr, &one, work.data(), &size, &info);
  if (info != 0) below.setConstant(std::nan(""));
  Values values(n);
  for (Index i = 0; i < n; ++i) values[i] = {real[i] / below[i], imag[i] / below[i]};
  return values;
}

int negative_eigenvalues(const Lapack& lapack, const Eigen::MatrixXd& of) {
  const Eigen::MatrixXd one = Eigen::MatrixXd::Identity(of.rows(), of.cols());
  const std::optional<SymmetricPairs> found = symmetric_pairs(lapack, of, one, false, 0.0);
  if (!found) throw NotConverged("eigenvalues of the stiffness at rest are not found");
  return static_cast<int>(
      (found->values < -1e-12 * (1.0 + found->values.abs().maxCoeff())).count());
}

Eigen::MatrixXd DenseOperator::times(const Eigen::Ref<const Matrix>& factor,
                                     const Eigen::MatrixXd& x) const {
  // A factor stored by rows is its transpose stored by columns.
  int n = static_cast<int>(dof), rows = static_cast<int>(factor.rows()),
      columns = static_cast<int>(x.cols());
  double one = 1.0, zero = 0.0;
  char plain = 'N', transposed = 'T';
  Eigen::MatrixXd result(rows, columns);
  lapack.dgemm(&transposed, &plain, &rows, &columns, &n, &one, const_cast<double*>(factor.data()),
               &n, const_cast<double*>(x.data()), &n, &zero, result.data(), &rows);
  return result;
}

DenseOperator DenseOperator::within(const Eigen::MatrixXd& basis, Index some) const {
  // Modes whose x^T M x is rounding are left out: there may be fewer than `some`.
  const Eigen::MatrixXd first = basis.leftCols(std::min(some, basis.cols()));
  const Eigen::Map<const Matrix> transposed(first.data(), first.cols(), dof);
  Matrices of_basis;
  for (std::size_t k = 0; k < matrices_.size(); ++k) {
    if (matrices_[k].size() > 0) of_basis[k] = times(transposed, times(matrices_[k], first));
  }
  return {lapack, std::move(of_basis), size, lost};
}

ComplexTable DenseOperator::times(int matrix, const ComplexTable& x) const {
  return mapped([&](const Eigen::MatrixXd& parts) { return times(matrices_[matrix], parts); }, x);
}

Products DenseOperator::multiply(const ComplexTable& x) const {
  Products products{times(0, x), times(1, x), times(2, x)};
  if (is_hysteretic()) std::get<2>(products) += Complex(0.0, 1.0) * times(5, x);
  return products;
}

ComplexTable DenseOperator::by_speed(const Values& values, const ComplexTable& x) const {
  return times(3, x) * values.matrix().asDiagonal() + times(4, x);
}

Solver DenseOperator::factor(Complex value) const {
  const auto& [mass, velocity, stiffness, velocity_rate, stiffness_rate, hysteretic] = matrices_;
  int n = static_cast<int>(dof), info = 0;
  ComplexTable lu = value * value * mass + value * velocity + stiffness.cast<Complex>();
  if (is_hysteretic()) lu.imag() += hysteretic;
  std::vector<int> pivots(n);
  lapack.zgetrf(&n, &n, lu.data(), &n, pivots.data(), &info);
  for (Index i = 0; i < n; ++i) {  // makes a singular matrix regular by rounding
    if (lu(i, i) == 0.0) lu(i, i) = eps;
  }
  return [zgetrs = lapack.zgetrs, lu = std::move(lu), pivots = std::move(pivots)](
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
  if (is_hysteretic()) {
    const Eigen::MatrixXd rows = times(matrices_[5].cwiseAbs(), x);
    result += y.cwiseProduct(rows).colwise().sum().transpose().array();
  }
  return result;
}

std::shared_ptr<DenseOperator> Pencil::operator()(double u) const {
  const auto& [mass, velocity, damping, stiffness, flux, hysteretic] = matrices;
  const double thrust = end_coefficient * u * u;
  DenseOperator::Matrices there{
      mass,     u * velocity + damping,           stiffness + thrust * flux,
      velocity, 2.0 * end_coefficient * u * flux, hysteretic};
  const DenseOperator::Lost by_rounding{u * lost[1] + lost[2], lost[3] + thrust * lost[4],
                                        entries_lost};
  return std::make_shared<DenseOperator>(lapack, std::move(there), size + thrust, by_rounding);
}

template <class Number>
Inverse DenseOperator::inverse_of(double shift, bool velocity_free, char left, char right) const {
  using Table = Eigen::Matrix<Number, Eigen::Dynamic, Eigen::Dynamic>;
  constexpr bool is_real = std::is_same_v<Number, double>;
  const auto& [mass, velocity, stiffness, velocity_rate, stiffness_rate, hysteretic] = matrices_;
  const auto choose = [](auto of_reals, auto of_complexes) {
    if constexpr (is_real) {
      return of_reals;
    } else {
      return of_complexes;
    }
  };
  const auto getrf = choose(lapack.dgetrf, lapack.zgetrf);
  const auto getrs = choose(lapack.dgetrs, lapack.zgetrs);
  int n = static_cast<int>(dof), size = velocity_free ? n : 2 * n, info = 0;
  Table shifted = (shift * shift * mass + shift * velocity + stiffness).cast<Number>();
  if constexpr (!is_real) shifted.imag() = hysteretic;
  Table step = Table::Zero(size, size);
  step.topRightCorner(n, n) = -mass.cast<Number>();
  if (!velocity_free) {
    step.topLeftCorner(n, n) = (-velocity - 2.0 * shift * mass).cast<Number>();
  }
  std::vector<int> pivots(n);
  getrf(&n, &n, shifted.data(), &n, pivots.data(), &info);
  if (info != 0) return {};
  char plain = 'N', adjoint = 'C';
  const bool lefts = left == 'V', rights = right == 'V';
  getrs(&plain, &n, &size, shifted.data(), &n, pivots.data(), step.data(), &size, &info);
  if (!velocity_free) step.bottomLeftCorner(n, n).setIdentity();
  if (!step.allFinite()) return {};
  Values mu(size);
  Reals real(size), imag(size), more(2 * size);
  std::vector<Number> work(1);
  Table vl(size, lefts ? size : 0), vr(size, rights ? size : 0);
  for (int length = -1;; length = static_cast<int>(std::real(work[0])), work.resize(length)) {
    if constexpr (is_real) {
      lapack.dgeev(&left, &right, &size, step.data(), &size, real.data(), imag.data(), vl.data(),
                   &size, vr.data(), &size, work.data(), &length, &info);
    } else {
      lapack.zgeev(&left, &right, &size, step.data(), &size, mu.data(), vl.data(), &size, vr.data(),
                   &size, work.data(), &length, more.data(), &info);
    }
    if (length >= 0) break;  // the first call asks for the best size of the workspace
  }
  if (info != 0) return {};
  if (lefts) {
    getrs(&adjoint, &n, &size, shifted.data(), &n, pivots.data(), vl.data(), &size, &info);
  }
  const auto unit = [&](const Table& vectors) -> ComplexTable {
    if constexpr (is_real) {
      return complex_vectors(vectors, imag, n);
    } else {
      return vectors.topRows(n).colwise().normalized();
    }
  };
  if constexpr (is_real) {
    mu.real() = real;
    mu.imag() = imag;
  }
  return {mu, rights ? unit(vr) : ComplexTable(n, 0), lefts ? unit(vl) : ComplexTable(n, 0)};
}

Inverse DenseOperator::inverse(double shift, bool velocity_free, char left, char right) const {
  return is_hysteretic() ? inverse_of<Complex>(shift, velocity_free, left, right)
                         : inverse_of<double>(shift, velocity_free, left, right);
}

std::optional<Modes> DenseOperator::undamped_modes() const {
  // With K + s M, which is definite for a large s, high modes are not lost in the rounding of M.
  for (double shift = 0.0; shift <= 1e12; shift = shift == 0.0 ? 1.0 : 10.0 * shift) {
    const auto found = symmetric_pairs(lapack, mass(), stiffness() + shift * mass(), true, 1e-7);
    if (!found) continue;
    // These are x^T M x where x^T (K + s M) x = 1, the largest first. Modes for which rounding
    // makes it zero or negative are left out.
    const Index count = (found->values > 0.0).count();
    const Reals masses = found->values.tail(count).reverse();
    return Modes{found->vectors.rightCols(count).rowwise().reverse(), masses.inverse() - shift,
                 masses};
  }
  return {};
}

}  // namespace pipedyn
