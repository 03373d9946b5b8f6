// SPDX-License-Identifier: MIT
//
// Exponentials of dense matrices, and maps of intervals by Magnus' series of fourth order, which
// python/pipedyn/orbits/magnus.py explains. The exponential is the polynomial of degree 18 of
// Bader, Blanes and Casas (2019), Computing the matrix exponential with an optimized Taylor
// polynomial approximation, Mathematics 7, 1174, which takes five products; squarings follow.
//
// Matrices are row-major. The file is local to each translation unit, like vector/pack.hpp.
#pragma once

#include "pipedyn/chain/motion.hpp"
#include "pipedyn/vector/layout.hpp"
#include "pipedyn/vector/products.hpp"

namespace {

/// Square matrices of one size with their exponentials, in the thread's scratch. Rows are padded to
/// whole packs.
struct Exponential {
  Count n, columns, step;
  double *a, *square, *cube, *sixth, *first, *whole;

  Exponential(Count size, Layout& layout) : n(size), columns(whole_packs(size)) {
    step = (columns + 7) / 8 * 8;
    if (step % 16 == 0) step += 8;  // rows an odd number of cache lines apart share no cache set
    a = layout.take(n * step);
    square = layout.take(n * step);
    cube = layout.take(n * step);
    sixth = layout.take(n * step);
    first = layout.take(n * step);
    whole = layout.take(n * step);
  }
  void product(double* left, double* right, double* to) const {
    multiply<false>({left, step}, {right, step}, n, n, columns, 1.0, {to, step});
  }
  void add_product(double* left, double* right, double* to) const {
    multiply<true>({left, step}, {right, step}, n, n, columns, 1.0, {to, step});
  }
  template <class Function>
  void for_each_pack(const Function& function) const {
    for (Count i = 0; i < n; ++i) {
      for (Count j = 0; j < columns; j += width) function(i * step + j);
    }
  }
  void clear(double* to) const {
    for_each_pack([&](Count at) { store(to + at, Pack{}); });
  }
  /// Largest sum of the absolute values in a column; NaN unless all are finite.
  double norm(const double* of) const {
    double largest = 0.0, lost = 0.0;
    for (Count j = 0; j < columns; j += width) {
      Pack sum{};
      for (Count i = 0; i < n; ++i) sum += absolute(load<Pack>(of + i * step + j));
      double each[width];
      store(each, sum);
      for (const double one : each) {
        largest = one > largest ? one : largest;
        lost += 0.0 * one;
      }
    }
    return largest + lost;
  }
  void exchange(double*& left, double*& right) const {
    double* const held = left;
    left = right;
    right = held;
  }

  /// Norms of A up to which the polynomial is the exponential of A (1 + e) with e below rounding,
  /// theta_18 of its authors, and with e below 1e-12: |e| = norm^18 / 19!.
  static constexpr double exact = 1.09, close = 1.9;

