// SPDX-License-Identifier: MIT
//
// A spring between one place of the pipe and the axis that hardens with the cube of its extension:
// force -k x^3 along x alone, energy k x^4 / 4.
#pragma once

#include "pipedyn/terms/station.hpp"
#include "pipedyn/terms/term.hpp"

namespace {

struct CubicSpring : NoLaw {
  static constexpr const char* name = "cubic_spring";
  double k;

  explicit CubicSpring(const pipedyn::Term& term) : k(term.numbers[0]) {}
  auto load(const auto& at) const { return Load(-k * (at.x * at.x * at.x), none); }
  template <class Real>
  Real energy(const Station<Real>& at) const {
    const Real square = at.x * at.x;
    return 0.25 * k * (square * square);
  }
  template <class Number>
  SpatialLoad<Number> load_in_space(const SpatialStation<Number>& at) const {
    const Space<Number> apart = off_axis(at.r);
    return {(-k * dot(apart, apart)) * apart};
  }
  template <class Number>
  Number energy_in_space(const SpatialStation<Number>& at) const {
    const Space<Number> apart = off_axis(at.r);
    const Number square = dot(apart, apart);
    return 0.25 * k * (square * square);
  }
};

}  // namespace
