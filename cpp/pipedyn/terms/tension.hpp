// SPDX-License-Identifier: MIT
//
// A dead load at the free end: the force F acts along y, the direction of the straight pipe,
// however the pipe moves; its potential is -F (y - 1).
#pragma once

#include "pipedyn/terms/station.hpp"
#include "pipedyn/terms/term.hpp"

namespace {

struct Tension : NoLaw {
  static constexpr const char* name = "tension";
  double force;

  explicit Tension(const pipedyn::Term& term) : force(term.numbers[0]) {}
  auto load(const auto&) const { return Load(none, force); }
  template <class Real>
  Real energy(const Station<Real>& at) const {
    return force * (1.0 - at.y);
  }
  template <class Number>
  SpatialLoad<Number> load_in_space(const SpatialStation<Number>&) const {
    return {{Number{}, constant<Number>(force), Number{}}};
  }
  template <class Number>
  Number energy_in_space(const SpatialStation<Number>& at) const {
    return force * (1.0 - at.r.y);
  }
};

}  // namespace
