// SPDX-License-Identifier: MIT
#include "pipedyn/motion/collocation.hpp"

#include <algorithm>
#include <atomic>
#include <cmath>

#include "pipedyn/util/threads.hpp"
#include "pipedyn/vector/levels.hpp"

// Products are lazy where matrices are small: Eigen then compiles no blocked product for them.
namespace pipedyn {

void states_at_stages(const Intervals& of, Index m, Eigen::Ref<Matrix> out) {
  const Index s = of.stages(), half = of.half();
  const auto& [nodes, single, twofold] = of.weights;
  const double h = of.durations(m);
  const double *const start = of.starts.data() + m * 2 * half, *const speed = start + half;
  const Index step = out.outerStride();
  Matrix rates = h * of.rates.middleRows(m * s, s).transpose();
  for (Index c = 0; c < half; ++c) {
    for (Index i = 0; i < s; ++i) {
      out(c, i) = start[c] + h * nodes(i) * speed[c];
      out(half + c, i) = speed[c];
    }
  }
  const auto add = [&](const GivenMatrix& integrals, double* to) {
    motion_kernel().multiply(rates.data(), s, integrals.data(), s, half, s, s, true, to, step);
  };
  add(single, out.data() + half * step);
  rates *= h;
  add(twofold, out.data());
}

// -------------------------------------------------------------------------- relation of both ends

SpanRelation::SpanRelation(const Matrix& maps, Index n, double most) {
  const Index count = maps.rows() / n, columns = maps.cols(), loads = columns - n;
  products_.resize(maps.rows(), columns);
  for (Index m = 0; m < count; ++m) {
    const auto map = maps.middleRows(m * n, n);
    auto to = products_.middleRows(m * n, n);
    if (m > 0) {
      const auto before = products_.middleRows((m - 1) * n, n);
      to.leftCols(n).setZero();
      to.rightCols(loads) = map.rightCols(loads);
      motion_kernel().multiply(map.data(), columns, before.data(), columns, n, n, columns, true,
                               to.data(), columns);
      if ((to.leftCols(n).array().abs() < most).all()) continue;
    }
    to = map;
    begins_.push_back(m);
  }

  // The rows of the runs' relations [L | R | C].
  const auto runs = static_cast<Index>(begins_.size());
  Matrix relations(runs * n, 2 * n + loads);
  for (Index run = 0; run < runs; ++run) {
    const Index end = run + 1 < runs ? begins_[static_cast<std::size_t>(run + 1)] : count;
    auto own = relations.middleRows(run * n, n);
    const auto product = products_.middleRows((end - 1) * n, n);
    own << -product.leftCols(n), Matrix::Identity(n, n), product.rightCols(loads);
  }
  while (relations.rows() > n) {
    const Index pairs = relations.rows() / (2 * n);
    Matrix eliminated(pairs * n, 3 * n + loads), fewer(relations.rows() - pairs * n, 2 * n + loads);
    for (Index pair = 0; pair < pairs; ++pair) {
      const auto a = relations.middleRows(2 * pair * n, n);
      const auto b = relations.middleRows((2 * pair + 1) * n, n);
      Matrix both = Matrix::Zero(2 * n, 3 * n + loads);  // [of the state between | L | R | C]
      both.topRows(n) << a.middleCols(n, n), a.leftCols(n), Matrix::Zero(n, n), a.rightCols(loads);
      both.bottomRows(n) << b.leftCols(n), Matrix::Zero(n, n), b.rightCols(n + loads);
      for (Index k = 0; k < n; ++k) {  // Householder's reflections
        Vector normal = both.col(k).tail(2 * n - k);
        const double size = normal.norm();
        if (size == 0.0) continue;
        normal[0] += std::copysign(size, normal[0]);
        auto rest = both.bottomRightCorner(2 * n - k, 3 * n + loads - k);
        const Vector along = 2.0 / normal.squaredNorm() * rest.transpose().lazyProduct(normal);
        rest -= normal.lazyProduct(along.transpose());
      }
      eliminated.middleRows(pair * n, n) = both.topRows(n);
      fewer.middleRows(pair * n, n) = both.bottomRightCorner(n, 2 * n + loads);
    }
    const Index left = relations.rows() - 2 * pairs * n;
    fewer.bottomRows(left) = relations.bottomRows(left);
    levels_.push_back(std::move(eliminated));
    relations = std::move(fewer);
  }
  first = relations.leftCols(n);
  last = relations.middleCols(n, n);
  known = relations.rightCols(loads);
}

Matrix SpanRelation::states(const Matrix& ends, const Matrix& loads) const {
  const Index n = first.rows(), count = products_.rows() / n;
  Matrix at = ends;  // where runs begin, and at the end
  for (auto level = levels_.rbegin(); level != levels_.rend(); ++level) {
    const Index pairs = level->rows() / n;
    Matrix more(at.rows() + pairs * n, ends.cols());
    for (Index pair = 0; pair < pairs; ++pair) {
      const auto own = level->middleRows(pair * n, n);
      const auto begin = at.middleRows(pair * n, n), end = at.middleRows((pair + 1) * n, n);
      Matrix between = own.rightCols(loads.rows()).lazyProduct(loads) -
                       own.middleCols(n, n).lazyProduct(begin) -
                       own.middleCols(2 * n, n).lazyProduct(end);
      for (Index k = n - 1; k >= 0; --k) {
        between.row(k) -=
            own.row(k).segment(k + 1, n - 1 - k).lazyProduct(between.bottomRows(n - 1 - k));
        between.row(k) /= own(k, k);
      }
      more.middleRows(2 * pair * n, n) = begin;
      more.middleRows((2 * pair + 1) * n, n) = between;
    }
    const Index left = at.rows() - pairs * n;
    more.bottomRows(left) = at.bottomRows(left);
    at = std::move(more);
  }
  const Index k = ends.cols();
  Matrix found(count * n, k), given(n + loads.rows(), k);
  given.bottomRows(loads.rows()) = loads;
  for (std::size_t run = 0; run < begins_.size(); ++run) {
    const Index begin = begins_[run], next = run + 1 < begins_.size() ? begins_[run + 1] : count;
    given.topRows(n) = at.middleRows(static_cast<Index>(run) * n, n);
    found.middleRows(begin * n, n) = given.topRows(n);
    motion_kernel().multiply(products_.row(begin * n).data(), products_.cols(), given.data(), k,
                             (next - begin - 1) * n, given.rows(), k, false,
                             found.data() + (begin + 1) * n * k, k);
  }
  return found;
}

// ---------------------------------------------------------------------------- linearised equations

LinearisedOrbit::LinearisedOrbit(const Intervals& of, const Forces& forces, double most)
    : n_(2 * of.half()), each_(of.stages() * of.half()), mirror_sign_(of.mirror_sign) {
  const MotionKernel& kernel = motion_kernel();
  const Index count = of.count(), s = of.stages(), half = of.half(), n = n_;
  const Index loads = forces.of_states ? 0 : 3, lead = loads > 0 ? 2 : 0, columns = n + loads;
  by_rates.resize(count * each_, columns);
  maps.resize(count * n, columns);
  across_ = Vector::Zero(n + 2);
  unit = 1.0;
  std::atomic<bool> solved = true;
  // A unit of work, some 5 ns (util/threads.hpp), is the time of 100 of an interval's products:
  // measured for n = 40, with stages of size 160.
  in_parts(count, each_ * each_ * (each_ + n) / 100, [&](Index begin, Index end) {
    Matrix states(n, s), drive, linearised(s * (lead + n), n);
    for (Index m = begin; m < end && solved; ++m) {
      states_at_stages(of, m, states);
      const bool varies = forces.speeds.size() > 1, closes = m + 1 == count;
      Batch batch{states.data(), forces.speeds.data() + (varies ? m * s : 0), s, varies ? 1 : 0};
      if (forces.drive.size() > 0) {
        drive = forces.drive.middleCols(m * s, s);
        batch.drive = drive.data();
        batch.drive_rows = drive.rows();
      }
      forces.linearise(batch, linearised.data());
      const CollocationInterval interval{
          .half = half,
          .stages = s,
          .nodes = of.weights.nodes.data(),
          .single = of.weights.single.data(),
          .twofold = of.weights.twofold.data(),
          .start = of.starts.data() + m * n,
          .next = of.starts.data() + (closes ? 0 : m + 1) * n,
          .states = states.data(),
          .next_sign = closes ? of.mirror_sign : 1.0,
          .rates = of.rates.data() + m * each_,
          .linearised = linearised.data(),
          .by_frequency =
              forces.by_frequency.size() > 0 ? forces.by_frequency.data() + m * s : nullptr,
          .frequency_step = count * s,
          .loads = loads,
          .speed_varies = forces.speed_varies,
          .duration = of.durations(m),
          .frequency = of.frequency,
      };
      if (!kernel.eliminate_stages(interval, by_rates.row(m * each_).data(),
                                   maps.row(m * n).data())) {
        solved = false;
      }
      if (m == 0) {
        unit = std::sqrt(
            std::max(linearised.block(lead + half, 0, half, half).cwiseAbs().maxCoeff(), 1.0));
      }
      if (closes && loads > 0) across_.head(n) = linearised.row((s - 1) * (2 + n)).transpose();
    }
  });
  regular = solved;
  if (!regular) return;
  if (forces.forced && loads > 0) {
    by_rates.col(n + 1).swap(by_rates.col(n + 2));
    maps.col(n + 1).swap(maps.col(n + 2));
  }
  maps.middleCols(half, half) *= unit;
  for (Index m = 0; m < count; ++m) maps.middleRows(m * n + half, half) /= unit;
  span = SpanRelation(maps, n, most);
  // The phase is fixed by a change across the motion at the last stage, where the span ends; a
  // forced motion has its phase from the forces, and its speed is fixed.
  if (forces.forced) {
    across_ = Vector::Unit(n + 2, n);
  } else {
    across_.segment(half, half) *= unit;
    across_ /= across_.norm();
  }
}

Matrix LinearisedOrbit::restored(const Matrix& ends, const Matrix& loads) const {
  const Index n = n_, half = n / 2, count = maps.rows() / n, k = ends.cols();
  const Index states = count * n, rates = by_rates.rows();
  Matrix found(states + rates + 2, k), given(n + loads.rows(), k);
  found.topRows(states) = span.states(ends, loads);
  given.bottomRows(loads.rows()) = loads;
  for (Index m = 0; m < count; ++m) {
    found.middleRows(m * n + half, half) *= unit;
    given.topRows(n) = found.middleRows(m * n, n);
    motion_kernel().multiply(by_rates.row(m * each_).data(), by_rates.cols(), given.data(), k,
                             each_, given.rows(), k, false, found.row(states + m * each_).data(),
                             k);
  }
  found.bottomRows(2) = loads.bottomRows(2);
  return found;
}

std::optional<Vector> LinearisedOrbit::change(const Vector& phase, double shift, const Vector& row,
                                              double gap, double share, const Vector& turn) const {
  // Conditions on the phase and on row . z involve all unknowns, so that three solutions which meet
  // simpler conditions on the first state and the last two unknowns are combined.
  const Index n = n_, half = n / 2, right = 3, columns = n + 2 + right;
  Matrix system = Matrix::Zero(n + 4, columns);  // with room after its end, see solve_real
  system.topLeftCorner(n, n) = span.first + mirror_sign_ * span.last;
  system.block(0, n, n, 2) = -span.known.rightCols(2);
  system.col(n + 2).head(n) = share * span.known.col(0);
  // A combination of the equations is 0 on both sides: their sum with this condition, times a
  // vector that the combination does not lose, holds where both do.
  if (turn.size() > 0) system.topLeftCorner(n, n) += turn * turn.transpose();
  system.row(n).head(n + 2) = across_.transpose();
  system(n, n + 3) = 1.0;
  auto condition = system.row(n + 1);
  condition.head(half) = row.head(half).transpose();
  condition.segment(half, half) = unit * row.segment(half, half).transpose();
  condition.segment(n, 2) = row.tail(2).transpose();
  const double length = condition.head(n + 2).norm();
  condition.head(n + 2) /= length;
  system(n + 1, n + 4) = 1.0 / length;
  if (!motion_kernel().solve_real(system.data(), n + 2, right, columns)) return std::nullopt;
  const auto known = system.block(0, n + 2, n + 2, right);
  Matrix ends(2 * n, right), loads(3, right);
  ends << known.topRows(n), mirror_sign_ * known.topRows(n);
  loads << share, 0.0, 0.0, known.bottomRows(2);
  const Matrix found = restored(ends, loads);
  const Eigen::RowVector3d in_phase = phase.transpose().lazyProduct(found);
  const Eigen::RowVector3d along = row.transpose().lazyProduct(found);
  const double determinant = in_phase[1] * along[2] - in_phase[2] * along[1];
  if (determinant == 0.0) return std::nullopt;
  const double off = shift - in_phase[0], missing = gap - along[0];
  const Eigen::Vector3d shares{1.0, (off * along[2] - missing * in_phase[2]) / determinant,
                               (missing * in_phase[1] - off * along[1]) / determinant};
  return found.lazyProduct(shares);
}

}  // namespace pipedyn
