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
  double c;

  explicit Viscosity(const pipedyn::Term& term) : c(term.numbers[0]) {}
  static auto normal(const auto& at) { return at.cosine * at.vx - at.sine * at.vy; }
  auto load(const auto& at) const {
    const auto force = -c * normal(at);
    return Load(force * at.cosine, -(force * at.sine));
  }
  template <class Real>
  Real power(const Station<Real>& at) const {
    const Real speed = normal(at);
    return -c * (speed * speed);
  }
  template <class Number>
  SpatialLoad<Number> load_in_space(const SpatialStation<Number>& at) const {
    return {-c * (at.v - dot(at.v, at.t) * at.t)};
  }
  template <class Number>
  Number power_in_space(const SpatialStation<Number>& at) const {
    const Number along = dot(at.v, at.t);
    return -c * (dot(at.v, at.v) - along * along);
  }
};

}  // namespace
