// SPDX-License-Identifier: MIT
#include "pipedyn/motion/collocation.hpp"

#include <algorithm>
#include <cmath>

// Products are lazy where matrices are small: Eigen then compiles no blocked product for them.
namespace pipedyn {

void states_at(const Polynomials& orbit, const Vector& phases, Eigen::Map<Matrix> out) {
  const Index s = orbit.single.cols(), half = orbit.rates.cols(), count = orbit.starts.rows();
  const double *const edges = orbit.edges.data(), span = edges[count];
  Vector legendre = Vector::Ones(s + 2);
  for (Index k = 0; k < phases.size(); ++k) {
    const double turns = std::floor(phases[k] / span), inside = phases[k] - turns * span;
    const Index m = std::max<Index>(std::upper_bound(edges, edges + count, inside) - edges - 1, 0);
    const double width = edges[m + 1] - edges[m], h = width / orbit.frequency;
    const double share = (inside - edges[m]) / width, x = 2.0 * share - 1.0;
    legendre[1] = x;
    for (Index j = 2; j < s + 2; ++j) {
      const double order = static_cast<double>(j);
      legendre[j] =
          ((2.0 * order - 1.0) * x * legendre[j - 1] - (order - 1.0) * legendre[j - 2]) / order;
    }
    const Vector single = h * orbit.single.transpose().lazyProduct(legendre.head(s + 1));
    const Vector twofold = h * h * orbit.twofold.transpose().lazyProduct(legendre);
    const double sign = std::fmod(turns, 2.0) != 0.0 ? orbit.mirror_sign : 1.0;
    const auto rates = orbit.rates.middleRows(m * s, s).transpose();
    const auto start = orbit.starts.row(m).transpose();
    out.col(k).head(half) =
        sign * (start.head(half) + h * share * start.tail(half) + rates.lazyProduct(twofold));
    out.col(k).tail(half) = sign * (start.tail(half) + rates.lazyProduct(single));
  }
}

bool eliminate_stages(const Lapack& lapack, const Intervals& of, Index m,
                      Eigen::Map<Matrix> by_start, Eigen::Map<Matrix> end) {
  const Index s = of.stages, half = of.half, n = 2 * half;
  const double h = of.durations(m);
  const Vector start = of.starts.row(m);
  const auto k = of.rates.middleRows(m * s, s);
  // Integrals of the accelerations from the beginning to each stage (half, s).
  const Matrix single = h * k.transpose().lazyProduct(of.single.transpose());
  const Matrix twofold = h * h * k.transpose().lazyProduct(of.twofold.transpose());
  Matrix by_frequency(n, s);  // of the states at the stages
  by_frequency << h * start.tail(half).lazyProduct(of.nodes.transpose()) + 2.0 * twofold, single;
  by_frequency /= -of.frequency;

  Matrix matrix(s * half, s * half);
  Eigen::MatrixXd right(s * half, n + 3);
  for (Index i = 0; i < s; ++i) {
    const Index at = m * s + i;
    const auto linearised = of.linearised.middleRows(at * (2 + n), 2 + n).rightCols(half);
    const auto by_state = of.linearised.middleRows(at * (2 + n) + 2 + half, half);
    const auto by_place = by_state.leftCols(half), by_speed = by_state.rightCols(half);
    for (Index j = 0; j < s; ++j) {
      matrix.block(i * half, j * half, half, half) =
          -h * of.single(i, j) * by_speed - h * h * of.twofold(i, j) * by_place;
    }
    auto own = right.middleRows(i * half, half);
    own.leftCols(half) = by_place;
    own.middleCols(half, half) = by_speed + h * of.nodes(i) * by_place;
    own.col(n) = (linearised.row(0) - k.row(i)).transpose();
    own.col(n + 1) = by_state.lazyProduct(by_frequency.col(i));
    if (of.by_frequency.size() > 0) own.col(n + 1) += of.by_frequency.col(at);
    own.col(n + 2).setZero();
    if (of.speed_varies) own.col(n + 2) = linearised.row(1).transpose();
  }
  matrix.diagonal().array() += 1.0;

  int size = static_cast<int>(s * half), columns = static_cast<int>(n + 3), info = 0;
  char transposed = 'T';  // LAPACK reads a matrix by columns
  std::vector<int> pivots(static_cast<std::size_t>(size));
  lapack.dgetrf(&size, &size, matrix.data(), &size, pivots.data(), &info);
  if (info > 0) return false;
  lapack.dgetrs(&transposed, &size, &columns, matrix.data(), &size, pivots.data(), right.data(),
                &size, &info);
  by_start = right;

  end.setIdentity();
  end.block(0, half, half, half).diagonal().setConstant(h);
  end.col(n + 1) = by_frequency.col(s - 1);
  for (Index j = 0; j < s; ++j) {
    const auto rates = by_start.middleRows(j * half, half);
    end.topRows(half) += h * h * of.twofold(s - 1, j) * rates;
    end.bottomRows(half) += h * of.single(s - 1, j) * rates;
  }
  if (of.units.size() == 0) return true;
  const bool last = m + 1 == of.starts.rows();
  Vector gap = start - (last ? of.mirror_sign : 1.0) * of.starts.row(last ? 0 : m + 1).transpose();
  gap.head(half) += h * start.tail(half) + twofold.col(s - 1);
  gap.tail(half) += single.col(s - 1);
  end.col(n) += gap;
  end.leftCols(n).array().rowwise() *= of.units.col(0).transpose().array();
  end.array().colwise() /= of.units.col(0).array();
  return true;
}

std::vector<Index> multiply_maps(const double* maps, Index count, Index n, Index columns,
                                 double most, double* out) {
  std::vector<Index> begins;
  for (Index m = 0; m < count; ++m) {
    const GivenMatrix map(maps + m * n * columns, n, columns);
    Eigen::Map<Matrix> to(out + m * n * columns, n, columns);
    if (m > 0) {
      const GivenMatrix before(to.data() - n * columns, n, columns);
      to.noalias() = map.leftCols(n) * before;
      to.rightCols(columns - n) += map.rightCols(columns - n);
      if ((to.leftCols(n).array().abs() < most).all()) continue;
    }
    to = map;
    begins.push_back(m);
  }
  return begins;
}

}  // namespace pipedyn
