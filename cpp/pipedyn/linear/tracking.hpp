// SPDX-License-Identifier: MIT
//
// Eigenvalues tracked along the flow speed: which eigenvalue at one speed continues as which at the
// next.
//
// The eigenvalues of two neighbouring samples, with their slopes d lambda / du, are joined by cubic
// Hermite curves. A match is ambiguous where two curves pass within a few times their errors of
// each other; the step is then halved. The error of a curve is the distance at the middle of the
// step of the two lines along the slopes,
//
//     |lambda_0 + lambda_0' h/2 - (lambda_1 - lambda_1' h/2)| = O(h^3).
//
// It is large for smooth curves, and has to be: with errors of O(h^4), by a quintic through the
// sample before, and a tenth of it at least, searches of 5,000 random pipes gave other crossings
// for 32, most of which had lost two within one step; a change of beta by 1e-14 gives others for 5.
//
// A pair that meets on the real axis has no slope there, but its sum and product are smooth through
// the meeting and are compared instead: a step in which roots turn real or complex is matched only
// if their sums and products agree. The cost is O(r^2) for r eigenvalues, and O(r^3) where their
// order changes much.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "pipedyn/linear/spectrum.hpp"

namespace pipedyn {

using Roots = std::vector<Index>;  // indices of eigenvalues in their sample, or -1
using Flags = std::vector<char>;
using SharedSample = std::shared_ptr<const Sample>;

/// Shortest step relative to 1 + u; below it the best match is taken as it is. Roots that meet,
/// whose distance goes like the square root of the speed, are 1e-3 apart at this distance from the
/// meeting: four digits above their rounding of 1e-7.
inline constexpr double shortest_step = 1e-6;

/// Roots that need not be distinguished: |1 + delta lambda| < radius, and |lambda| < zero.
struct Cluster {
  Complex delta;
  double radius, zero;

  bool holds(Complex value) const {
    return delta != 0.0 && std::norm(delta * value + 1.0) < radius * radius;
  }
};

/// Two neighbouring samples, matched. Arrays have one entry for each root of the left sample.
struct Step {
  SharedSample left, right;
  Roots onto = {};                 // root of the right sample that continues it
  std::vector<double> error = {};  // error of its curve
  Roots meets = {};                // root that it meets on the real axis in the step, or -1
  Values slopes = {};        // slopes at the left; estimated for roots that leave zero at rest
  bool unambiguous = false;  // whether no tracked root's match is ambiguous

  double length() const { return right->u - left->u; }
  Complex start(Index i) const { return left->values[i]; }
  Complex end(Index i) const { return right->values[onto[i]]; }
  Complex start_slope(Index i) const { return slopes[i]; }
  Complex end_slope(Index i) const { return right->slopes[onto[i]]; }

  /// Whether the step will not be halved again.
  bool shortest() const;
  /// Whether a root is no longer among the eigenvalues computed and was matched to another one.
  bool lost(Index root) const;
  /// The root that lies, at the end of the step or at its start, next to the mirror image of the
  /// given one in the imaginary axis; -1 if none does.
  Index reflected(Index root, bool at_end) const;
  /// Value of a root's cubic at a fraction t of the step.
  Complex at(Index root, double t) const;
  /// Value of a root's cubic at a speed.
  Complex expected(Index root, double u) const { return at(root, (u - left->u) / length()); }
};

struct Tracking {
  std::function<SharedSample(double u)> take;
  std::function<bool(const Step&)> good;   // whether the step need not be halved
  std::function<bool(const Step&)> visit;  // takes each step in turn; false ends the tracking
  Cluster cluster;
  double longest;  // longest step in u
};

/// Column of each row so that the sum of the costs, (size, size) by rows, is least (the Hungarian
/// method). Each row takes its cheapest column if that is free. The other rows are added one by
/// one, along the shortest augmenting path by reduced costs, in O(size^2) each.
Roots assignment(const std::vector<double>& cost, Index size);

/// Takes steps from the first sample through increasing speeds, short enough to be unambiguous. The
/// roots `tracked` of the first sample are tracked with certainty, the others are matched as well
/// as possible. Throws NotConverged where too many steps are needed.
void track(const Tracking& tracking, SharedSample first, const std::vector<double>& speeds,
           const Roots& tracked);

/// Mode of each root, from 1, in the order of the product of the two roots that share a mode, which
/// at rest is the square of the undamped frequency. These two are conjugates, or neighbouring real
/// roots in the order of their Rayleigh quotients, which are the square of that frequency by the
/// roots' shapes. With a loss factor, roots are counted by |lambda| on each side of the real axis.
Roots modes_of(const Values& values, const Reals& quotients, const Traits& traits);

/// Tracked eigenvalues at each of increasing speeds, in tables (speeds, count): a root of a mode,
/// the other root of its pair, whether both passed the check of their residuals, and how far they
/// may be off. With a loss factor, the values are those above the real axis and the partners their
/// conjugates; both are NaN where both roots of a mode are below the axis.
struct RootLoci {
  Eigen::ArrayXXcd values, partners;
  Eigen::Array<bool, Eigen::Dynamic, Eigen::Dynamic> converged;
  Eigen::ArrayXXd errors;
};

/// Root loci of the `count` modes that are lowest at the first speed, tracked among the `taken`
/// lowest roots; none where one of them is no longer among these. `report` is called after each
/// sample with the number of speeds done, and may throw.
std::optional<RootLoci> root_loci(Spectrum& spectrum, const std::vector<double>& speeds,
                                  Index count, Index taken,
                                  const std::function<void(Index done)>& report);

}  // namespace pipedyn
