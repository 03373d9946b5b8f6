// SPDX-License-Identifier: MIT
//
// A spring between one place of the pipe and the axis: force -k x along x alone, energy k x^2 / 2.
// The law is linear at any amplitude and independent of the motion of the place along the axis. In
// space the force has a stiffness along x and one along z.
#pragma once

#include "pipedyn/terms/station.hpp"
#include "pipedyn/terms/term.hpp"

namespace {

struct Spring : NoLaw {
  static constexpr const char* name = "spring";
  double k, k_z;

  explicit Spring(const pipedyn::Term& term) : k(term.numbers[0]), k_z(term.numbers[1]) {}
  auto load(const auto& at) const { return Load(-k * at.x, none); }
  template <class Real>
  Real energy(const Station<Real>& at) const {
    return 0.5 * k * (at.x * at.x);
  }
  template <class Number>
  SpatialLoad<Number> load_in_space(const SpatialStation<Number>& at) const {
    return {off_axis(at.r, -k, -k_z)};
  }
  template <class Number>
  Number energy_in_space(const SpatialStation<Number>& at) const {
    return 0.5 * dot(off_axis(at.r, k, k_z), at.r);
  }
};

}  // namespace
