// SPDX-License-Identifier: MIT
//
// A fluid that flows along the outside of the pipe, from the clamp to the end, in small motions
// about the straight pipe: the slender-body theory of the fluid's inertia and the friction of
// Taylor, as Paidoussis uses them. With the displacement w, u = V_o L sqrt(C_m rho A / EI),
// b = sqrt(chi), u_1 = u / sqrt(C_m) and b_1 = b / sqrt(C_m), the fluid adds to the equation of
// the pipe
//
//   chi w.. + 2 b u w.' + [u^2 - u_1^2 (e_T (1 - s) + c_b / 2)] w'' + e_N u_1 (u_1 w' + b_1 w.),
//
// and at an end that may move
//
//   -w''' - f u (u w' + b w.) + x_e (1 + f chi) w.. = 0.
//
// Multiplied by a virtual displacement and integrated by parts, u^2 w'' is a force -u^2 at the end
// that follows the tangent, like the thrust of a flow inside, and tensions are forces along the
// tangent, of friction all along and of the drag on the base at the end. The friction across the
// pipe, the force of Coriolis and the lift f u (u w' + b w.) at the end act across it.
#pragma once

#include <cmath>

#include "pipedyn/terms/station.hpp"
#include "pipedyn/terms/term.hpp"

namespace {

struct ExternalFlow : NoLaw {
  static constexpr const char* name = "external_flow";
  static constexpr bool along = true;
  static constexpr bool moves = false;
  double chi;                       // added mass per length
  double square;                    // u^2
  double coriolis;                  // b u
  double normal, tangential, base;  // e_N u_1^2, e_T u_1^2, c_b u_1^2 / 2
  double resistance;                // e_N u_1 b_1
  double shape, tail;               // f, x_e
  double turns;                     // 1; 0 at an end that keeps its direction

  /// Numbers: u, chi, e_N, e_T, c_b, f, x_e, C_m, whether the end turns.
  explicit ExternalFlow(const pipedyn::Term& term)
      : chi(term.numbers[1]),
        square(term.numbers[0] * term.numbers[0]),
        coriolis(term.numbers[0] * std::sqrt(chi)),
        normal(term.numbers[2] * square / term.numbers[7]),
        tangential(term.numbers[3] * square / term.numbers[7]),
        base(0.5 * term.numbers[4] * square / term.numbers[7]),
        resistance(term.numbers[2] * coriolis / term.numbers[7]),
        shape(term.numbers[5]),
        tail(term.numbers[6]),
        turns(term.numbers[8]) {}
  double normal_mass() const { return chi; }
  auto load(const auto& at) const {
    return Load((tangential - normal) * at.theta - 2.0 * coriolis * at.omega - resistance * at.vx,
                tangential);
  }
};

/// What the same fluid does at the end of the pipe. The inertia of a tapered end has no weight.
struct ExternalFlowEnd : ExternalFlow {
  static constexpr const char* name = "external_flow_end";
  static constexpr bool along = false;
  using ExternalFlow::ExternalFlow;

  double normal_mass() const { return 0.0; }
  double mass() const { return tail * (1.0 + shape * chi); }
  double weightless() const { return mass(); }
  auto load(const auto& at) const {
    const double pull = base - square;
    return Load(turns * (pull + shape * square) * at.theta + shape * coriolis * at.vx, pull);
  }
};

}  // namespace
