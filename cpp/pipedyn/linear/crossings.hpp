// SPDX-License-Identifier: MIT
//
// Where eigenvalues pass through the imaginary axis as the flow speed grows.
//
// Each step of a tracked sweep (tracking.hpp) gives a cubic for the real part of a branch. A step
// shows all crossings where no extremum of the cubic lies closer to the axis than the cubic's own
// error, and is halved otherwise; so a branch that touches the axis between two samples, or passes
// it twice, is found. Each crossing is then polished by Newton's method with d lambda / du on the
// model.
//
// A real part within rounding of zero has no sign: such a branch stays what it was, stable or not,
// until its real part leaves the noise.
//
// Where lambda enters only as lambda^2 (no damping, and no fluid mass), all roots lie on the
// imaginary axis, or symmetric about it: Re lambda of each would be rounding, and flutter, where
// two roots meet without a slope d lambda / du, would be refused. nu = lambda^2 is tracked in its
// place. Real nu < 0 are roots on the axis; it is left where two of them meet and turn complex
// (flutter; Beck's column) or one reaches zero (divergence).
//
// Real roots pass zero where K(u) is singular, which does not depend on velocities: these speeds
// are known before any root is followed (`Spectrum::divergences`), and each is enclosed by samples
// of its own. In every other step no real root changes its side.
//
// A loss factor acts on oscillation alone. Roots are tracked on either side of the real axis, and
// those above count for two; growing real roots are those of the pipe without it. Where a growing
// root passes the real axis, a pair appears or vanishes: a crossing of frequency 0.
//
// Of a conservative system two growing real roots may meet and become a growing pair, coupled-mode
// flutter that passes no axis: it is listed among the crossings, with a change of 0.
#pragma once

#include <optional>
#include <string>

#include "pipedyn/linear/axis_roots.hpp"
#include "pipedyn/linear/tracking.hpp"

namespace pipedyn {

/// One crossing of the imaginary axis by a root or a conjugate pair.
struct AxisCrossing {
  double speed;    // u
  Complex value;   // i times the frequency there; 0 for divergence
  int change;      // by how many the number of unstable roots grows, a pair being two; 0 where
                   // two growing real roots become a pair
  Index mode;      // branch, counted from rest by frequency, from 1
  double error;    // of the speed, absolute
  Pair pair = {};  // without vectors where two branches meet on the axis or at u = 0+
  std::optional<Forms> forms = {};  // of its vectors, where both are known
  int before = 0;                   // number of unstable roots below it
  // Whether on the side where no root grows K is indefinite: of a conservative system only
  // gyroscopic forces hold it there, and any damping undoes that.
  bool gyroscopic = false;
};

struct Sweep {
  int unstable_at_rest = 0;                  // number of roots
  std::vector<AxisCrossing> crossings = {};  // in order of speed
  std::string failure = {};  // why the crossings are not all, or do not account for unstable roots
  bool untracked = false;    // whether a root outside the tracked ones became unstable
};

/// Roots of modes that need not be tracked are not worth refining with Re < -0.3 |lambda|: with 16
/// Legendre functions they have 0.56 or more at damping 1e-3, without damping 0.03 at most.
inline constexpr double heavy_damping = 0.3;

/// `tracked` modes are computed and tracked, of which the lowest `resolved` at rest are looked at.
struct Range {
  double max_speed;
  double scale;         // of flow speeds, 1 of a light pipe of one span
  Index count;          // roots computed, 2 dof where all modes are tracked
  Index tracked;        // modes
  Index resolved;       // modes
  Index certain;        // modes to be tracked with certainty; others are matched as they can be
  bool until_unstable;  // whether the search ends at the first crossing that destabilises
};

/// Crossings from rest up to a flow speed. `report` is called after each sample, and may throw.
Sweep crossings(Spectrum& spectrum, const Range& range, const std::function<void()>& report);

}  // namespace pipedyn
