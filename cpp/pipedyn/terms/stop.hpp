// SPDX-License-Identifier: MIT
//
// A pair of elastic stops beside one place of the pipe, each at the distance g from its axis: the
// force along x is -k (x - g) beyond one, -k (x + g) beyond the other and 0 between them; the
// energy beyond is k (|x| - g)^2 / 2. The force is continuous, and its slope jumps where the pipe
// meets a stop. In space it is a ring of radius g or, if a stiffness k_z >= 0 along z is given, a
// pair of flat stops along x and one along z.
#pragma once

#include "pipedyn/terms/station.hpp"
#include "pipedyn/terms/term.hpp"

namespace {

struct Stop : NoLaw {
  static constexpr const char* name = "stop";
  double gap, k, k_z;

  explicit Stop(const pipedyn::Term& term)
      : gap(term.numbers[0]), k(term.numbers[1]), k_z(term.numbers[2]) {}
  /// Twice the distance by which x exceeds g, 0 where it does not; without a branch, so that it
  /// works on packs.
  static auto twice_overlap(const auto& x, double g) {
    const auto apart = x - g;
    return apart + absolute(apart);
  }
  /// Force of a pair of flat stops.
  auto push(double stiffness, const auto& x) const {
    return (0.5 * stiffness) * (twice_overlap(-x, gap) - twice_overlap(x, gap));
  }
  auto load(const auto& at) const { return Load(push(k, at.x), none); }
  template <class Real>
  Real energy(const Station<Real>& at) const {
    const Real pressed = twice_overlap(absolute(at.x), gap);
    return 0.125 * k * (pressed * pressed);
  }
  template <class Number>
  SpatialLoad<Number> load_in_space(const SpatialStation<Number>& at) const {
    if (k_z >= 0.0) return {{push(k, at.r.x), Number{}, push(k_z, at.r.z)}};
    const Space<Number> apart = off_axis(at.r);
    const Number twice = twice_overlap(root_of(dot(apart, apart)), gap);
    // The divisor is the distance from the axis beyond the ring, and the gap within it, where the
    // overlap and its derivatives are 0.
    return {(-0.5 * k * (twice * inverse_of(Number(gap + 0.5 * twice)))) * apart};
  }
  template <class Number>
  Number energy_in_space(const SpatialStation<Number>& at) const {
    if (k_z >= 0.0) {
      const Number x = twice_overlap(absolute(at.r.x), gap),
                   z = twice_overlap(absolute(at.r.z), gap);
      return 0.125 * (k * (x * x) + k_z * (z * z));
    }
    const Space<Number> apart = off_axis(at.r);
    const Number pressed = twice_overlap(root_of(dot(apart, apart)), gap);
    return 0.125 * k * (pressed * pressed);
  }
};

}  // namespace
