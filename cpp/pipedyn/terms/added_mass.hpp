// SPDX-License-Identifier: MIT
//
// Added mass of a dense fluid at rest around the pipe: its kinetic energy is chi v_n^2 / 2 per
// length, with the velocity v_n = v . n normal to the pipe, n = (cos theta, -sin theta). With v_t =
// v . t, its virtual work per length is
//   chi { [n . a - theta' v_t] n . dr - theta' v_n t . dr + v_n v_t dtheta },
// which has, besides the acceleration a, a load and a couple. The fluid has no weight of its own:
// its buoyancy is part of gamma. In space, with P = 1 - t t^T and v_n = P v, the virtual work is
//   chi { [P a - v_t t' - (t' . v_n) t] . dr + v_t v_n . dt }.
#pragma once

#include "pipedyn/terms/station.hpp"
#include "pipedyn/terms/term.hpp"

namespace {

struct AddedMass : NoLaw {
  static constexpr const char* name = "added_mass";
  static constexpr bool along = true;
  double chi;

  explicit AddedMass(const pipedyn::Term& term) : chi(term.numbers[0]) {}
  double normal_mass() const { return chi; }
  auto load(const auto& at) const {
    const auto normal = at.cosine * at.vx - at.sine * at.vy;
    const auto forward = at.sine * at.vx + at.cosine * at.vy;
    const auto swing = chi * at.omega;
    return Load(swing * (forward * at.cosine + normal * at.sine),
                swing * (normal * at.cosine - forward * at.sine), -chi * (normal * forward));
  }
  template <class Number>
  SpatialLoad<Number> load_in_space(const SpatialStation<Number>& at) const {
    const Number forward = chi * dot(at.v, at.t);
    return {forward * at.rate + (chi * dot(at.v, at.rate)) * at.t,
            -1.0 * (forward * Across<Number>{dot(at.nx, at.v), dot(at.nz, at.v)})};
  }
};

}  // namespace
