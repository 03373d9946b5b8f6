// SPDX-License-Identifier: MIT
//
// A dashpot between one place of the pipe and the ground, across the pipe: the force -c x' along x
// alone dissipates the power c x'^2. In space it has a coefficient along x and one along z.
#pragma once

#include "pipedyn/terms/station.hpp"
#include "pipedyn/terms/term.hpp"

namespace {

struct Damper : NoLaw {
  static constexpr const char* name = "damper";
  static constexpr bool has_potential = false;
  double c, c_z;

  explicit Damper(const pipedyn::Term& term) : c(term.numbers[0]), c_z(term.numbers[1]) {}
  auto load(const auto& at) const { return Load(-c * at.vx, none); }
  template <class Number>
  SpatialLoad<Number> load_in_space(const SpatialStation<Number>& at) const {
    return {off_axis(at.v, -c, -c_z)};
  }
};

}  // namespace
