// SPDX-License-Identifier: MIT
//
// Eliminates the stages of a collocation's interval. An interval of length h that begins at the
// state (p, v) has accelerations k_i at its stages c_i,
//
//   p_i = p + h c_i v + h^2 sum_j T_ij k_j,   v_i = v + h sum_j O_ij k_j,   k_i = f(p_i, v_i),
//
// and their changes dk solve (1 - h O (x) f_v - h^2 T (x) f_p) dk = b, where the right-hand sides b
// are the effects of the first state, of the residual, of the frequency (h ~ 1 / frequency) and of
// the speed. In these equations the stages of one coordinate stand together, so that packs of them
// share derivatives of forces, and rows of b are padded to whole packs.
//
// The file is local to each translation unit, like vector/pack.hpp.
#pragma once

#include "pipedyn/chain/motion.hpp"
#include "pipedyn/vector/layout.hpp"
#include "pipedyn/vector/products.hpp"

namespace {

/// The equations of one interval's stages, in the thread's scratch.
struct StageEquations {
  const pipedyn::CollocationInterval& of;
  Count s, half, n, size, lead;        // rows before the derivatives by the state
  Count right, columns, packed, step;  // of b; padded; of weights, of the matrix
  double *matrix, *by_place, *by_speed, *moved, *ends;

  StageEquations(const pipedyn::CollocationInterval& interval, Layout& layout)
      : of(interval), s(of.stages), half(of.half), n(2 * half), size(s * half) {
    lead = of.loads > 0 ? 2 : 0;
    right = n + of.loads;
    columns = whole_packs(right);
    packed = whole_packs(s);
    step = ((size + columns + 7) / 8 | 1) * 8;  // an odd number of lines: see magnus.hpp
    matrix = layout.take((size + 1) * step);
    by_place = layout.take(s * packed);
    by_speed = layout.take(s * packed);
    moved = layout.take(s * n);
    ends = layout.take(2 * columns);
  }

  double* known(Count c, Count i) const { return matrix + (c * s + i) * step + size; }

  void set() const {
    const double h = of.duration;
    for (Count i = 0; i < s; ++i) {
      for (Count k = 0; k < packed; ++k) {
        by_place[i * packed + k] = k < s ? -h * h * of.twofold[k * s + i] : 0.0;
        by_speed[i * packed + k] = k < s ? -h * of.single[k * s + i] : 0.0;
      }
      // Changes of the state at the stage with the frequency.
      for (Count c = 0; c < half; ++c) {
        const double *const place = of.states + c * s, *const speed = place + size;
        const double drift = h * of.nodes[i] * of.start[half + c];
        moved[i * n + c] = (drift - 2.0 * (place[i] - of.start[c])) / of.frequency;
        moved[i * n + half + c] = (of.start[half + c] - speed[i]) / of.frequency;
      }
    }
    for (Count i = 0; i < s; ++i) {
      const double* const rows = of.linearised + i * (lead + n) * n;
      for (Count c = 0; c < half; ++c) set_row(rows, i, c);
    }
  }
  /// Sets the equation of coordinate c at stage i. rows: those of the stage in `linearised`.
  void set_row(const double* rows, Count i, Count c) const {
    const double *const slopes = rows + (lead + half + c) * n, *const speeds = slopes + half;
    double *const own = matrix + (c * s + i) * step, *const b = own + size;
    for (Count j = 0; j < half; ++j) {  // what a pack writes beyond its stages is written anew
      for (Count k = 0; k < packed; k += width) {
        store(own + j * s + k, Pack(slopes[j] * load<Pack>(by_place + i * packed + k) +
                                    speeds[j] * load<Pack>(by_speed + i * packed + k)));
      }
    }
    own[c * s + i] += 1.0;
    const double since = of.duration * of.nodes[i];
    for (Count j = 0; j < half; ++j) {
      b[j] = slopes[j];
      b[half + j] = speeds[j] + since * slopes[j];
    }
    for (Count j = n; j < columns; ++j) b[j] = 0.0;
    if (of.loads == 0) return;
    b[n] = rows[half + c] - of.rates[i * half + c];
    double sum = of.by_frequency == nullptr ? 0.0 : of.by_frequency[c * of.frequency_step + i];
    for (Count j = 0; j < n; ++j) sum += slopes[j] * moved[i * n + j];
    b[n + 1] = sum;
    if (of.speed_varies) b[n + 2] = rows[n + half + c];
  }

  bool solve() const { return solve_real(matrix, size, columns, step); }

  void write(double* rates, double* end) const {
    for (Count i = 0; i < s; ++i) {
      for (Count c = 0; c < half; ++c) {
        for (Count j = 0; j < right; ++j) rates[(i * half + c) * right + j] = known(c, i)[j];
      }
    }
    const double* const last = by_place + (s - 1) * packed;
    for (Count c = 0; c < half; ++c) {
      double *const place = end + c * right, *const speed = end + (half + c) * right;
      multiply<false>({const_cast<double*>(last), by_speed - by_place}, {known(c, 0), step}, 2, s,
                      columns, -1.0, {ends, columns});
      for (Count j = 0; j < right; ++j) {
        place[j] = ends[j];
        speed[j] = ends[columns + j];
      }
      place[c] += 1.0;
      place[half + c] += of.duration;
      speed[half + c] += 1.0;
      if (of.loads > 0) {
        place[n] += of.states[c * s + s - 1] - of.next_sign * of.next[c];
        speed[n] += of.states[(half + c) * s + s - 1] - of.next_sign * of.next[half + c];
        place[n + 1] += moved[(s - 1) * n + c];
        speed[n + 1] += moved[(s - 1) * n + half + c];
      }
    }
  }
};

/// Implements MotionKernel::eliminate_stages.
bool eliminate_stages(const pipedyn::CollocationInterval& of, double* rates, double* end) {
  const auto equations = laid_out([&](Layout& layout) { return StageEquations(of, layout); });
  equations.set();
  if (!equations.solve()) return false;
  equations.write(rates, end);
  return true;
}

}  // namespace
