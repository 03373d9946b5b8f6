// SPDX-License-Identifier: MIT
//
// Integrals along the pipe from the clamp to each point, panel by panel (GridTables). Local to each
// translation unit, like vector/pack.hpp.
#pragma once

#include "pipedyn/galerkin/kernel.hpp"
#include "pipedyn/vector/pack.hpp"

namespace {

using pipedyn::GridTables;

template <class Real>
inline Real at(const double* array, Count i) {
  return load<Real>(array + i * lanes<Real>);
}

template <class Real>
inline void set(double* array, Count i, const Real& x) {
  store(array + i * lanes<Real>, x);
}

template <class Real>
inline void add(double* array, Count i, const Real& x) {
  store(array + i * lanes<Real>, at<Real>(array, i) + x);
}

template <class Real>
inline Real square_root(const Real& x) {
  double each[lanes<Real>];
  store(each, x);
  for (double& lane : each) lane = std::sqrt(lane);
  return load<Real>(each);
}

// ------------------------------------------------------------------------------------- products

/// Some rows and packs of out = a x.
template <int rows, int packs>
inline void product_tile(Count depth, const double* a, const double* x, Count row_length,
                         double* out) {
  Pack sum[rows][packs] = {};
  for (Count k = 0; k < depth; ++k, x += row_length) {
    Pack values[packs];
    for (int c = 0; c < packs; ++c) values[c] = load<Pack>(x + c * width);
    for (int r = 0; r < rows; ++r) {
      const double factor = a[r * depth + k];
      for (int c = 0; c < packs; ++c) sum[r][c] += factor * values[c];
    }
  }
  for (int r = 0; r < rows; ++r) {
    for (int c = 0; c < packs; ++c) store(out + r * row_length + c * width, sum[r][c]);
  }
}

template <int packs>
inline void product_columns(Count size, const double* a, const double* x, Count row_length,
                            double* out) {
  Count r = 0;
  for (; r + 4 <= size; r += 4) {
    product_tile<4, packs>(size, a + r * size, x, row_length, out + r * row_length);
  }
  for (; r < size; r += 2) {
    product_tile<2, packs>(size, a + r * size, x, row_length, out + r * row_length);
  }
}

/// out = a x with a (size, size), x (size, row_length); size even, rows of whole packs.
void product(Count size, const double* a, const double* x, Count row_length, double* out) {
  const Count all_packs = row_length / width;
  for (Count c = 0; c < all_packs;) {
    const Count left = all_packs - c;
    const double* const from = x + c * width;
    double* const to = out + c * width;
    if (left == 1) {
      product_columns<1>(size, a, from, row_length, to);
      c += 1;
    } else if (left == 2 || left == 4) {
      product_columns<2>(size, a, from, row_length, to);
      c += 2;
    } else {
      product_columns<3>(size, a, from, row_length, to);
      c += 3;
    }
  }
}

/// From sums and differences (both in sums) to the integrals' halves: see GridTables.
void integrate_folded(const GridTables& grid, Count row, double* sums, double* moments) {
  const Count block = grid.nodes + 1, half = block / 2;
  for (Count panel = 0; panel < grid.panels; ++panel) {
    double* const sum = sums + panel * block * row;
    double* const difference = sum + half * row;
    double* const even = moments + panel * block * row;
    double* const odd = even + half * row;
    double* const half_of_all = even + (block - 1) * row;
    double* const last = difference + (half - 1) * row;
    product(half, grid.from_sums, sum, row, odd);
    if (panel == 0) {
      for (Count i = 0; i < row; ++i) last[i] = half_of_all[i];
    } else {
      const double* const before = even - row;  // half of all before the panel
      for (Count i = 0; i < row; ++i) {
        last[i] = half_of_all[i] + 2.0 * before[i];
        half_of_all[i] += before[i];
      }
    }
    product(half, grid.from_differences, difference, row, even);
  }
}

/// The first columns of the integrals at each point, from their halves; out has rows of its own
/// length.
void unfold(const GridTables& grid, Count row, const double* moments, Count columns, double* out,
            Count out_row) {
  const Count nodes = grid.nodes, block = nodes + 1, half = block / 2, middle = half - 1;
  for (Count first = 0; first < grid.points; first += block) {
    for (Count p = 0; p < half; ++p) {
      const double* __restrict const even = moments + (first + p) * row;
      const double* __restrict const odd = even + half * row;
      double* __restrict const here = out + (first + p) * out_row;
      double* __restrict const mirrored = out + (first + nodes - 1 - p) * out_row;
      double* __restrict const end = out + (first + nodes) * out_row;
      if (p < middle) {
        for (Count i = 0; i < columns; ++i) {
          here[i] = even[i] + odd[i];
          mirrored[i] = even[i] - odd[i];
        }
      } else {
        for (Count i = 0; i < columns; ++i) {
          here[i] = even[i];
          end[i] = 2.0 * odd[i];
        }
      }
    }
  }
}

Count integrals_scratch_size(const GridTables& grid, Count columns) {
  return 2 * grid.points * whole_packs(columns);
}

void integrate(const GridTables& grid, const double* f, Count columns, double* out,
               double* scratch) {
  const Count nodes = grid.nodes, block = nodes + 1, half = block / 2, middle = half - 1;
  const Count row = whole_packs(columns);
  double* const moments = scratch + grid.points * row;
  for (Count panel = 0; panel < grid.panels; ++panel) {
    const Count first = panel * block;
    for (Count p = 0; p < half; ++p) {
      const double* __restrict const here = f + (first + p) * columns;
      const double* __restrict const mirrored = f + (first + nodes - 1 - p) * columns;
      double* __restrict const sum = scratch + (first + p) * row;
      double* __restrict const difference = sum + half * row;
      const double length = grid.length[panel];
      const double share = p < middle ? length : 0.5 * length;  // the middle is its own mirror
      for (Count i = 0; i < columns; ++i) {
        sum[i] = share * (here[i] + mirrored[i]);
        difference[i] = length * (here[i] - mirrored[i]);
      }
      for (Count i = columns; i < row; ++i) sum[i] = difference[i] = 0.0;
    }
  }
  integrate_folded(grid, row, scratch, moments);
  unfold(grid, row, moments, columns, out, columns);
}

}  // namespace
