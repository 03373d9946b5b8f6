// SPDX-License-Identifier: MIT
//
// Viscosity of a fluid at rest around the pipe: force -c v_n n per length against the velocity
// v_n = v . n normal to the pipe, n = (cos theta, -sin theta), which takes the power c v_n^2.
#pragma once

#include "pipedyn/terms/station.hpp"
#include "pipedyn/terms/term.hpp"

namespace {

struct Viscosity : NoLaw {
  static constexpr const char* name = "viscosity";
  static constexpr bool along = true;
  static constexpr bool loads = true;
  double c;

  explicit Viscosity(const pipedyn::Term& term) : c(term.numbers[0]) {}
  template <class Real>
  static Real normal(const Station<Real>& at) {
    return at.cosine * at.vx - at.sine * at.vy;
  }
  template <class Real>
  Load<Real> load(const Station<Real>& at) const {
    const Real force = -c * normal(at);
    return {force * at.cosine, -(force * at.sine)};
  }
  template <class Real>
  Slopes<Real> slopes(const Station<Real>& at) const {
    const Real s = at.sine, k = at.cosine;
    const Real across = c * normal(at), forward = c * (s * at.vx + k * at.vy);
    return {.by_velocity = {{-c * k * k, c * k * s}, {c * k * s, -c * s * s}},
            .by_angle = {across * s + forward * k, across * k - forward * s}};
  }
  template <class Real>
  Real power(const Station<Real>& at) const {
    const Real speed = normal(at);
    return -c * (speed * speed);
  }
};

}  // namespace
