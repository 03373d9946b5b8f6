// SPDX-License-Identifier: MIT
//
// A rotational spring between one place of the pipe and the ground: the couple -k theta opposes the
// angle theta of the tangent there; the energy is k theta^2 / 2. The law is linear at any
// amplitude.
#pragma once

#include "pipedyn/terms/station.hpp"
#include "pipedyn/terms/term.hpp"

namespace {

struct RotationalSpring : NoLaw {
  static constexpr const char* name = "rotational_spring";
  static constexpr bool reads_rotation = true;
  double k;

  explicit RotationalSpring(const pipedyn::Term& term) : k(term.numbers[0]) {}
  auto load(const auto& at) const { return Load(none, none, -k * at.theta); }
  template <class Real>
  Real energy(const Station<Real>& at) const {
    return 0.5 * k * (at.theta * at.theta);
  }
  template <class Number>
  SpatialLoad<Number> load_in_space(const SpatialStation<Number>& at) const {
    return {Space<Number>{}, -k * at.a};
  }
  template <class Number>
  Number energy_in_space(const SpatialStation<Number>& at) const {
    return 0.5 * k * dot(at.a, at.a);
  }
};

}  // namespace
