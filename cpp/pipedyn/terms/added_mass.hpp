// SPDX-License-Identifier: MIT
//
// Added mass of a dense fluid at rest around the pipe: kinetic energy chi v_n^2 / 2 per length, of
// the velocity v_n = v . n normal to the pipe alone, n = (cos theta, -sin theta), with v_t = v . t,
//   chi { [n . a - theta' v_t] n . dr - theta' v_n t . dr + v_n v_t dtheta },
// beside the acceleration a a load and a couple. The fluid has no weight: what it bears is in
// gamma.
#pragma once

#include "pipedyn/terms/station.hpp"
#include "pipedyn/terms/term.hpp"

namespace {

struct AddedMass : NoLaw {
  static constexpr const char* name = "added_mass";
  static constexpr bool along = true;
  static constexpr bool loads = true;
  static constexpr bool couples = true;
  double chi;

  explicit AddedMass(const pipedyn::Term& term) : chi(term.numbers[0]) {}
  double normal_mass() const { return chi; }
  template <class Real>
  Load<Real> load(const Station<Real>& at) const {
    const Real normal = at.cosine * at.vx - at.sine * at.vy;
    const Real forward = at.sine * at.vx + at.cosine * at.vy, swing = chi * at.omega;
    return {swing * (forward * at.cosine + normal * at.sine),
            swing * (normal * at.cosine - forward * at.sine), -chi * (normal * forward)};
  }
  template <class Real>
  Slopes<Real> slopes(const Station<Real>& at) const {
    const Real s = at.sine, k = at.cosine, normal = k * at.vx - s * at.vy;
    const Real forward = s * at.vx + k * at.vy, swing = chi * at.omega;
    const Real twice = 2.0 * s * k, apart = k * k - s * s;
    const Real x = chi * (forward * k + normal * s), y = chi * (normal * k - forward * s);
    return {.by_velocity = {{swing * twice, swing * apart}, {swing * apart, -swing * twice}},
            .by_angle = {2.0 * swing * (normal * k - forward * s),
                         -2.0 * swing * (normal * s + forward * k)},
            .by_rate = {x, y},
            .couple_by_velocity = {-x, -y},
            .couple_by_angle = chi * (forward * forward - normal * normal)};
  }
};

}  // namespace
