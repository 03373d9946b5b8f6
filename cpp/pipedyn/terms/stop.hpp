// SPDX-License-Identifier: MIT
//
// A pair of elastic stops beside one place of the pipe, at the distance g of its axis to either
// side: force -k (x - g) along x beyond one, -k (x + g) beyond the other, none between; energy
// k (|x| - g)^2 / 2 beyond. The force is continuous, its slope jumps where the pipe meets a stop.
#pragma once

#include "pipedyn/terms/station.hpp"
#include "pipedyn/terms/term.hpp"

namespace {

struct Stop : NoLaw {
  static constexpr const char* name = "stop";
  double gap, k;

  explicit Stop(const pipedyn::Term& term) : gap(term.numbers[0]), k(term.numbers[1]) {}
  /// Twice what x is beyond g, 0 before it; without a branch, so that packs may take it.
  static auto twice_beyond(const auto& x, double g) {
    const auto apart = x - g;
    return apart + absolute(apart);
  }
  auto load(const auto& at) const {
    return Load((0.5 * k) * (twice_beyond(-at.x, gap) - twice_beyond(at.x, gap)), none);
  }
  template <class Real>
  Real energy(const Station<Real>& at) const {
    const Real pressed = twice_beyond(absolute(at.x), gap);
    return 0.125 * k * (pressed * pressed);
  }
};

}  // namespace
