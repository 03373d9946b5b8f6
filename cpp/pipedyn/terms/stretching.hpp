// SPDX-License-Identifier: MIT
//
// Stretching of a pipe whose end is fixed along the axis as well: the end slides against an axial
// spring with damping. Its force is k (1 - y) - c y' along y alone, its energy k (1 - y)^2 / 2.
// Both ends are fixed to the base.
#pragma once

#include "pipedyn/terms/station.hpp"
#include "pipedyn/terms/term.hpp"

namespace {

struct Stretching : NoLaw {
  static constexpr const char* name = "stretching";
  static constexpr bool on_base = true;
  double k, c;

  explicit Stretching(const pipedyn::Term& term) : k(term.numbers[0]), c(term.numbers[1]) {}
  auto load(const auto& at) const { return Load(none, k * (1.0 - at.y) - c * at.vy); }
  template <class Real>
  Real energy(const Station<Real>& at) const {
    return 0.5 * k * ((1.0 - at.y) * (1.0 - at.y));
  }
  template <class Real>
  Real power(const Station<Real>& at) const {
    return -c * (at.vy * at.vy);
  }
  template <class Number>
  SpatialLoad<Number> load_in_space(const SpatialStation<Number>& at) const {
    return {{Number{}, k * (1.0 - at.r.y) - c * at.v.y, Number{}}};
  }
  template <class Number>
  Number energy_in_space(const SpatialStation<Number>& at) const {
    return 0.5 * k * ((1.0 - at.r.y) * (1.0 - at.r.y));
  }
  template <class Number>
  Number power_in_space(const SpatialStation<Number>& at) const {
    return -c * (at.v.y * at.v.y);
  }
};

}  // namespace
