// SPDX-License-Identifier: MIT
//
// A spring between one place of the pipe and the axis that hardens with the cube of its extension:
// force -k x^3 along x alone, energy k x^4 / 4. In space, with k along x and k_z along z, the
// energy is (sqrt(k) x^2 + sqrt(k_z) z^2)^2 / 4, which is k r^4 / 4 of the distance r if both are
// equal.
#pragma once

#include <cmath>

#include "pipedyn/terms/station.hpp"
#include "pipedyn/terms/term.hpp"

namespace {

struct CubicSpring : NoLaw {
  static constexpr const char* name = "cubic_spring";
  double k, k_z;

  explicit CubicSpring(const pipedyn::Term& term) : k(term.numbers[0]), k_z(term.numbers[1]) {}
  auto load(const auto& at) const { return Load(-k * (at.x * at.x * at.x), none); }
  template <class Real>
  Real energy(const Station<Real>& at) const {
    const Real square = at.x * at.x;
    return 0.25 * k * (square * square);
  }
  template <class Number>
  SpatialLoad<Number> load_in_space(const SpatialStation<Number>& at) const {
    const Space<Number> pull = rooted(at.r);
    return {-dot(pull, at.r) * pull};
  }
  template <class Number>
  Number energy_in_space(const SpatialStation<Number>& at) const {
    const Number square = dot(rooted(at.r), at.r);
    return 0.25 * (square * square);
  }

 private:
  template <class Number>
  Space<Number> rooted(const Space<Number>& r) const {
    return off_axis(r, std::sqrt(k), std::sqrt(k_z));
  }
};

}  // namespace
