// SPDX-License-Identifier: MIT
//
// Operations of Newton's method on the stages of an implicit step, besides evaluating rates and
// solving systems. Each row of eight numbers holds the stages, or the real parts and then the
// imaginary parts of the four systems into which they decouple.
//
// The file is local to each translation unit, like vector/pack.hpp.
#pragma once

#include "pipedyn/vector/shifts.hpp"

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
};

/// Computes the rows `from` M of a block, M (8, 8) by rows. The rows of a block share what is read
/// of M.
template <Count block>
struct Product {
  Row rows[block] = {};

  Product(const double* from, const double* matrix) {
    for (Count i = 0; i < 8; ++i) {
      const Row row = Row::at(matrix + 8 * i);
      for (Count k = 0; k < block; ++k) rows[k].add(from[8 * k + i], row);
    }
  }
};

/// Calls body<rows of the block>(first row) for blocks of rows.
template <class Body>
void for_each_rows(Count rows, const Body& body) {
  constexpr Count block = 4;
  Count i = 0;
  for (; i + block <= rows; i += block) body.template operator()<block>(i);
  for (; i < rows; ++i) body.template operator()<1>(i);
}

/// Computes out = a M, less the complex products of mu and the rows of b unless b is null.
void mix_stages(const double* a, const double* matrix, const double* b, const double* mu,
                Count rows, double* out) {
  for_each_rows(rows, [=]<Count block>(Count i) {
    const Product<block> sum(a + 8 * i, matrix);
    for (Count k = 0; k < block; ++k) {
      sum.rows[k].to(out + 8 * (i + k));
      for (Count pass = 0; pass < shift_passes && b != nullptr; ++pass) {
        const Complex whole = read_shifted(out, i + k, pass), shift = read_shifted(mu, 0, pass);
        write_shifted(out, i + k, pass, whole - shift * read_shifted(b, i + k, pass));
      }
    }
  });
}

/// Computes W += x, Z += x M, Y = y + Z. Returns the sum of squares of x M / `allowed`.
double correct_stages(const double* x, const double* matrix, const double* y, const double* allowed,
                      Count rows, double* w, double* z, double* out) {
  Row squares{};
  for_each_rows(rows, [&]<Count block>(Count first) {
    const Product<block> steps(x + 8 * first, matrix);
    for (Count r = 0; r < block; ++r) {
      const Count i = first + r;
      const Row& step = steps.rows[r];
      Row systems = Row::at(w + 8 * i), stages = Row::at(z + 8 * i);
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
  });
  double each[8], sum = 0.0;
  squares.to(each);
  for (const double square : each) sum += square;
  return sum;
}

}  // namespace
