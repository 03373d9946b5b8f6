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

/// Sums over k of left(k, row) times a vector right(k, column), in registers. Calls take(row,
/// column, sum) for each.
template <int rows, int columns, class Left, class Right, class Take>
inline void product_tile(Count depth, const Left& left, const Right& right, const Take& take) {
  Pack sum[rows][columns] = {};
#pragma GCC unroll 2
  for (Count k = 0; k < depth; ++k) {
    decltype(right(k, 0)) values[columns];
    for (int c = 0; c < columns; ++c) values[c] = right(k, c);
    for (int r = 0; r < rows; ++r) {
      const auto factor = left(k, r);
      for (int c = 0; c < columns; ++c) sum[r][c] += factor * values[c];
    }
  }
  for (int r = 0; r < rows; ++r) {
    for (int c = 0; c < columns; ++c) take(r, c, sum[r][c]);
  }
}

/// Product of a (size, size) with packs of the rows that row(k, c) returns; size is even. Calls
/// take(r, c, entry) for each pack of the result.
template <int packs, class Row, class Take>
inline void product(Count size, const double* a, const Row& row, const Take& take) {
  const auto tile = [&]<int rows>(Count first) {
    product_tile<rows, packs>(
        size, [&](Count k, int r) { return a[(first + r) * size + k]; }, row,
        [&](int r, int c, const Pack& sum) { take(first + r, c, sum); });
  };
  Count first = 0;
  for (; first + 4 <= size; first += 4) tile.template operator()<4>(first);
  if (first < size) tile.template operator()<2>(first);
}

/// Computes some packs of the integrals on a panel, as GridTables describes. first: whether the
/// panel begins at the clamp.
template <int packs>
void integrate_panel(const GridTables& grid, double length, bool first, Count row_length,
                     const double* f, double* out) {
  const Count nodes = grid.nodes, half = (nodes + 1) / 2;
  const auto entry = [row_length](const double* rows, Count p, int c) {
    return load<Pack>(rows + p * row_length + c * width);
  };
  const auto set_entry = [row_length, out](Count p, int c, const Pack& x) {
    store(out + p * row_length + c * width, x);
  };
  product<packs>(
      half, grid.from_sums,
      [&](Count k, int c) { return entry(f, k, c) + entry(f, nodes - 1 - k, c); },
      [&](Count p, int c, const Pack& sum) {
        set_entry(p + 1 < half ? nodes - 1 - p : nodes, c, length * sum);
      });
  Pack start[packs];  // half the integral over the panel, plus the integral before the panel
  for (int c = 0; c < packs; ++c) {
    start[c] = entry(out, nodes, c);
    if (!first) start[c] += entry(out, -1, c);
  }
  product<packs>(
      half, grid.from_differences,
      [&](Count k, int c) { return entry(f, k, c) - entry(f, nodes - 1 - k, c); },
      [&](Count p, int c, const Pack& sum) {
        const Pack even = start[c] + length * sum;
        const Pack odd = p + 1 < half ? entry(out, nodes - 1 - p, c) : Pack{};
        set_entry(p, c, even + odd);
        set_entry(nodes - 1 - p, c, even - odd);
      });
  for (int c = 0; c < packs; ++c) set_entry(nodes, c, start[c] + entry(out, nodes, c));
}

/// Integrals from the clamp to each point of the functions whose values at the nodes are the first
/// columns of f. f and out are (N, row_length), with rows of whole packs.
void integrate(const GridTables& grid, Count row_length, Count columns, const double* f,
               double* out) {
  const Count all_packs = whole_packs(columns) / width;
  for (Count panel = 0; panel < grid.panels; ++panel) {
    const Count start = panel * (grid.nodes + 1) * row_length;
    const double length = grid.length[panel];
    for (Count c = 0; c < all_packs;) {
      const Count left = all_packs - c, from = start + c * width;
      if (left == 1) {
        integrate_panel<1>(grid, length, panel == 0, row_length, f + from, out + from);
        c += 1;
      } else if (left == 2 || left == 4) {
        integrate_panel<2>(grid, length, panel == 0, row_length, f + from, out + from);
        c += 2;
      } else {
        integrate_panel<3>(grid, length, panel == 0, row_length, f + from, out + from);
        c += 3;
      }
    }
  }
}

}  // namespace
