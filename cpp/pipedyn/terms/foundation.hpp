// SPDX-License-Identifier: MIT
//
// An elastic foundation all along the pipe (Winkler): force -k x per length along x alone, energy
// k x^2 / 2 per length.
#pragma once

#include "pipedyn/terms/station.hpp"
#include "pipedyn/terms/term.hpp"

namespace {

struct Foundation : NoLaw {
  static constexpr const char* name = "foundation";
  static constexpr bool along = true;
  static constexpr bool loads = true;
  double k;

  explicit Foundation(const pipedyn::Term& term) : k(term.numbers[0]) {}
  template <class Real>
  Load<Real> load(const Station<Real>& at) const {
    return {-k * at.x, Real{}};
  }
  Slopes slopes(const Station<double>&) const { return {.by_position = {{-k, 0.0}, {0.0, 0.0}}}; }
  template <class Real>
  Real energy(const Station<Real>& at) const {
    return 0.5 * k * (at.x * at.x);
  }
};

}  // namespace
