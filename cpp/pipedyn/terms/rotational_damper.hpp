// SPDX-License-Identifier: MIT
//
// A rotational dashpot between one place of the pipe and the ground: the couple -c theta' opposes
// the rate theta' at which the tangent turns there and dissipates the power c theta'^2.
#pragma once

#include "pipedyn/terms/station.hpp"
#include "pipedyn/terms/term.hpp"

namespace {

struct RotationalDamper : NoLaw {
  static constexpr const char* name = "rotational_damper";
  double c;

  explicit RotationalDamper(const pipedyn::Term& term) : c(term.numbers[0]) {}
  auto load(const auto& at) const { return Load(none, none, -c * at.omega); }
  template <class Real>
  Real power(const Station<Real>& at) const {
    return -c * (at.omega * at.omega);
  }
  template <class Number>
  SpatialLoad<Number> load_in_space(const SpatialStation<Number>& at) const {
    return {Space<Number>{}, -c * at.w};
  }
  template <class Number>
  Number power_in_space(const SpatialStation<Number>& at) const {
    return -c * dot(at.w, at.w);
  }
};

}  // namespace
