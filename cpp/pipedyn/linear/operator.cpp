// SPDX-License-Identifier: MIT
#include "pipedyn/linear/operator.hpp"

#include <algorithm>
#include <cmath>
#include <type_traits>

namespace pipedyn {

namespace {

/// Writes unit complex vectors from the first rows of LAPACK's vectors, in which a conjugate pair
/// is given by its real and imaginary parts.
void write_unit(const Eigen::MatrixXd& vectors, const Reals& imag, ComplexTable& to) {
  const Index rows = to.rows();
  to.setZero();
  for (Index j = 0; j < to.cols(); ++j) {
    auto column = to.col(j);
    column.real() = vectors.col(imag[j] < 0.0 ? j - 1 : j).head(rows);
    if (imag[j] > 0.0) column.imag() = vectors.col(j + 1).head(rows);
    if (imag[j] < 0.0) column.imag() = -vectors.col(j).head(rows);
    column /= column.norm();
  }
}
void write_unit(const ComplexTable& vectors, const Reals&, ComplexTable& to) {
  for (Index j = 0; j < to.cols(); ++j) {
    const auto column = vectors.col(j).head(to.rows());
    to.col(j) = column / column.norm();
  }
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

Eigen::Ref<Eigen::MatrixXd> DenseOperator::times(const Eigen::Ref<const Matrix>& factor,
                                                 const Eigen::Ref<const Eigen::MatrixXd>& x,
                                                 Eigen::MatrixXd& product) const {
  // A factor stored by rows is its transpose stored by columns.
  int n = static_cast<int>(dof), rows = static_cast<int>(factor.rows()),
      columns = static_cast<int>(x.cols());
  double one = 1.0, zero = 0.0;
  char plain = 'N', transposed = 'T';
  auto result = room_in(product, rows, columns);
  lapack.dgemm(&transposed, &plain, &rows, &columns, &n, &one, const_cast<double*>(factor.data()),
               &n, const_cast<double*>(x.data()), &n, &zero, result.data(), &rows);
  return result;
}

DenseOperator DenseOperator::within(const Eigen::MatrixXd& basis, Index some) const {
  // Modes whose x^T M x is rounding are left out: there may be fewer than `some`.
  const auto first = basis.leftCols(std::min(some, basis.cols()));
  const Eigen::Map<const Matrix> transposed(first.data(), first.cols(), dof);
  Matrices of_basis;
  for (std::size_t k = 0; k < matrices_.size(); ++k) {
    if (matrices_[k].size() == 0) continue;
    of_basis[k] = times(transposed, times(matrices_[k], first, memory_.parts), memory_.product);
  }
  return {lapack, std::move(of_basis), size, lost};
}

void DenseOperator::read(const ColumnsRef& x) const {
  room_in(memory_.parts, dof, 2 * x.cols()) << x.real(), x.imag();
}

Columns DenseOperator::product(std::size_t matrix, Index count) const {
  const Matrix& factor = matrices_[matrix];
  ComplexTable& to = memory_.products[matrix];
  if (factor.size() == 0) return to;
  const auto parts = times(factor, memory_.parts.leftCols(2 * count), memory_.product);
  auto found = room_in(to, dof, count);
  found.real() = parts.leftCols(count);
  found.imag() = parts.rightCols(count);
  return found;
}

Products DenseOperator::multiply(const ColumnsRef& x) const {
  read(x);
  const Index count = x.cols();
  Products products{product(0, count), product(1, count), product(2, count)};
  if (is_hysteretic()) products.stiffness += Complex(0.0, 1.0) * product(5, count);
  return products;
}

Columns DenseOperator::by_speed(const ValuesRef& values, const ColumnsRef& x) const {
  read(x);
  Columns found = product(3, x.cols());
  found = found * values.matrix().asDiagonal() + product(4, x.cols());
  return found;
}

void DenseOperator::factor(Complex value) const {
  const auto& [mass, velocity, stiffness, velocity_rate, stiffness_rate, hysteretic] = matrices_;
  int n = static_cast<int>(dof), info = 0;
  ComplexTable& lu = memory_.lu;
  lu = value * value * mass + value * velocity + stiffness.cast<Complex>();
  if (is_hysteretic()) lu.imag() += hysteretic;
  memory_.pivots.resize(n);
  lapack.zgetrf(&n, &n, lu.data(), &n, memory_.pivots.data(), &info);
  for (Index i = 0; i < n; ++i) {  // makes a singular matrix regular by rounding
    if (lu(i, i) == 0.0) lu(i, i) = eps;
  }
}

void DenseOperator::solve(ComplexVector& x, bool adjoint) const {
  int rows = static_cast<int>(dof), columns = 1, status = 0;
  char kind = adjoint ? 'C' : 'N';
  lapack.zgetrs(&kind, &rows, &columns, memory_.lu.data(), &rows, memory_.pivots.data(), x.data(),
                &rows, &status);
}

const Reals& DenseOperator::hidden(const ValuesRef& values, const ColumnsRef& right,
                                   const ColumnsRef& left) const {
  const Index count = values.size();
  auto x = room_in(memory_.parts, dof, count), y = room_in(memory_.lengths, dof, count);
  x = right.cwiseAbs();
  y = left.cwiseAbs();
  Reals& result = memory_.hidden;
  result.setZero(count);
  for (const std::size_t k : {0, 1, 2, 5}) {
    if (matrices_[k].size() == 0) continue;
    memory_.sizes = matrices_[k].cwiseAbs();
    auto rows = times(memory_.sizes, x, memory_.product);
    rows = y.cwiseProduct(rows);
    if (k < 3) result *= values.abs();
    result += rows.colwise().sum().transpose().array();
  }
  return result;
}

void Pencil::operator()(double u, DenseOperator& to) const {
  const auto& [mass, velocity, damping, stiffness, flux, hysteretic] = matrices;
  const double thrust = end_coefficient * u * u;
  DenseOperator::Matrices& there =
      to.renewed(lapack, mass.rows(), size + thrust,
                 {u * lost[1] + lost[2], lost[3] + thrust * lost[4], entries_lost});
  there[0] = mass;
  there[1] = u * velocity + damping;
  there[2] = stiffness + thrust * flux;
  there[3] = velocity;
  there[4] = 2.0 * end_coefficient * u * flux;
  there[5] = hysteretic;
}

template <class Number>
bool DenseOperator::find_inverse(double shift, bool velocity_free, char left, char right) const {
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
  auto& [shifted, step, vl, vr, work] = std::get<Solver<Number>>(memory_.solvers);
  auto& [mu, unit_right, unit_left] = memory_.inverse;
  Reals &real = memory_.real, &imag = memory_.imag;
  shifted = (shift * shift * mass + shift * velocity + stiffness).template cast<Number>();
  if constexpr (!is_real) shifted.imag() = hysteretic;
  step.setZero(size, size);
  step.topRightCorner(n, n) = -mass.template cast<Number>();
  if (!velocity_free) {
    step.topLeftCorner(n, n) = (-velocity - 2.0 * shift * mass).template cast<Number>();
  }
  std::vector<int>& pivots = memory_.pivots;
  pivots.resize(n);
  getrf(&n, &n, shifted.data(), &n, pivots.data(), &info);
  if (info != 0) return false;
  char plain = 'N', adjoint = 'C';
  const bool lefts = left == 'V', rights = right == 'V';
  getrs(&plain, &n, &size, shifted.data(), &n, pivots.data(), step.data(), &size, &info);
  if (!velocity_free) step.bottomLeftCorner(n, n).setIdentity();
  if (!step.allFinite()) return false;
  mu.resize(size);
  for (Reals* const one : {&real, &imag}) one->resize(size);
  memory_.more.resize(2 * size);
  vl.resize(size, lefts ? size : 0);
  vr.resize(size, rights ? size : 0);
  for (int length = -1;; length = static_cast<int>(std::real(work[0]))) {
    const std::size_t wanted = length < 0 ? 1 : length;
    if (work.size() < wanted) work.resize(wanted);
    if constexpr (is_real) {
      lapack.dgeev(&left, &right, &size, step.data(), &size, real.data(), imag.data(), vl.data(),
                   &size, vr.data(), &size, work.data(), &length, &info);
    } else {
      lapack.zgeev(&left, &right, &size, step.data(), &size, mu.data(), vl.data(), &size, vr.data(),
                   &size, work.data(), &length, memory_.more.data(), &info);
    }
    if (length >= 0) break;  // the first call asks for the best size of the workspace
  }
  if (info != 0) return false;
  if (lefts) {
    getrs(&adjoint, &n, &size, shifted.data(), &n, pivots.data(), vl.data(), &size, &info);
  }
  if constexpr (is_real) {
    mu.real() = real;
    mu.imag() = imag;
  }
  unit_right.resize(n, vr.cols());
  unit_left.resize(n, vl.cols());
  write_unit(vr, imag, unit_right);
  write_unit(vl, imag, unit_left);
  return true;
}

const Inverse& DenseOperator::inverse(double shift, bool velocity_free, char left,
                                      char right) const {
  const bool found = is_hysteretic() ? find_inverse<Complex>(shift, velocity_free, left, right)
                                     : find_inverse<double>(shift, velocity_free, left, right);
  if (!found) memory_.inverse.values.resize(0);
  return memory_.inverse;
}

std::optional<Modes> DenseOperator::undamped_modes(bool vectors) const {
  // With K + s M, which is definite for a large s, high modes are not lost in the rounding of M.
  for (double shift = 0.0; shift <= 1e12; shift = shift == 0.0 ? 1.0 : 10.0 * shift) {
    const auto found = symmetric_pairs(lapack, mass(), stiffness() + shift * mass(), vectors, 1e-7);
    if (!found) continue;
    // These are x^T M x where x^T (K + s M) x = 1, the largest first. Modes for which rounding
    // makes it zero or negative are left out.
    const Index count = (found->values > 0.0).count();
    const Reals masses = found->values.tail(count).reverse();
    Modes modes{{}, masses.inverse() - shift, masses};
    if (vectors) modes.vectors = found->vectors.rightCols(count).rowwise().reverse();
    return modes;
  }
  return {};
}

}  // namespace pipedyn
