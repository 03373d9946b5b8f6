// SPDX-License-Identifier: MIT
//
// A follower force F at one place of the pipe: it pushes against the tangent there, towards the
// clamp, and turns with it. It has no potential; its power is -F t . v.
#pragma once

#include "pipedyn/terms/station.hpp"
#include "pipedyn/terms/term.hpp"

namespace {

struct FollowerForce : NoLaw {
  static constexpr const char* name = "follower_force";
  static constexpr bool has_potential = false;
  double force;

  explicit FollowerForce(const pipedyn::Term& term) : force(term.numbers[0]) {}
  auto load(const auto& at) const { return Load(-force * at.sine, -force * at.cosine); }
  template <class Number>
  SpatialLoad<Number> load_in_space(const SpatialStation<Number>& at) const {
    return {-force * at.t};
  }
};

}  // namespace