  /// Replaces a by its exponential; by NaN if that overflows on the way. It is halved until its
  /// norm is at most largest_norm.
  void take(double largest_norm) {
    product(a, a, square);
    product(square, a, cube);
    product(cube, cube, sixth);
    // The error's terms begin with A^19 = A^6 A^6 A^3 A^2 A^2, and A^24 is the product of four A^6.
    const double of_sixth = norm(sixth), of_square = norm(square);
    const double first_lost = of_sixth * of_sixth * norm(cube) * of_square * of_square;
    const double size = std::fmax(std::pow(first_lost, 1.0 / 19.0), std::pow(of_sixth, 1.0 / 6.0));
    double f = 0.0 * first_lost + 1.0;  // NaN unless the powers are finite
    int halvings = 0;
    for (; size * f > largest_norm; ++halvings) f *= 0.5;
    const double f2 = f * f, f3 = f2 * f, f6 = f3 * f3;
    for_each_pack([&](Count at) {
      const Pack a1 = f * load<Pack>(a + at), a2 = f2 * load<Pack>(square + at),
                 a3 = f3 * load<Pack>(cube + at), a6 = f6 * load<Pack>(sixth + at);
      const auto sum = [&](double* to, double c1, double c2, double c3, double c6) {
        store(to + at, Pack(c1 * a1 + c2 * a2 + c3 * a3 + c6 * a6));
      };
      sum(first, -0.100365581030144618291, -8.02924648241156932449e-3, -8.92138498045729985177e-4,
          0.0);
      sum(a, 0.397849749499645077844, 1.36783778460411720168, 0.498289622525382669416,
          -6.37898194594723280150e-4);
      sum(square, 1.68015813878906206114, 0.0571779846478865511061, -6.98210122488052056106e-3,
          3.34975017086070470649e-5);
      sum(cube, -0.0676404519071381882256, 0.0675961301770459654925, 0.0295552570429315521194,
          -1.39180257516060693404e-5);
      sum(sixth, 0.0, -0.0923364619367118555360, -0.0169364939002081722752,
          -1.40086798182036094347e-5);
    });
    for (Count i = 0; i < n; ++i) {
      square[i * step + i] -= 10.9676396052962061844;
      cube[i * step + i] -= 0.0904316832390810593223;
    }
    add_product(first, sixth, cube);  // of degree 9
    for_each_pack([&](Count at) {
      store(square + at, Pack(load<Pack>(square + at) + load<Pack>(cube + at)));
    });
    add_product(square, cube, a);
    for (; halvings > 0; --halvings) {
      product(a, a, first);
      exchange(a, first);
    }
  }
};

/// Implements MotionKernel::exponentials.
void exponentials(const double* exponents, Count n, Count count, double* out) {
  auto of = laid_out([n](Layout& layout) { return Exponential(n, layout); });
  of.clear(of.a);
  for (Count k = 0; k < count; ++k) {
    for (Count i = 0; i < n; ++i) {
      for (Count j = 0; j < n; ++j) of.a[i * of.step + j] = exponents[(k * n + i) * n + j];
    }
    of.take(of.exact);
    for (Count i = 0; i < n; ++i) {
      for (Count j = 0; j < n; ++j) out[(k * n + i) * n + j] = of.a[i * of.step + j];
    }
  }
}

/// Implements MotionKernel::interval_map.
void interval_map(const pipedyn::MagnusInterval& along, double* out) {
  const Count half = along.half, n = 2 * half;
  struct Arrays {
    Exponential of;
    double *both, *weights;
  };
  auto [of, both, weights] = laid_out([&](Layout& layout) {
    return Arrays{{n, layout}, layout.take(2 * half * n), layout.take(2 * along.stages)};
  });
  double *const b0 = both, *const b1 = both + half * n;  // their lower halves, b1 with a minus
  const double unit = along.unit, step = along.duration / static_cast<double>(along.parts) * unit;
  double* const rows = const_cast<double*>(along.rows);
  of.clear(of.a);
  for (Count part = 0; part < along.parts; ++part) {
    for (Count s = 0; s < along.stages; ++s) {
      weights[s] = along.duration * along.zeroth[part * along.stages + s];
      weights[along.stages + s] = -along.duration * along.first[part * along.stages + s];
    }
    multiply<false>({weights, along.stages}, {rows, half * n}, 2, along.stages, half * n, 1.0,
                    {both, half * n});
    for (Count i = 0; i < 2 * half; ++i) {
      for (Count j = 0; j < half; ++j) both[i * n + j] *= 1.0 / unit;
    }
    double *const top = of.a, *const bottom = of.a + half * of.step;
    for (Count i = 0; i < half; ++i) {
      for (Count j = 0; j < n; ++j) {
        top[i * of.step + j] = step * b1[i * n + j];
        bottom[i * of.step + j] = b0[i * n + j];
      }
      top[i * of.step + half + i] += step;
      for (Count j = 0; j < half; ++j) bottom[i * of.step + half + j] -= step * b1[i * n + j];
    }
    multiply<true>({b0 + half, n}, {b1, n}, half, half, n, 1.0, {bottom, of.step});
    multiply<true>({b1 + half, n}, {b0, n}, half, half, n, -1.0, {bottom, of.step});
    of.take(of.close);  // a turn of a fast mode is known to 1e-12 of it
    if (part > 0) {
      of.product(of.a, of.whole, of.first);
      of.exchange(of.first, of.whole);
    } else {
      of.exchange(of.a, of.whole);
      of.clear(of.a);
    }
  }
  for (Count i = 0; i < n; ++i) {
    for (Count j = 0; j < n; ++j) out[i * n + j] = of.whole[i * of.step + j];
  }
}

}  // namespace
