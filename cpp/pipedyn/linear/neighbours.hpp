// SPDX-License-Identifier: MIT
//
// Searches for the first loss of stability of many pipes, such as those of a stability curve, in
// which neighbours share what they can.
//
// Two pipes whose numbers (`Spectrum::numbers`) are near each other are searched; both flutter
// first. If their roots, step by step along the speed, differ by less than a share of what keeps
// them apart from the axis, and the root that flutters from the other roots, then so do the roots
// of each pipe on the line between the two pipes: they change continuously with its numbers, by
// less than that. Such a pipe first flutters in the last step of the two searches, by the root of
// the same mode. There all its roots are computed at the beginning of the step, where none may be
// unstable, from starts between those of its neighbours; Newton's method then gives the crossing.
// A pipe whose roots or crossing are not where its neighbours let one expect them is searched by
// itself. If two pipes differ by too much, the one half way is searched, and so on.
//
// As steps along the speed are bounded by the curves through their ends (tracking.hpp), so steps
// from pipe to pipe are bounded by the differences of their ends, with a factor of safety.
#pragma once

#include <span>

#include "pipedyn/linear/crossings.hpp"

namespace pipedyn {

/// The result of `crossings` for each of several spectra. `begins` is called before each search
/// with its index, `report` after each sample; both may throw. Searches take their memory from
/// those before, unless these ended early and are to be repeated with more modes.
void search_together(std::span<const std::shared_ptr<Spectrum>> spectra,
                     std::span<const Range> ranges, const std::function<void(Index)>& begins,
                     const std::function<void()>& report, std::span<Sweep> found);

}  // namespace pipedyn
