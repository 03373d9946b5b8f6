// SPDX-License-Identifier: MIT
//
// (mu - J) x = b for four complex mu at once with a matrix J (n, n), by Gauss' elimination. The mu
// in one vector share their pivots: the row whose smallest number is largest.
//
// Local to each translation unit, like vector/pack.hpp.
#pragma once

#include "pipedyn/vector/scratch.hpp"
#include "pipedyn/vector/shifts.hpp"

namespace {

inline double smallest_square(const Complex& a) {
  double squares[lanes<Shifts>], least = HUGE_VAL;
  store(squares, a.re * a.re + a.im * a.im);
  for (const double square : squares) least = square < least ? square : least;
  return least;
}

inline Complex load_complex(const double* from) {
  return {load<Shifts>(from), load<Shifts>(from + lanes<Shifts>)};
}

inline void store_complex(double* to, const Complex& a) {
  store(to, a.re);
  store(to + lanes<Shifts>, a.im);
}

/// Where entry (i, j) of one pass is among the factors.
struct DenseFactors {
  static constexpr Count numbers = 2 * lanes<Shifts>;
  double* entries;
  Count n;

  double* at(Count i, Count j) const { return entries + (i * n + j) * numbers; }
  Complex read(Count i, Count j) const { return load_complex(at(i, j)); }
};

/// factors: room for 8 n^2 numbers; pivots: for 4 n.
void factorise_dense(const double* slopes, const double* mu, Count n, double* factors,
                     Count* pivots) {
  for (Count pass = 0; pass < shift_passes; ++pass) {
    const DenseFactors of{factors + pass * n * n * DenseFactors::numbers, n};
    const Complex shift = read_shifted(mu, 0, pass), zero = 0.0 * shift;
    Count* const order = pivots + pass * n;
    for (Count i = 0; i < n; ++i) {
      for (Count j = 0; j < n; ++j) {
        store_complex(of.at(i, j), (i == j ? shift : zero) + -slopes[i * n + j]);
      }
    }
    for (Count k = 0; k < n; ++k) {
      Count pivot = k;
      double most = -1.0;
      for (Count i = k; i < n; ++i) {
        const double size = smallest_square(of.read(i, k));
        if (size > most) {
          most = size;
          pivot = i;
        }
      }
      order[k] = pivot;
      for (Count j = 0; j < n && pivot != k; ++j) {
        const Complex held = of.read(k, j);
        store_complex(of.at(k, j), of.read(pivot, j));
        store_complex(of.at(pivot, j), held);
      }
      const Complex inverse_pivot = inverse(of.read(k, k));
      store_complex(of.at(k, k), inverse_pivot);
      for (Count i = k + 1; i < n; ++i) {
        const Complex factor = of.read(i, k) * inverse_pivot;
        store_complex(of.at(i, k), factor);
        for (Count j = k + 1; j < n; ++j) {
          store_complex(of.at(i, j), of.read(i, j) - factor * of.read(k, j));
        }
      }
    }
  }
}

/// b (n, 8) becomes x.
void solve_dense(double* factors, const Count* pivots, Count n, double* b) {
  for (Count pass = 0; pass < shift_passes; ++pass) {
    const DenseFactors of{factors + pass * n * n * DenseFactors::numbers, n};
    for (Count k = 0; k < n; ++k) {
      const Count pivot = pivots[pass * n + k];
      if (pivot == k) continue;
      const Complex held = read_shifted(b, k, pass);
      write_shifted(b, k, pass, read_shifted(b, pivot, pass));
      write_shifted(b, pivot, pass, held);
    }
    for (Count i = 1; i < n; ++i) {
      Complex sum = read_shifted(b, i, pass);
      for (Count j = 0; j < i; ++j) sum = sum - of.read(i, j) * read_shifted(b, j, pass);
      write_shifted(b, i, pass, sum);
    }
    for (Count i = n - 1; i >= 0; --i) {
      Complex sum = read_shifted(b, i, pass);
      for (Count j = i + 1; j < n; ++j) sum = sum - of.read(i, j) * read_shifted(b, j, pass);
      write_shifted(b, i, pass, sum * of.read(i, i));
    }
  }
}

}  // namespace
