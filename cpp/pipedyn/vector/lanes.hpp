// SPDX-License-Identifier: MIT
//
// Complex numbers in the lanes of packs, alone and with a derivative, for computing with several
// values of lambda side by side.
//
// The file is local to each translation unit, like pack.hpp.
#pragma once

#include "pipedyn/vector/complex.hpp"
#include "pipedyn/vector/points.hpp"

namespace {

using Lanes = ComplexLanes<Pack>;

inline void operator+=(Lanes& a, const Lanes& b) { a = a + b; }
inline Lanes conjugate(const Lanes& a) { return {a.re, -a.im}; }
/// |Re a| + |Im a|, which lies between |a| and 1.5 |a|.
inline Pack size_of(const Lanes& a) { return absolute(a.re) + absolute(a.im); }

/// A pack of complex numbers with their derivatives.
struct DualLanes {
  Lanes value{}, slope{};
};

inline DualLanes operator+(const DualLanes& a, const DualLanes& b) {
  return {a.value + b.value, a.slope + b.slope};
}
inline DualLanes operator-(const DualLanes& a, const DualLanes& b) {
  return {a.value - b.value, a.slope - b.slope};
}
inline DualLanes operator*(const DualLanes& a, const DualLanes& b) {
  return {a.value * b.value, a.slope * b.value + a.value * b.slope};
}
inline DualLanes operator*(double a, const DualLanes& b) { return {a * b.value, a * b.slope}; }
inline DualLanes operator+(const DualLanes& a, double b) { return {a.value + b, a.slope}; }
inline DualLanes inverse(const DualLanes& a) {
  const Lanes share = inverse(a.value);
  return {share, -1.0 * (share * (share * a.slope))};
}
inline Pack size_of(const DualLanes& a) { return size_of(a.value); }

/// Values of lambda of as many points as a pack holds, from `first` on. Lanes beyond the last point
/// repeat it.
inline Lanes lanes_of(const pipedyn::Points& points, Count first) {
  double re[width], im[width];
  for (Count i = 0; i < width; ++i) {
    const Count from = first + i < points.count ? first + i : points.count - 1;
    re[i] = points.real[from];
    im[i] = points.imag[from];
  }
  return {load<Pack>(re), load<Pack>(im)};
}

inline void put(double* out, const pipedyn::Points& points, Count first, const Pack& x) {
  double each[width];
  store(each, x);
  for (Count i = 0; i < width && first + i < points.count; ++i) out[first + i] = each[i];
}
inline void put(double* out, const pipedyn::Points& points, Count first, const Lanes& x) {
  put(out, points, first, x.re);
  put(out + points.count, points, first, x.im);
}

/// |a|^2, but 1 if a is 0.
inline Pack distance(const Lanes& a) {
  const Pack square = a.re * a.re + a.im * a.im;
  return square > 0.0 ? square : all<Pack>(1.0);
}

/// Sum of 1 / (lambda - lambda_k) over the known roots, without those at lambda itself.
inline Lanes poles(const pipedyn::Points& points, const Lanes& lambda) {
  Lanes sum;
  for (Count k = 0; k < points.roots; k += 2) {  // two terms share one division
    const Count next = k + 1 < points.roots ? k + 1 : k;
    const Lanes one{lambda.re - points.root_real[k], lambda.im - points.root_imag[k]};
    const Lanes two{lambda.re - points.root_real[next], lambda.im - points.root_imag[next]};
    const Pack square = distance(one), other = distance(two);
    const Pack share = 1.0 / (square * other);
    const Pack first_share = other * share, next_share = next == k ? Pack{} : square * share;
    sum.re += one.re * first_share + two.re * next_share;
    sum.im -= one.im * first_share + two.im * next_share;
  }
  return sum;
}

}  // namespace
