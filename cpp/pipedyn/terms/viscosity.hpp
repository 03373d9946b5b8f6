// SPDX-License-Identifier: MIT
//
// Viscosity of a fluid at rest around the pipe: the force -c v_n n per length opposes the velocity
// v_n = v . n normal to the pipe, n = (cos theta, -sin theta), and dissipates the power c v_n^2.
#pragma once

#include "pipedyn/terms/station.hpp"
#include "pipedyn/terms/term.hpp"

namespace {

struct Viscosity : NoLaw {
  static constexpr const char* name = "viscosity";
  static constexpr bool along = true;
  static constexpr bool has_potential = false;
  double c;

  explicit Viscosity(const pipedyn::Term& term) : c(term.numbers[0]) {}
  auto load(const auto& at) const {
    const auto force = -c * (at.cosine * at.vx - at.sine * at.vy);
    return Load(force * at.cosine, -(force * at.sine));
  }
  template <class Number>
  SpatialLoad<Number> load_in_space(const SpatialStation<Number>& at) const {
    return {-c * (at.v - dot(at.v, at.t) * at.t)};
  }
};

}  // namespace
