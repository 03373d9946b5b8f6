// SPDX-License-Identifier: MIT
//
// A pair of elastic stops beside one place of the pipe, each at the distance g from its axis: the
// force along x is -k (x - g) beyond one, -k (x + g) beyond the other and 0 between them; the
// energy beyond is k (|x| - g)^2 / 2. The force is continuous, and its slope jumps where the pipe
// meets a stop.
#pragma once

#include "pipedyn/terms/station.hpp"
#include "pipedyn/terms/term.hpp"

namespace {

struct Stop : NoLaw {
  static constexpr const char* name = "stop";
  double gap, k;

  explicit Stop(const pipedyn::Term& term) : gap(term.numbers[0]), k(term.numbers[1]) {}
  /// Twice the distance by which x exceeds g, 0 where it does not; without a branch, so that it
  /// works on packs.
  static auto twice_overlap(const auto& x, double g) {
    const auto apart = x - g;
    return apart + absolute(apart);
  }
  auto load(const auto& at) const {
    return Load((0.5 * k) * (twice_overlap(-at.x, gap) - twice_overlap(at.x, gap)), none);
  }
  template <class Real>
  Real energy(const Station<Real>& at) const {
    const Real pressed = twice_overlap(absolute(at.x), gap);
    return 0.125 * k * (pressed * pressed);
  }
  template <class Number>
  SpatialLoad<Number> load_in_space(const SpatialStation<Number>& at) const {
    const Space<Number> apart = off_axis(at.r);
    const Number distance = root_of(dot(apart, apart));
    // 1e-300 only avoids 0 / 0 on the axis, where the overlap is 0.
    const Number share = inverse_of(Number(distance + 1e-300)) * twice_overlap(distance, gap);
    return {(-0.5 * k * share) * apart};
  }
  template <class Number>
  Number energy_in_space(const SpatialStation<Number>& at) const {
    const Space<Number> apart = off_axis(at.r);
    const Number pressed = twice_overlap(root_of(dot(apart, apart)), gap);
    return 0.125 * k * (pressed * pressed);
  }
};

}  // namespace
