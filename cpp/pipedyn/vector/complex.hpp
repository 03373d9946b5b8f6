// SPDX-License-Identifier: MIT
//
// Complex numbers, one in each lane of a vector.
//
// The file is local to each translation unit, like pack.hpp.
#pragma once

#include "pipedyn/vector/pack.hpp"

namespace {

template <class Real>
struct ComplexLanes {
  Real re{}, im{};

  friend ComplexLanes operator+(const ComplexLanes& a, const ComplexLanes& b) {
    return {a.re + b.re, a.im + b.im};
  }
  friend ComplexLanes operator-(const ComplexLanes& a, const ComplexLanes& b) {
    return {a.re - b.re, a.im - b.im};
  }
  friend ComplexLanes operator*(const ComplexLanes& a, const ComplexLanes& b) {
    return {a.re * b.re - a.im * b.im, a.re * b.im + a.im * b.re};
  }
  template <class Scalar>  // a double or a Real
    requires(!std::is_same_v<Scalar, ComplexLanes>)
  friend ComplexLanes operator*(const Scalar& a, const ComplexLanes& b) {
    return {a * b.re, a * b.im};
  }
  friend ComplexLanes operator+(const ComplexLanes& a, double b) { return {a.re + b, a.im}; }
};

template <class Real>
inline ComplexLanes<Real> inverse(const ComplexLanes<Real>& a) {
  const Real share = 1.0 / (a.re * a.re + a.im * a.im);
  return {a.re * share, -a.im * share};
}

}  // namespace
