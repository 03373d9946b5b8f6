// SPDX-License-Identifier: MIT
//
// A mass m without extent at one place of the pipe: kinetic energy m |v|^2 / 2, weight m gamma.
#pragma once

#include "pipedyn/terms/station.hpp"
#include "pipedyn/terms/term.hpp"

namespace {

struct PointMass : NoLaw {
  static constexpr const char* name = "point_mass";
  double m;

  explicit PointMass(const pipedyn::Term& term) : m(term.numbers[0]) {}
  double mass() const { return m; }
};

}  // namespace
