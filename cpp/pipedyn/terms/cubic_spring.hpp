// SPDX-License-Identifier: MIT
//
// A spring to the axis at one place of the pipe that hardens with the cube of its extension: force
// -k x^3 along x alone, energy k x^4 / 4.
#pragma once

#include "pipedyn/terms/station.hpp"
#include "pipedyn/terms/term.hpp"

namespace {

struct CubicSpring : NoLaw {
  static constexpr const char* name = "cubic_spring";
  static constexpr bool loads = true;
  double k;

  explicit CubicSpring(const pipedyn::Term& term) : k(term.numbers[0]) {}
  template <class Real>
  Load<Real> load(const Station<Real>& at) const {
    return {-k * (at.x * at.x * at.x), Real{}};
  }
  template <class Real>
  Slopes<Real> slopes(const Station<Real>& at) const {
    return {.by_position = {{-3.0 * k * at.x * at.x, Real{}}, {Real{}, Real{}}}};
  }
  template <class Real>
  Real energy(const Station<Real>& at) const {
    const Real square = at.x * at.x;
    return 0.25 * k * (square * square);
  }
};

}  // namespace
