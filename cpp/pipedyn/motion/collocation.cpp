// SPDX-License-Identifier: MIT
#include "pipedyn/motion/collocation.hpp"

#include <algorithm>
#include <cmath>

#include "pipedyn/vector/levels.hpp"

// Products are lazy where matrices are small: Eigen then compiles no blocked product for them.
namespace pipedyn {

void states_at(const Polynomials& orbit, const Vector& phases, Eigen::Map<Matrix> out) {
  const Index s = orbit.single.cols(), half = orbit.rates.cols(), count = orbit.starts.rows();
  const double *const edges = orbit.edges.data(), span = edges[count];
  Vector legendre = Vector::Ones(s + 2), single(s), twofold(s);
  // L(j) = x L(j - 1) + less(j) (x L(j - 1) - L(j - 2)), without the division in the recursion.
  const Vector less =
      1.0 - Vector::LinSpaced(s + 2, 0.0, static_cast<double>(s + 1)).array().inverse();
  for (Index k = 0; k < phases.size(); ++k) {
    const double turns = std::floor(phases[k] / span), inside = phases[k] - turns * span;
    const Index m = std::max<Index>(std::upper_bound(edges, edges + count, inside) - edges - 1, 0);
    const double width = edges[m + 1] - edges[m], h = width / orbit.frequency;
    const double share = (inside - edges[m]) / width, x = 2.0 * share - 1.0;
    legendre[1] = x;
    for (Index j = 2; j < s + 2; ++j) {
      const double next = x * legendre[j - 1];
      legendre[j] = next + less[j] * (next - legendre[j - 2]);
    }
    single.noalias() = h * orbit.single.transpose().lazyProduct(legendre.head(s + 1));
    twofold.noalias() = h * h * orbit.twofold.transpose().lazyProduct(legendre);
    const double sign = std::fmod(turns, 2.0) != 0.0 ? orbit.mirror_sign : 1.0;
    const auto rates = orbit.rates.middleRows(m * s, s).transpose();
    const auto start = orbit.starts.row(m).transpose();
    out.col(k).head(half) =
        sign * (start.head(half) + h * share * start.tail(half) + rates.lazyProduct(twofold));
    out.col(k).tail(half) = sign * (start.tail(half) + rates.lazyProduct(single));
  }
}

Matrix stage_system(Index stages, Index half) {
  // Rows an odd number of cache lines apart do not share cache sets.
  const Index columns = stages * half + 2 * half + 3;
  return Matrix(stages * half + 1, ((columns + 7) / 8 | 1) * 8);
}

bool eliminate_stages(const Intervals& of, Index m, Matrix& system, Eigen::Map<Matrix> by_start,
                      Eigen::Map<Matrix> end) {
  const MotionKernel& kernel = motion_kernel();
  const Index s = of.stages, half = of.half, n = 2 * half, size = s * half, step = system.cols();
  const double h = of.durations(m);
  const Vector start = of.starts.row(m);
  const auto k = of.rates.middleRows(m * s, s);
  // Integrals of the accelerations from the beginning to each stage (half, s).
  const Matrix single = h * k.transpose().lazyProduct(of.single.transpose());
  const Matrix twofold = h * h * k.transpose().lazyProduct(of.twofold.transpose());
  Matrix by_frequency(n, s);  // of the states at the stages
  by_frequency << h * start.tail(half).lazyProduct(of.nodes.transpose()) + 2.0 * twofold, single;
  by_frequency /= -of.frequency;

  Matrix weights(s, 2);  // of a stage's derivatives by place and by speed
  for (Index i = 0; i < s; ++i) {
    const Index at = m * s + i;
    const auto linearised = of.linearised.middleRows(at * (2 + n), 2 + n).rightCols(half);
    const GivenMatrix by_state(of.linearised.data() + (at * (2 + n) + 2 + half) * n, half, n);
    const auto by_place = by_state.leftCols(half), by_speed = by_state.rightCols(half);
    weights.col(0) = -h * h * of.twofold.row(i).transpose();
    weights.col(1) = -h * of.single.row(i).transpose();
    for (Index j = 0; j < half; ++j) {
      kernel.multiply(weights.data(), 2, by_state.data() + j * n, half, s, 2, half, false,
                      system.data() + (i * half + j) * step, half);
    }
    auto own = system.block(i * half, size, half, n + 3);
    own.leftCols(half) = by_place;
    own.middleCols(half, half) = by_speed + h * of.nodes(i) * by_place;
    own.col(n) = (linearised.row(0) - k.row(i)).transpose();
    own.col(n + 1) = by_state.lazyProduct(by_frequency.col(i));
    if (of.by_frequency.size() > 0) own.col(n + 1) += of.by_frequency.col(at);
    own.col(n + 2).setZero();
    if (of.speed_varies) own.col(n + 2) = linearised.row(1).transpose();
  }
  system.diagonal().head(size).array() += 1.0;
  if (!kernel.solve_real(system.data(), size, n + 3, step)) return false;
  by_start = system.block(0, size, size, n + 3);

  end.setIdentity();
  end.block(0, half, half, half).diagonal().setConstant(h);
  end.col(n + 1) = by_frequency.col(s - 1);
  Matrix last(2, s);
  last << h * h * of.twofold.row(s - 1), h * of.single.row(s - 1);
  kernel.multiply(last.data(), s, by_start.data(), half * (n + 3), 2, s, half * (n + 3), true,
                  end.data(), half * (n + 3));
  if (of.units.size() == 0) return true;
  const bool closes = m + 1 == of.starts.rows();
  Vector gap =
      start - (closes ? of.mirror_sign : 1.0) * of.starts.row(closes ? 0 : m + 1).transpose();
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
      to.leftCols(n).setZero();
      to.rightCols(columns - n) = map.rightCols(columns - n);
      motion_kernel().multiply(map.data(), columns, before.data(), columns, n, n, columns, true,
                               to.data(), columns);
      if ((to.leftCols(n).array().abs() < most).all()) continue;
    }
    to = map;
    begins.push_back(m);
  }
  return begins;
}

}  // namespace pipedyn
