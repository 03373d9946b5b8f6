// SPDX-License-Identifier: MIT
//
// Products of dense matrices, row-major, and solution of linear systems with them.
//
// The file is local to each translation unit, like vector/pack.hpp.
#pragma once

#include "pipedyn/vector/pack.hpp"

namespace {

/// A matrix whose rows begin `step` numbers apart.
struct Rows {
  double* at;
  Count step;
};

/// Part of a product, of so many rows and of as many columns as `packs` of Real have lanes. The
/// last pack begins `repeated` columns earlier, which are those of another part and are not
/// changed.
template <class Real, Count rows, Count packs, bool adds>
inline void multiply_tile(const Rows& a, const Rows& b, Count inner, double factor, const Rows& c,
                          Count repeated) {
  const auto column = [&](Count p) { return p * lanes<Real> - (p == packs - 1 ? repeated : 0); };
  Real sum[rows][packs]{};
  for (Count k = 0; k < inner; ++k) {
    Real right[packs];
    for (Count p = 0; p < packs; ++p) right[p] = load<Real>(b.at + k * b.step + column(p));
    for (Count i = 0; i < rows; ++i) {
      const Real left = all<Real>(a.at[i * a.step + k]);
      for (Count p = 0; p < packs; ++p) sum[i][p] += left * right[p];
    }
  }
  for (Count i = 0; i < rows; ++i) {
    for (Count p = 0; p < packs; ++p) {
      double* const to = c.at + i * c.step + column(p);
      const Real before = adds ? load<Real>(to) : Real{}, product = before + factor * sum[i][p];
      if (p < packs - 1 || repeated == 0) {
        store(to, product);
        continue;
      }
      double each[lanes<Real>];
      store(each, product);
      for (Count lane = repeated; lane < lanes<Real>; ++lane) to[lane] = each[lane];
    }
  }
}

/// Columns of a product: as many as `packs` of Real have lanes.
template <class Real, Count packs, bool adds>
PIPEDYN_NOINLINE void multiply_columns(const Rows& a, const Rows& b, Count rows, Count inner,
                                       double factor, const Rows& c, Count repeated) {
  const auto tile = [&]<Count count>(Count i) {
    multiply_tile<Real, count, packs, adds>({a.at + i * a.step, a.step}, b, inner, factor,
                                            {c.at + i * c.step, c.step}, repeated);
  };
  Count i = 0;
  for (; i + 4 <= rows; i += 4) tile.template operator()<4>(i);
  for (; i < rows; ++i) tile.template operator()<1>(i);
}

/// Computes c = factor a b, or adds it to c, for a (rows, inner) and b (inner, columns).
template <bool adds>
void multiply(const Rows& a, const Rows& b, Count rows, Count inner, Count columns, double factor,
              const Rows& c) {
  const auto in_packs_of = [&]<class Real>(const Real&) {
    Count left = (columns + lanes<Real> - 1) / lanes<Real>, repeated = 0;
    const auto some = [&]<Count packs>() {
      const Count j = ((columns + lanes<Real> - 1) / lanes<Real> - left) * lanes<Real>;
      left -= packs;
      if (left == 0) repeated = j + packs * lanes<Real> - columns;
      multiply_columns<Real, packs, adds>(a, {b.at + j, b.step}, rows, inner, factor,
                                          {c.at + j, c.step}, repeated);
    };
    while (left > 0) {
      if (left == 1) {
        some.template operator()<1>();
      } else if (left == 2 || left == 4) {
        some.template operator()<2>();
      } else {
        some.template operator()<3>();
      }
    }
  };
  if (columns >= width) {
    in_packs_of(Pack{});
  } else {
    in_packs_of(0.0);
  }
}

/// Gaussian elimination with partial pivoting, by halves of the columns, so that most of the work
/// is in products. The matrix is [A | B] with A (n, n), and has room for 8 numbers after its end.
struct Pivoted {
  static constexpr Count narrow = 8;
  Rows matrix;
  Count n, right;  // number of columns of B

  double* at(Count i, Count j) const { return matrix.at + i * matrix.step + j; }

  /// Subtracts from a block its rows of columns `from` .. `from` + `inner`, times these rows there.
  void subtract(Count row, Count rows, Count column, Count columns, Count from, Count inner) const {
    multiply<true>({at(row, from), matrix.step}, {at(from, column), matrix.step}, rows, inner,
                   columns, -1.0, {at(row, column), matrix.step});
  }

