// SPDX-License-Identifier: MIT
//
// A rotational spring between one place of the pipe and the ground: the couple -k theta opposes the
// angle theta of the tangent there; the energy is k theta^2 / 2. The law is linear at any
// amplitude. In space the energy is (k a_x^2 + k_z a_z^2) / 2 of the rotation vector a.
#pragma once

#include "pipedyn/terms/station.hpp"
#include "pipedyn/terms/term.hpp"

namespace {

struct RotationalSpring : NoLaw {
  static constexpr const char* name = "rotational_spring";
  static constexpr bool reads_rotation = true;
  double k, k_z;

  explicit RotationalSpring(const pipedyn::Term& term) : k(term.numbers[0]), k_z(term.numbers[1]) {}
  auto load(const auto& at) const { return Load(none, none, -k * at.theta); }
  template <class Real>
  Real energy(const Station<Real>& at) const {
    return 0.5 * k * (at.theta * at.theta);
  }
  template <class Number>
  SpatialLoad<Number> load_in_space(const SpatialStation<Number>& at) const {
    const Across<Number> pull{-k * at.a.x, -k_z * at.a.z}, aside = at.a.turned();
    if (k == k_z) return {Space<Number>{}, pull};
    // A change of a moves the tangent by R of it; R^-1 = I + (E / S) a~ a~^T.
    return {Space<Number>{}, pull + (at.e * inverse_of(at.s) * dot(aside, pull)) * aside};
  }
  template <class Number>
  Number energy_in_space(const SpatialStation<Number>& at) const {
    return 0.5 * (k * (at.a.x * at.a.x) + k_z * (at.a.z * at.a.z));
  }
};

}  // namespace
