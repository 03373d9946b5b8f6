// SPDX-License-Identifier: MIT
//
// Numbers that carry derivatives through a formula: forward differentiation (Griewank and Walther
// 2008, Evaluating Derivatives, ch. 3). The type of a number says on which variables it depends, so
// that derivatives that are zero are neither computed nor stored, and so that code can ask at
// compile time on which variables the result of a formula depends.
//
// Local to each translation unit, like vector/pack.hpp.
#pragma once

#include <cmath>
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

// --------------------------------------------------- functions of numbers with one derivative or
// none

/// What numbers with and without a derivative need to be told apart by.
template <class Real>
struct NumberTraits {
  using Plain = Real;
  static const Plain& value(const Real& x) { return x; }
  static Real of(const Plain& value) { return value; }
  static Real with(const Plain& value, const Plain&, const Real&) { return value; }
  /// Lane by lane one number where x is above a limit, elsewhere the other.
  static Real where_above(const Real& x, double limit, const Real& one, const Real& other) {
    return x > limit ? one : other;
  }
};
template <class Real>
struct NumberTraits<Dual<Real, 1u>> {
  using Plain = Real;
  static const Plain& value(const Dual<Real, 1u>& x) { return x.value; }
  static Dual<Real, 1u> of(const Plain& value) { return {value, {Real{}}}; }
  /// A function of x, with its value and its derivative at x.
  static Dual<Real, 1u> with(const Plain& value, const Plain& slope, const Dual<Real, 1u>& x) {
    return {value, {slope * x.slopes[0]}};
  }
  static Dual<Real, 1u> where_above(const Dual<Real, 1u>& x, double limit,
                                    const Dual<Real, 1u>& one, const Dual<Real, 1u>& other) {
    return {x.value > limit ? one.value : other.value,
            {x.value > limit ? one.slopes[0] : other.slopes[0]}};
  }
};

template <class Number>
inline Number constant(double x) {
  using Traits = NumberTraits<Number>;
  return Traits::of(all<typename Traits::Plain>(x));
}

template <class Number>
inline Number inverse_of(const Number& x) {
  using Traits = NumberTraits<Number>;
  const auto share = 1.0 / Traits::value(x);
  return Traits::with(share, -(share * share), x);
}

/// Calls compute(lane) for each lane, where it sets the lanes of `count` packs.
template <class Real, std::size_t count, class Compute>
inline void lane_by_lane(Real (&packs)[count], const Compute& compute) {
  double each[count][lanes<Real>];
  for (std::size_t i = 0; i < count; ++i) store(each[i], packs[i]);
  for (Count lane = 0; lane < lanes<Real>; ++lane) {
    double one[count];
    for (std::size_t i = 0; i < count; ++i) one[i] = each[i][lane];
    compute(one);
    for (std::size_t i = 0; i < count; ++i) each[i][lane] = one[i];
  }
  for (std::size_t i = 0; i < count; ++i) packs[i] = load<Real>(each[i]);
}

/// Whether any lane is above a limit, or is not a number.
template <class Real>
inline bool any_beyond(const Real& x, double limit) {
  if constexpr (lanes<Real> == 1) {
    return !(x <= limit);
  } else {
    const Bits inside = x <= limit;
    std::int64_t each[width], all = -1;
    std::memcpy(each, &inside, sizeof inside);
    for (const std::int64_t one : each) all &= one;
    return all == 0;
  }
}

/// sqrt(x); its derivative is 0 where x is 0.
template <class Number>
inline Number root_of(const Number& x) {
  using Traits = NumberTraits<Number>;
  typename Traits::Plain packs[2] = {Traits::value(x), {}};
  lane_by_lane(packs, [](double (&of)[2]) {
    of[0] = std::sqrt(of[0]);
    of[1] = of[0] > 0.0 ? 0.5 / of[0] : 0.0;
  });
  return Traits::with(packs[0], packs[1], x);
}

/// sin(x) and cos(x).
template <class Number>
inline std::pair<Number, Number> sincos_of(const Number& x) {
  using Traits = NumberTraits<Number>;
  typename Traits::Plain packs[2] = {Traits::value(x), {}};
  lane_by_lane(packs, [](double (&of)[2]) {
    of[1] = std::cos(of[0]);
    of[0] = std::sin(of[0]);
  });
  return {Traits::with(packs[0], packs[1], x), Traits::with(packs[1], -packs[0], x)};
}

/// Value of the polynomial with these coefficients, the constant first. Even and odd powers are
/// summed side by side, in half of the time that one sum takes.
template <class Number, std::size_t count>
inline Number polynomial(const double (&coefficients)[count], const Number& x) {
  constexpr std::size_t odd = count - 1 - count % 2, even = count - 2 + count % 2;
  const Number square = x * x;
  Number of_even = coefficients[even] * square + coefficients[even - 2];
  Number of_odd = coefficients[odd] * square + coefficients[odd - 2];
  for (std::size_t i = even - 2; i > 0;) of_even = of_even * square + coefficients[i -= 2];
  for (std::size_t i = odd - 2; i > 1;) of_odd = of_odd * square + coefficients[i -= 2];
  return of_even + of_odd * x;
}

}  // namespace
