// SPDX-License-Identifier: MIT
//
// Numbers that carry derivatives through a formula: forward differentiation (Griewank and Walther
// 2008, Evaluating Derivatives, ch. 3). The type of a number says on which variables it depends, so
// that derivatives that are zero are neither computed nor stored, and so that code can ask at
// compile time on which variables the result of a formula depends.
//
// Local to each translation unit, like vector/pack.hpp.
#pragma once

#include <type_traits>
#include <utility>

#include "pipedyn/vector/pack.hpp"

namespace {

constexpr int most_variables = 6;

/// Place of the derivative by each variable of a mask in an array of derivatives, and the number of
/// these derivatives.
struct Places {
  int of[most_variables] = {}, count = 0;

  explicit constexpr Places(unsigned mask) {
    for (int k = 0; k < most_variables; ++k) {
      of[k] = count;
      count += static_cast<int>(mask >> k & 1u);
    }
  }
};

/// A number and its derivatives by the variables whose bits are set in `mask`.
template <class Real, unsigned mask>
struct Dual {
  static constexpr Places places{mask};
  Real value;
  Real slopes[places.count];  // only by the variables of the mask

  PIPEDYN_INLINE const Real& slope(int k) const { return slopes[places.of[k]]; }
};

template <class Number>
struct DualTraits {
  static constexpr unsigned mask = 0;
};
template <class Real, unsigned by>
struct DualTraits<Dual<Real, by>> {
  static constexpr unsigned mask = by;
};
/// The variables on which numbers of a type depend, one bit each.
template <class Number>
constexpr unsigned variables_of = DualTraits<Number>::mask;

/// Calls body(k) for each variable of the mask, without a loop, so that each k is a constant.
template <unsigned mask, class Body>
PIPEDYN_INLINE inline void for_each_variable(const Body& body) {
  [&]<int... k>(std::integer_sequence<int, k...>) {
    const auto call = [&]<int variable>() {
      if constexpr ((mask >> variable & 1u) != 0) body(std::integral_constant<int, variable>());
    };
    (call.template operator()<k>(), ...);
  }(std::make_integer_sequence<int, most_variables>());
}

/// Makes a number from its value and from slope(k), which is called for each variable k of the
/// mask.
template <unsigned mask, class Real, class Slope>
PIPEDYN_INLINE inline Dual<Real, mask> dual(const Real& value, const Slope& slope) {
  Dual<Real, mask> made;
  made.value = value;
  for_each_variable<mask>([&](auto k) { made.slopes[made.places.of[k]] = slope(k); });
  return made;
}

template <class Number, class Real>
concept Constant = std::is_same_v<Number, double> || std::is_same_v<Number, Real>;

template <class Real, unsigned a>
PIPEDYN_INLINE inline auto operator-(const Dual<Real, a>& x) {
  return dual<a>(Real(-x.value), [&](auto k) { return Real(-x.slope(k)); });
}
template <class Real, unsigned a, unsigned b>
PIPEDYN_INLINE inline auto operator+(const Dual<Real, a>& x, const Dual<Real, b>& y) {
  return dual<a | b>(Real(x.value + y.value), [&](auto k) {
    if (!(b >> k & 1u)) return x.slope(k);
    return a >> k & 1u ? Real(x.slope(k) + y.slope(k)) : y.slope(k);
  });
}
template <class Real, unsigned a, unsigned b>
PIPEDYN_INLINE inline auto operator-(const Dual<Real, a>& x, const Dual<Real, b>& y) {
  return x + (-y);
}
template <class Real, unsigned a, unsigned b>
PIPEDYN_INLINE inline auto operator*(const Dual<Real, a>& x, const Dual<Real, b>& y) {
  return dual<a | b>(Real(x.value * y.value), [&](auto k) {
    if (!(b >> k & 1u)) return Real(x.slope(k) * y.value);
    const Real by_y = x.value * y.slope(k);
    return a >> k & 1u ? Real(x.slope(k) * y.value + by_y) : by_y;
  });
}
template <class Real, unsigned a, Constant<Real> Number>
PIPEDYN_INLINE inline auto operator+(const Dual<Real, a>& x, const Number& y) {
  return dual<a>(Real(x.value + y), [&](auto k) { return x.slope(k); });
}
template <class Real, unsigned a, Constant<Real> Number>
PIPEDYN_INLINE inline auto operator+(const Number& x, const Dual<Real, a>& y) {
  return y + x;
}
template <class Real, unsigned a, Constant<Real> Number>
PIPEDYN_INLINE inline auto operator-(const Dual<Real, a>& x, const Number& y) {
  return x + (-y);
}
template <class Real, unsigned a, Constant<Real> Number>
PIPEDYN_INLINE inline auto operator-(const Number& x, const Dual<Real, a>& y) {
  return x + (-y);
}
template <class Real, unsigned a, Constant<Real> Number>
PIPEDYN_INLINE inline auto operator*(const Number& x, const Dual<Real, a>& y) {
  return dual<a>(Real(x * y.value), [&](auto k) { return Real(x * y.slope(k)); });
}
template <class Real, unsigned a, Constant<Real> Number>
PIPEDYN_INLINE inline auto operator*(const Dual<Real, a>& x, const Number& y) {
  return y * x;
}
/// Absolute value; at 0 its slope is the one for negative numbers.
template <class Real, unsigned a>
PIPEDYN_INLINE inline auto absolute(const Dual<Real, a>& x) {
  return dual<a>(Real(x.value > 0.0 ? x.value : -x.value),
                 [&](auto k) { return Real(x.value > 0.0 ? x.slope(k) : -x.slope(k)); });
}

}  // namespace
