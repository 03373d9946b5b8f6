// SPDX-License-Identifier: MIT
//
// A rotational dashpot between one place of the pipe and the ground: the couple -c theta' opposes
// the rate theta' at which the tangent turns there and dissipates the power c theta'^2.
// In space it resists the angular velocity W = t x t' with c about z, which is that of motions
// along x, with c_z about x and their mean about y; if both are equal, the couple is -c t'.
#pragma once

#include "pipedyn/terms/station.hpp"
#include "pipedyn/terms/term.hpp"

namespace {

struct RotationalDamper : NoLaw {
  static constexpr const char* name = "rotational_damper";
  static constexpr bool has_potential = false;
  double c, c_z;

  explicit RotationalDamper(const pipedyn::Term& term) : c(term.numbers[0]), c_z(term.numbers[1]) {}
  auto load(const auto& at) const { return Load(none, none, -c * at.omega); }
  template <class Number>
  SpatialLoad<Number> load_in_space(const SpatialStation<Number>& at) const {
    if (c == c_z) return {Space<Number>{}, -c * at.w};
    const Space<Number> spin = cross(at.t, at.rate);
    const Space<Number> resisted{c_z * spin.x, 0.5 * (c + c_z) * spin.y, c * spin.z};
    const Space<Number> turned = cross(at.t, resisted);
    return {Space<Number>{}, {dot(at.nx, turned), dot(at.nz, turned)}};
  }
};

}  // namespace