  /// Factors some columns below their diagonal; returns false if a pivot is 0.
  bool factorise(Count first, Count count) const {
    if (count <= narrow) return factorise_narrow(first, count);
    const Count left = (count / 2 + narrow - 1) / narrow * narrow, middle = first + left;
    if (!factorise(first, left)) return false;
    solve_lower(first, left, middle, count - left);
    subtract(middle, n - middle, middle, count - left, first, left);
    return factorise(middle, count - left);
  }
  bool factorise_narrow(Count first, Count count) const {
    for (Count k = first; k < first + count; ++k) {
      Count pivot = k;
      for (Count i = k + 1; i < n; ++i) {
        if (std::fabs(*at(i, k)) > std::fabs(*at(pivot, k))) pivot = i;
      }
      if (*at(pivot, k) == 0.0) return false;
      for (Count j = 0; j < n + right && pivot != k; ++j) {
        const double held = *at(k, j);
        *at(k, j) = *at(pivot, j);
        *at(pivot, j) = held;
      }
      double row[narrow] = {};
      for (Count j = k + 1; j < first + count; ++j) row[j - first] = *at(k, j);
      const double inverse = 1.0 / *at(k, k);
      for (Count i = k + 1; i < n; ++i) {
        double* const own = at(i, first);
        const double factor = own[k - first] * inverse;
        for (Count j = 0; j < narrow; j += width) {
          store(own + j, Pack(load<Pack>(own + j) - factor * load<Pack>(row + j)));
        }
        own[k - first] = factor;
      }
    }
    return true;
  }
  /// Solves with the lower factor of some columns, for other columns of the same rows.
  void solve_lower(Count first, Count count, Count column, Count columns) const {
    if (count <= narrow) return substitute<false>(first, count, column, columns);
    const Count left = (count / 2 + narrow - 1) / narrow * narrow, middle = first + left;
    solve_lower(first, left, column, columns);
    subtract(middle, count - left, column, columns, first, left);
    solve_lower(middle, count - left, column, columns);
  }
  /// Solves with the upper factor of some columns, for B.
  void solve_upper(Count first, Count count) const {
    if (count <= narrow) return substitute<true>(first, count, n, right);
    const Count left = (count / 2 + narrow - 1) / narrow * narrow, middle = first + left;
    solve_upper(middle, count - left);
    subtract(first, left, n, right, middle, count - left);
    solve_upper(first, left);
  }
  /// Solves with a few columns of a factor, whose lower one has ones on its diagonal.
  template <bool upper>
  void substitute(Count first, Count count, Count column, Count columns) const {
    double factors[narrow][narrow], inverse[narrow];
    for (Count i = 0; i < count; ++i) {
      inverse[i] = upper ? 1.0 / *at(first + i, first + i) : 1.0;
      for (Count k = 0; k < count; ++k) factors[i][k] = inverse[i] * *at(first + i, first + k);
    }
    const auto rows_of = [&]<class Real>(const Real&, Count j) {
      Real row[narrow];
      for (Count turn = 0; turn < count; ++turn) {
        const Count i = upper ? count - 1 - turn : turn;
        double* const own = at(first + i, j);
        Real rest = inverse[i] * load<Real>(own);
        for (Count k = upper ? i + 1 : 0; k < (upper ? count : i); ++k) {
          rest -= factors[i][k] * row[k];
        }
        row[i] = rest;
        store(own, rest);
      }
    };
    Count j = column;
    for (; j + width <= column + columns; j += width) rows_of(Pack{}, j);
    for (; j < column + columns; ++j) rows_of(0.0, j);
  }
};

/// Implements MotionKernel::solve_real.
bool solve_real(double* matrix, Count n, Count right, Count step) {
  const Pivoted of{{matrix, step}, n, right};
  if (!of.factorise(0, n)) return false;
  of.solve_lower(0, n, n, right);
  of.solve_upper(0, n);
  return true;
}

/// Implements MotionKernel::multiply.
void multiply_rows(const double* a, Count a_step, const double* b, Count b_step, Count rows,
                   Count inner, Count columns, bool adds, double* c, Count c_step) {
  const Rows left{const_cast<double*>(a), a_step}, middle{const_cast<double*>(b), b_step};
  const auto product = adds ? multiply<true> : multiply<false>;
  product(left, middle, rows, inner, columns, 1.0, {c, c_step});
}

}  // namespace
