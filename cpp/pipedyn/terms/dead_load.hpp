// SPDX-License-Identifier: MIT
//
// A dead load: a force (P_x, P_y) that keeps its size and direction however the pipe moves. Its
// potential is -P . (r - (0, s)), with the position r of its place and the arc length s.
#pragma once

#include "pipedyn/terms/station.hpp"
#include "pipedyn/terms/term.hpp"

namespace {

struct DeadLoad : NoLaw {
  static constexpr const char* name = "dead_load";
  double across, down, at;

  explicit DeadLoad(const pipedyn::Term& term)
      : across(term.numbers[0]), down(term.numbers[1]), at(term.at) {}
  auto load(const auto&) const { return Load(across, down); }
  template <class Real>
  Real energy(const Station<Real>& place) const {
    return down * (at - place.y) - across * place.x;
  }
  template <class Number>
  SpatialLoad<Number> load_in_space(const SpatialStation<Number>&) const {
    return {in_plane<Number>({across, down})};
  }
  template <class Number>
  Number energy_in_space(const SpatialStation<Number>& place) const {
    return down * (at - place.r.y) - across * place.r.x;
  }
};

/// A dead load per length, all along the pipe.
struct DistributedLoad : DeadLoad {
  static constexpr const char* name = "distributed_load";
  static constexpr bool along = true;
  using DeadLoad::DeadLoad;
};

}  // namespace
