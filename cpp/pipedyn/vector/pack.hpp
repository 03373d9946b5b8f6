// SPDX-License-Identifier: MIT
//
// A vector of PIPEDYN_WIDTH numbers, with its sine and cosine. Only the sources that are compiled
// once for each vector level include this file. Everything in it is local to its translation unit,
// so that the linker cannot take code of one level for that of another; for the same reason those
// sources call no template or inline function of a library.
//
// Sine and cosine: x = k pi/2 + r with |r| <= pi/4, pi/2 = p1 + p2 + p3 where p1 and p2 have 43
// bits, so that k p1 and k p2 are exact for |k| < 2^10 with or without fused multiply-add; then
//   sin r = r + r z S(z),  cos r = 1 - z/2 + z^2 C(z),  z = r^2,
// S and C of degree 5, minimax in the relative error (3.5e-18 and 4.7e-20), computed by Remez'
// exchange in 60 digits. The error is below 1.1 ulp up to |x| = 1600; beyond, the C library is
// called.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <type_traits>

#ifndef PIPEDYN_WIDTH
#define PIPEDYN_WIDTH 1
#endif

#define PIPEDYN_JOINED(a, b) a##_##b
#define PIPEDYN_JOINED_VALUES(a, b) PIPEDYN_JOINED(a, b)
#define PIPEDYN_NAMED(name) PIPEDYN_JOINED_VALUES(name, PIPEDYN_LEVEL)  // for example name_avx2

namespace {

using Count = std::ptrdiff_t;
constexpr Count width = PIPEDYN_WIDTH;

// Width 1 is standard C++, for compilers without GCC's vector extensions and attributes.
#if PIPEDYN_WIDTH > 1
#define PIPEDYN_NOINLINE [[gnu::noinline]]
#define PIPEDYN_INLINE [[gnu::always_inline]]
#define PIPEDYN_FLATTEN [[gnu::flatten]]
typedef double Pack __attribute__((vector_size(8 * PIPEDYN_WIDTH)));
typedef std::int64_t Bits __attribute__((vector_size(8 * PIPEDYN_WIDTH)));
#else
#define PIPEDYN_NOINLINE
#define PIPEDYN_INLINE
#define PIPEDYN_FLATTEN
using Pack = double;
using Bits = std::int64_t;
#endif

/// Number of doubles in a Real, which is a double or a pack.
template <class Real>
constexpr Count lanes = static_cast<Count>(sizeof(Real) / sizeof(double));

inline Count whole_packs(Count count) { return (count + width - 1) / width * width; }

template <class To, class From>
inline To same_bits(const From& from) {
  static_assert(sizeof(To) == sizeof(From));
  To to;
  std::memcpy(&to, &from, sizeof to);
  return to;
}

template <class Real>
inline Real load(const double* from) {
  Real x;
  std::memcpy(&x, from, sizeof x);
  return x;
}

template <class Real>
inline void store(double* to, const Real& x) {
  std::memcpy(to, &x, sizeof x);
}

/// A pack with the same number in every lane.
template <class Real>
inline Real all(double x) {
  return x - Real{};
}

template <class Real>
inline Real absolute(const Real& x) {
  using Whole = std::conditional_t<lanes<Real> == 1, std::int64_t, Bits>;
  return same_bits<Real>(same_bits<Whole>(x) & INT64_MAX);
}

inline Pack sine_near_zero(const Pack& r, const Pack& z) {
  const Pack s = -0x1.5555555555549p-3 +
                 z * (0x1.111111110f880p-7 +
                      z * (-0x1.a01a019c1268dp-13 +
                           z * (0x1.71de357872cbcp-19 +
                                z * (-0x1.ae5e66d3d2178p-26 + z * 0x1.5d932f01bdad1p-33))));
  return r + (r * z) * s;
}

/// Computes cos r - (1 - z/2).
inline Pack cosine_rest(const Pack& z) {
  const Pack c = 0x1.555555555554cp-5 +
                 z * (-0x1.6c16c16c15184p-10 +
                      z * (0x1.a01a019cb2709p-16 +
                           z * (-0x1.27e4f80a773c2p-22 +
                                z * (0x1.1ee9ec482f745p-29 + z * -0x1.8faecf654ba97p-37))));
  return (z * z) * c;
}

/// Sine and cosine for |x| <= pi/4.
inline void sincos_near_zero(const Pack& x, Pack& sine, Pack& cosine) {
  const Pack z = x * x;
  const Pack half = 0.5 * z;
  const Pack most = 1.0 - half;
  sine = sine_near_zero(x, z);
  cosine = most + (((1.0 - most) - half) + cosine_rest(z));
}

/// Sine and cosine for |x| <= 1600.
inline void sincos_reduced(const Pack& x, Pack& sine, Pack& cosine) {
  constexpr double round = 0x1.8p52;  // adding it leaves the nearest whole number in the low bits
  const Pack shifted = x * 0x1.45f306dc9c883p-1 + round;
  const Pack k = shifted - round;
  const Pack first = x - k * 0x1.921fb54442c00p+0;
  const Pack second = k * 0x1.18469898cc400p-44;
  const Pack r = first - second;
  const Pack rest = ((first - r) - second) - k * 0x1.1701b839a2520p-88;  // r + rest is exact
  const Pack z = r * r;
  const Pack half = 0.5 * z;
  const Pack most = 1.0 - half;
  const Pack s = r + ((sine_near_zero(r, z) - r) + rest * most);
  const Pack c = most + (((1.0 - most) - half) + (cosine_rest(z) - r * rest));
  const Bits quadrant = same_bits<Bits>(shifted);
  const Bits odd = -(quadrant & 1);
  const Bits sine_bits = same_bits<Bits>(s), cosine_bits = same_bits<Bits>(c);
  const Bits differ = (sine_bits ^ cosine_bits) & odd;
  constexpr std::int64_t sign = INT64_MIN;
  sine = same_bits<Pack>(sine_bits ^ differ ^ ((quadrant << 62) & sign));
  cosine = same_bits<Pack>(cosine_bits ^ differ ^ (((quadrant + 1) << 62) & sign));
}

/// Sine and cosine of `count` numbers. The arrays have room for whole packs; sine may be x itself.
inline void sincos(const double* x, Count count, double* sine, double* cosine) {
  Pack most{};
  for (Count i = 0; i < count; i += width) {
    const Pack size = absolute(load<Pack>(x + i));
    most = size > most ? size : most;
  }
  double sizes[width], largest = 0.0;
  store(sizes, most);
  for (const double size : sizes) largest = size > largest ? size : largest;

  if (largest <= 0.785) {
    for (Count i = 0; i < count; i += width) {
      Pack s, c;
      sincos_near_zero(load<Pack>(x + i), s, c);
      store(sine + i, s);
      store(cosine + i, c);
    }
    return;
  }
  constexpr double bound = 1600.0;
  for (Count i = 0; i < count; i += width) {
    const Pack at = load<Pack>(x + i);
    Pack s, c;
    sincos_reduced(at, s, c);
    store(sine + i, s);
    store(cosine + i, c);
    if (!(largest > bound)) continue;
    double each[width];
    store(each, at);
    for (Count lane = 0; lane < width && i + lane < count; ++lane) {
      if (std::fabs(each[lane]) <= bound) continue;
      sine[i + lane] = std::sin(each[lane]);
      cosine[i + lane] = std::cos(each[lane]);
    }
  }
}

}  // namespace
