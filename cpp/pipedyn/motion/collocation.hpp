// SPDX-License-Identifier: MIT
//
// Linearised collocation of a periodic orbit: it eliminates the stages of each interval and joins
// the intervals. An interval of length h that begins at the state (p, v) has accelerations k_i at
// its stages c_i,
//
//   p_i = p + h c_i v + h^2 sum_j T_ij k_j,   v_i = v + h sum_j O_ij k_j,   k_i = f(p_i, v_i),
//
// and their changes dk solve (1 - h O (x) f_v - h^2 T (x) f_p) dk = b, where the right-hand sides b
// are the effects of the first state, of the residual, of the frequency (h ~ 1 / frequency) and of
// the speed. These s n / 2 equations are solved by Gaussian elimination with partial pivoting. The
// file is included by the sources of one vector level, like dense.hpp.
#pragma once

#include "pipedyn/chain/motion.hpp"
#include "pipedyn/vector/layout.hpp"

namespace {

using pipedyn::Intervals;

/// Number of pivots after which the rest of the matrix is updated: it is read and written once for
/// all of them.
constexpr Count panel = 8;

/// Subtracts multiples of up to `panel` rows from a row, in a range of columns. It may write up to
/// a pack beyond the range.
inline void subtract_rows(double* to, const double* factors, const double* const* rows, Count count,
                          Count begin, Count end) {
  if (count == panel) {
    for (Count j = begin; j < end; j += width) {
      Pack sum = load<Pack>(to + j);
      for (Count p = 0; p < panel; ++p) sum -= factors[p] * load<Pack>(rows[p] + j);
      store(to + j, sum);
    }
    return;
  }
  for (Count p = 0; p < count; ++p) {
    for (Count j = begin; j < end; j += width) {
      store(to + j, Pack(load<Pack>(to + j) - factors[p] * load<Pack>(rows[p] + j)));
    }
  }
}

/// Solves A X = B, given as rows [A | B] with `columns` columns and room for a pack behind the
/// last. Sorts the rows by their pivots and writes X over B. Returns false if A is singular.
bool solve_rows(double** rows, Count size, Count columns) {
  for (Count k0 = 0; k0 < size; k0 += panel) {
    const Count end = k0 + panel < size ? k0 + panel : size;
    for (Count k = k0; k < end; ++k) {
      Count best = k;
      for (Count r = k + 1; r < size; ++r) {
        if (std::fabs(rows[r][k]) > std::fabs(rows[best][k])) best = r;
      }
      double* const row = rows[best];
      rows[best] = rows[k];
      rows[k] = row;
      if (row[k] == 0.0) return false;
      const double inverse = 1.0 / row[k];
      for (Count r = k + 1; r < size; ++r) {
        const double factor = rows[r][k] *= inverse;
        for (Count j = k + 1; j < end; ++j) rows[r][j] -= factor * row[j];
      }
    }
    for (Count k = k0 + 1; k < end; ++k) {
      subtract_rows(rows[k], rows[k] + k0, rows + k0, k - k0, end, columns);
    }
    for (Count r = end; r < size; ++r) {
      subtract_rows(rows[r], rows[r] + k0, rows + k0, end - k0, end, columns);
    }
  }
  for (Count k0 = (size - 1) / panel * panel; k0 >= 0; k0 -= panel) {
    const Count end = k0 + panel < size ? k0 + panel : size;
    for (Count k = end - 1; k >= k0; --k) {
      const double inverse = 1.0 / rows[k][k];
      for (Count j = size; j < columns; ++j) rows[k][j] *= inverse;
      for (Count r = k0; r < k; ++r) {
        subtract_rows(rows[r], rows[r] + k, rows + k, 1, size, columns);
      }
    }
    for (Count r = 0; r < k0; ++r) {
      subtract_rows(rows[r], rows[r] + k0, rows + k0, end - k0, size, columns);
    }
  }
  return true;
}

/// Eliminates the stages of interval m, see `MotionKernel::eliminate_stages`.
bool eliminate_interval(const Intervals& of, Count m, double** rows, double* rates, double* ends) {
  const Count s = of.stages, half = of.half, n = 2 * half, size = s * half, more = n + 3;
  const double h = of.durations[m];
  const double* const start = of.starts + m * n;
  const double* const k = of.rates + m * size;
  double* const by_frequency = ends + n + 1;  // one number for each stage, `more` numbers apart
  for (Count i = 0; i < s; ++i) {
    for (Count a = 0; a < half; ++a) {
      double once = 0.0, twice = 0.0;
      for (Count j = 0; j < s; ++j) {
        once += of.once[i * s + j] * k[j * half + a];
        twice += of.twice[i * s + j] * k[j * half + a];
      }
      by_frequency[a * more] =
          -h / of.frequency * (of.nodes[i] * start[half + a] + 2.0 * h * twice);
      by_frequency[(half + a) * more] = -h / of.frequency * once;
    }
    for (Count a = 0; a < half; ++a) {
      const Count at = m * s + i;
      const double* const linearised = of.linearised + at * (2 + n) * n;
      const double* const by_state = linearised + (2 + half + a) * n;
      double* const row = rows[i * half + a];
      for (Count j = 0; j < s; ++j) {
        const double once = -h * of.once[i * s + j], twice = -h * h * of.twice[i * s + j];
        for (Count b = 0; b < half; ++b) {
          row[j * half + b] = once * by_state[half + b] + twice * by_state[b];
        }
      }
      row[i * half + a] += 1.0;
      double* const right = row + size;
      double turned = 0.0;
      for (Count b = 0; b < half; ++b) {
        right[b] = by_state[b];
        right[half + b] = by_state[half + b] + h * of.nodes[i] * by_state[b];
      }
      for (Count b = 0; b < n; ++b) turned += by_state[b] * by_frequency[b * more];
      const Count stage = a * of.count * s + at;
      right[n] = linearised[half + a] - k[i * half + a];
      right[n + 1] = turned + (of.by_frequency != nullptr ? of.by_frequency[stage] : 0.0);
      right[n + 2] = of.speed_varies ? linearised[n + half + a] : 0.0;
    }
  }
  if (!solve_rows(rows, size, size + more)) return false;
  for (Count r = 0; r < size; ++r) {
    for (Count j = 0; j < more; ++j) rates[r * more + j] = rows[r][size + j];
  }
  for (Count a = 0; a < n; ++a) {
    double* const end = ends + a * more;
    for (Count j = 0; j < more; ++j) {
      if (j != n + 1) end[j] = j == a ? 1.0 : 0.0;  // column n + 1 is filled above
    }
    if (a < half) end[half + a] = h;
    for (Count j = 0; j < s; ++j) {
      const Count last = (s - 1) * s + j;
      const double weight = a < half ? h * h * of.twice[last] : h * of.once[last];
      const double* const rate = rates + (j * half + a % half) * more;
      for (Count b = 0; b < more; ++b) end[b] += weight * rate[b];
    }
  }
  return true;
}

/// Map of changes of the state over interval m, in units of the state, and the gap between the end
/// of the interval and the next state.
void join_interval(const Intervals& of, Count m, double* ends) {
  const Count s = of.stages, half = of.half, n = 2 * half, more = n + 3;
  const double h = of.durations[m];
  const double* const start = of.starts + m * n;
  const double* const next = m + 1 < of.count ? start + n : of.starts;
  const double sign = m + 1 < of.count ? 1.0 : of.mirror;
  const double* const k = of.rates + m * s * half;
  for (Count a = 0; a < n; ++a) {
    double* const end = ends + a * more;
    const double* const weights = (a < half ? of.twice : of.once) + (s - 1) * s;
    double sum = 0.0;
    for (Count j = 0; j < s; ++j) sum += weights[j] * k[j * half + a % half];
    const double moved = a < half ? h * (start[half + a] + h * sum) : h * sum;
    end[n] += start[a] + moved - sign * next[a];
    const double inverse = 1.0 / of.units[a];
    for (Count b = 0; b < n; ++b) end[b] *= of.units[b] * inverse;
    for (Count b = n; b < more; ++b) end[b] *= inverse;
  }
}

bool eliminate_stages(const Intervals& of, Count first, Count last, double** rows, double* rates,
                      double* ends) {
  const Count n = 2 * of.half, size = of.stages * of.half, more = n + 3;
  const Count stride = whole_packs(size + more) + width;
  double* const matrix = laid_out([&](Layout& layout) { return layout.take(size * stride); });
  for (Count i = 0; i < size * stride; ++i) matrix[i] = 0.0;
  for (Count m = first; m < last; ++m) {
    for (Count r = 0; r < size; ++r) rows[r] = matrix + r * stride;
    if (!eliminate_interval(of, m, rows, rates + m * size * more, ends + m * n * more)) {
      return false;
    }
    if (of.units != nullptr) join_interval(of, m, ends + m * n * more);
  }
  return true;
}

}  // namespace
