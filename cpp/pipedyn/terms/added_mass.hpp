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
};

}  // namespace
