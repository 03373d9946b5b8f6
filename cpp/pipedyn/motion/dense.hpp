// SPDX-License-Identifier: MIT
//
// Solves A x = b for four complex matrices A (n, n) at once by Gaussian elimination. Matrices in
// one vector share their pivots: a pivot is the row in which the smallest of their numbers is
// largest. Entry (i, j) of the four matrices is row i n + j of the array that read_shifted takes.
//
// The file is local to each translation unit, like vector/pack.hpp.
#pragma once

#include "pipedyn/vector/shifts.hpp"

namespace {

inline double smallest_square(const Complex& a) {
  double squares[lanes<Shifts>], least = HUGE_VAL;
  store(squares, a.re * a.re + a.im * a.im);
  for (const double square : squares) least = square < least ? square : least;
  return least;
}

/// Overwrites a (n, n, 8) with its factors. pivots: room for 4 n numbers.
void factorise_dense(double* a, Count n, Count* pivots) {
  for (Count pass = 0; pass < shift_passes; ++pass) {
    const auto read = [=](Count i, Count j) { return read_shifted(a, i * n + j, pass); };
    const auto write = [=](Count i, Count j, const Complex& value) {
      write_shifted(a, i * n + j, pass, value);
    };
    Count* const order = pivots + pass * n;
    for (Count k = 0; k < n; ++k) {
      Count pivot = k;
      double most = -1.0;
      for (Count i = k; i < n; ++i) {
        const double size = smallest_square(read(i, k));
        if (size > most) {
          most = size;
          pivot = i;
        }
      }
      order[k] = pivot;
      for (Count j = 0; j < n && pivot != k; ++j) {
        const Complex held = read(k, j);
        write(k, j, read(pivot, j));
        write(pivot, j, held);
      }
      const Complex inverse_pivot = inverse(read(k, k));
      write(k, k, inverse_pivot);
      for (Count i = k + 1; i < n; ++i) {
        const Complex factor = read(i, k) * inverse_pivot;
        write(i, k, factor);
        for (Count j = k + 1; j < n; ++j) write(i, j, read(i, j) - factor * read(k, j));
      }
    }
  }
}

/// Overwrites b (n, 8) with x.
void solve_dense(const double* factors, const Count* pivots, Count n, double* b) {
  for (Count pass = 0; pass < shift_passes; ++pass) {
    const auto read = [=](Count i, Count j) { return read_shifted(factors, i * n + j, pass); };
    for (Count k = 0; k < n; ++k) {
      const Count pivot = pivots[pass * n + k];
      if (pivot == k) continue;
      const Complex held = read_shifted(b, k, pass);
      write_shifted(b, k, pass, read_shifted(b, pivot, pass));
      write_shifted(b, pivot, pass, held);
    }
    const auto left = [&](Count i, Count begin, Count end) {
      Complex rest = read_shifted(b, i, pass);
      for (Count j = begin; j < end; ++j) rest = rest - read(i, j) * read_shifted(b, j, pass);
      return rest;
    };
    for (Count i = 1; i < n; ++i) write_shifted(b, i, pass, left(i, 0, i));
    for (Count i = n - 1; i >= 0; --i) write_shifted(b, i, pass, left(i, i + 1, n) * read(i, i));
  }
}

}  // namespace
