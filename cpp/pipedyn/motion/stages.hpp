// SPDX-License-Identifier: MIT
//
// Operations of Newton's method on the stages of an implicit step, besides evaluating rates and
// solving systems. Each row of eight numbers holds the stages, or the real parts and then the
// imaginary parts of the four systems into which they decouple.
//
// The file is local to each translation unit, like vector/pack.hpp.
#pragma once

#include "pipedyn/vector/pack.hpp"

namespace {

/// A row of eight numbers in packs.
struct Row {
  static constexpr Count packs = 8 / width;
  Pack of[packs];

  static Row at(const double* from) {
    Row row;
    for (Count k = 0; k < packs; ++k) row.of[k] = load<Pack>(from + k * width);
    return row;
  }
  void to(double* out) const {
    for (Count k = 0; k < packs; ++k) store(out + k * width, of[k]);
  }
  void add(double factor, const Row& other) {
    for (Count k = 0; k < packs; ++k) of[k] += factor * other.of[k];
  }
  /// from M, M (8, 8) by rows.
  static Row product(const double* from, const double* matrix) {
    Row sum{};
    for (Count i = 0; i < 8; ++i) sum.add(from[i], at(matrix + 8 * i));
    return sum;
  }
};

/// Computes out = a A + b B, row by row.
void mix_stages(const double* a, const double* matrix_a, const double* b, const double* matrix_b,
                Count rows, double* out) {
  for (Count i = 0; i < rows; ++i) {
    Row sum = Row::product(a + 8 * i, matrix_a);
    if (b != nullptr) sum.add(1.0, Row::product(b + 8 * i, matrix_b));
    sum.to(out + 8 * i);
  }
}

/// Computes W += x, Z += x M, Y = y + Z. Returns the sum of squares of x M / `allowed`.
double correct_stages(const double* x, const double* matrix, const double* y, const double* allowed,
                      Count rows, double* w, double* z, double* out) {
  Row squares{};
  for (Count i = 0; i < rows; ++i) {
    Row systems = Row::at(w + 8 * i), stages = Row::at(z + 8 * i);
    const Row step = Row::product(x + 8 * i, matrix);
    systems.add(1.0, Row::at(x + 8 * i));
    stages.add(1.0, step);
    systems.to(w + 8 * i);
    stages.to(z + 8 * i);
    const double unit = 1.0 / allowed[i];
    for (Count k = 0; k < Row::packs; ++k) {
      const Pack size = unit * step.of[k];
      squares.of[k] += size * size;
      stages.of[k] += y[i];
    }
    stages.to(out + 8 * i);
  }
  double each[8], sum = 0.0;
  squares.to(each);
  for (const double square : each) sum += square;
  return sum;
}

}  // namespace
