// SPDX-License-Identifier: MIT
//
// A body of mass m and rotary inertia J with its centre at one place of the pipe: its kinetic
// energy is m |v|^2 / 2 + J theta'^2 / 2, its weight m gamma.
#pragma once

#include "pipedyn/terms/station.hpp"
#include "pipedyn/terms/term.hpp"

namespace {

struct PointMass : NoLaw {
  static constexpr const char* name = "point_mass";
  double m, turned;

  explicit PointMass(const pipedyn::Term& term) : m(term.numbers[0]), turned(term.numbers[1]) {}
  double mass() const { return m; }
  double inertia() const { return turned; }
};

}  // namespace
