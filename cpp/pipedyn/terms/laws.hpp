// SPDX-License-Identifier: MIT
//
// The table of the laws: to add a law, write a header and add a row here. Local to each translation
// unit, like vector/pack.hpp.
#pragma once

#include "pipedyn/terms/added_mass.hpp"
#include "pipedyn/terms/applied_force.hpp"
#include "pipedyn/terms/cubic_spring.hpp"
#include "pipedyn/terms/damper.hpp"
#include "pipedyn/terms/dead_load.hpp"
#include "pipedyn/terms/external_flow.hpp"
#include "pipedyn/terms/follower_force.hpp"
#include "pipedyn/terms/foundation.hpp"
#include "pipedyn/terms/point_mass.hpp"
#include "pipedyn/terms/rotational_damper.hpp"
#include "pipedyn/terms/rotational_spring.hpp"
#include "pipedyn/terms/spring.hpp"
#include "pipedyn/terms/stop.hpp"
#include "pipedyn/terms/stretching.hpp"
#include "pipedyn/terms/viscosity.hpp"

namespace {

template <class... Rows>
struct LawTable {
  /// Calls body with the law of a term.
  template <class Body>
  static void with(const pipedyn::Term& term, const Body& body) {
    int row = 0;
    static_cast<void>(((row++ == term.law ? (body(Rows(term)), true) : false) || ...));
  }

  static constexpr const char* names[] = {Rows::name...};
};

using Laws = LawTable<PointMass,         //
                      Spring,            //
                      Damper,            //
                      Foundation,        //
                      Viscosity,         //
                      CubicSpring,       //
                      Stop,              //
                      AddedMass,         //
                      DeadLoad,          //
                      Stretching,        //
                      RotationalSpring,  //
                      RotationalDamper,  //
                      DistributedLoad,   //
                      FollowerForce,     //
                      ExternalFlow,      //
                      ExternalFlowEnd,   //
                      AppliedForce,      //
                      AppliedLoad>;

}  // namespace
