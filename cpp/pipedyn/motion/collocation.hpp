// SPDX-License-Identifier: MIT
//
// Linearised collocation of a periodic orbit: it solves for the stages of each interval. An
// interval of length h that begins at the state (p, v) has accelerations k_i at its stages c_i,
//
//   p_i = p + h c_i v + h^2 sum_j T_ij k_j,   v_i = v + h sum_j O_ij k_j,   k_i = f(p_i, v_i),
//
// and their changes dk solve (1 - h O (x) f_v - h^2 T (x) f_p) dk = b for several right-hand sides
// b. These s n / 2 equations are solved by Gaussian elimination with partial pivoting. The file is
// included by the sources of one vector level, like dense.hpp.
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

/// Solves for the changes of the accelerations at the stages of interval m; see
/// `MotionKernel::solve_stages`.
bool solve_interval(const Intervals& of, Count m, double** rows, double* out) {
  const Count s = of.stages, half = of.half, n = 2 * half, size = s * half;
  const double h = of.durations[m];
  for (Count i = 0; i < s; ++i) {
    for (Count a = 0; a < half; ++a) {
      const double* const by_state = of.linearised + ((m * s + i) * (2 + n) + 2 + half + a) * n;
      double* const row = rows[i * half + a];
      for (Count j = 0; j < s; ++j) {
        const double once = -h * of.once[i * s + j], twice = -h * h * of.twice[i * s + j];
        for (Count b = 0; b < half; ++b) {
          row[j * half + b] = once * by_state[half + b] + twice * by_state[b];
        }
      }
      row[i * half + a] += 1.0;
      const double* const right = of.right + (m * size + i * half + a) * of.columns;
      for (Count b = 0; b < of.columns; ++b) row[size + b] = right[b];
    }
  }
  if (!solve_rows(rows, size, size + of.columns)) return false;
  for (Count r = 0; r < size; ++r) {
    for (Count b = 0; b < of.columns; ++b) out[r * of.columns + b] = rows[r][size + b];
  }
  return true;
}

bool solve_stages(const Intervals& of, Count first, Count last, double** rows, double* out) {
  const Count size = of.stages * of.half;
  const Count stride = whole_packs(size + of.columns) + width;
  double* const matrix = laid_out([&](Layout& layout) { return layout.take(size * stride); });
  for (Count i = 0; i < size * stride; ++i) matrix[i] = 0.0;
  for (Count m = first; m < last; ++m) {
    for (Count r = 0; r < size; ++r) rows[r] = matrix + r * stride;
    if (!solve_interval(of, m, rows, out + m * size * of.columns)) return false;
  }
  return true;
}

}  // namespace
