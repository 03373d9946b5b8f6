// SPDX-License-Identifier: MIT
//
// Flow speeds at which eigenvalues pass through the imaginary axis.
//
// Each step of a tracked sweep (tracking.hpp) gives a cubic for the real part of each root. A step
// shows all crossings if no extremum of a cubic lies closer to the axis than the cubic's own error;
// otherwise the step is halved. So a root that touches the axis between two samples, or passes it
// twice, is found. Each crossing is then refined by Newton's method with d lambda / du on the
// model.
//
// A real part within rounding of zero has no sign: its root stays what it was, stable or unstable,
// until the real part is larger than rounding.
//
// Where lambda enters only as lambda^2 (no damping, and no fluid mass), all roots lie on the
// imaginary axis or symmetrically about it. Re lambda of each would be rounding, and flutter would
// be refused, since two roots meet there without a slope d lambda / du. So nu = lambda^2 is tracked
// instead. Real nu < 0 are roots on the axis; they leave it where two of them meet and turn complex
// (flutter; Beck's column) or where one reaches zero (divergence).
//
// Real roots pass zero where K(u) is singular, whatever the terms in the velocity are: these speeds
// are known before any root is followed (`Spectrum::divergences`), and each is enclosed by two
// samples of its own. In every other step no real root changes its side.
//
// A loss factor acts only on oscillation. Roots of P are tracked on either side of the real axis;
// those above it count for two, and growing real roots are those of the pipe without the loss
// factor. Where a growing root passes the real axis, a pair appears or vanishes: this is a crossing
// of frequency 0.
//
// Two growing real roots of a conservative system may meet and become a growing pair. This
// coupled-mode flutter passes no axis; it is listed among the crossings, with a change of 0.
#pragma once

#include <optional>
#include <string>

#include "pipedyn/linear/axis_roots.hpp"
#include "pipedyn/linear/tracking.hpp"

namespace pipedyn {

/// One crossing of the imaginary axis by a root or a conjugate pair.
struct AxisCrossing {
  double speed;    // u
  Complex value;   // i times the frequency; 0 for divergence
  int change;      // change of the number of unstable roots, a pair being two; 0 where
                   // two growing real roots become a pair
  Index mode;      // mode of the root at rest, in the order of frequency, from 1
  double error;    // absolute error of the speed
  Pair pair = {};  // without vectors where two roots meet on the axis or at u = 0+
  int before = 0;  // number of unstable roots below this speed
  // Whether K is indefinite on that side of the crossing on which no root grows: there only
  // gyroscopic forces hold a conservative system, and any damping makes it unstable.
  bool gyroscopic = false;
};

struct Sweep {
  int unstable_at_rest = 0;                  // number of unstable roots at rest
  std::vector<AxisCrossing> crossings = {};  // in order of speed
  std::string failure = {};  // why crossings are missing or do not account for unstable roots
  bool untracked = false;    // whether a root outside the tracked ones became unstable
};

/// Roots with Re lambda < -0.3 |lambda| are not worth refining, if their modes need not be tracked.
/// With 16 Legendre functions such roots have a share of 0.56 or more at damping 1e-3, and roots
/// without damping 0.03 at most.
inline constexpr double heavy_damping = 0.3;

/// Largest relative error of a crossing's speed that is a result: three digits are wanted.
inline constexpr double largest_error = 1e-3;

/// Range of a search: `tracked` modes are computed and tracked, and crossings are looked for among
/// those that are the `resolved` lowest at rest.
struct Range {
  double max_speed;
  double scale;         // scale of flow speeds, 1 for a light pipe of one span
  Index count;          // number of roots computed, 2 dof where all modes are tracked
  Index tracked;        // number of modes tracked
  Index resolved;       // number of modes looked at
  Index certain;        // number of modes tracked with certainty, others as well as possible
  bool until_unstable;  // whether the search ends at the first crossing that destabilises
};

/// Steps of a search, each with the modes of the roots of its left sample.
using Trace = std::vector<std::pair<Step, Roots>>;

/// Crossings between rest and a flow speed. `report` is called after each sample, and may throw.
/// The steps of the search are added to `trace`, where it is given.
Sweep crossings(Spectrum& spectrum, const Range& range, const std::function<void()>& report,
                Trace* trace = nullptr);

}  // namespace pipedyn
