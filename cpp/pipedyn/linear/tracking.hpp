// SPDX-License-Identifier: MIT
//
// Eigenvalues tracked along the flow speed: which at one speed is which at the next.
//
// Two neighbouring samples are joined by cubic Hermite curves through eigenvalues and their slopes
// d lambda / du. A match is ambiguous where two curves pass within a few times their errors of one
// another; the step is then halved. The error of a curve is the lesser of two: how far the slopes
// disagree about the middle of the step,
//
//     |lambda_0 + lambda_0' h/2 - (lambda_1 - lambda_1' h/2)| = O(h^3),
//
// and what the curve of the step before, continued, misses at the end of this one, O(h^4). A pair
// that meets on the real axis has no slope there, but its sum and product run smoothly through the
// meeting, and are compared instead: where roots turn real or complex, a step is matched only if
// they do. O(r^2) for r eigenvalues, O(r^3) where their order changes much.
//
// Where curves are close that stay left of the imaginary axis, and the model finds some roots
// without all others, these alone are followed through halves of the step.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "pipedyn/linear/spectrum.hpp"

namespace pipedyn {

using Roots = std::vector<Index>;  // places of eigenvalues in their sample, or -1
using Flags = std::vector<char>;
using SharedSample = std::shared_ptr<const Sample>;

/// Relative to 1 + u; below it the best match is taken as it is. Roots that meet, like the square
/// root of the speed, are 1e-3 apart at this distance: four digits above their rounding of 1e-7.
inline constexpr double shortest_step = 1e-6;

/// Roots that need not be distinguished: |1 + delta lambda| < radius, and |lambda| < zero.
struct Cluster {
  Complex delta;
  double radius, zero;

  bool holds(Complex value) const { return magnitude(delta * value + 1.0) < radius; }
};

/// Two neighbouring samples matched, by the roots of the left one.
struct Step {
  SharedSample left, right;
  Roots onto = {};                      // which root of the right sample continues it
  std::vector<double> error = {};       // how far its curve may be off
  std::vector<double> real_error = {};  // how far its real part, by the step before; 0 without one
  Roots meets = {};    // the root that it meets on the real axis within the step, or -1
  Values slopes = {};  // the left sample's; of roots that leave zero at rest, estimated
  std::vector<std::pair<Index, Index>> close = {};  // roots whose curves cannot be told apart
  Flags aside = {};  // of roots that were followed by themselves, left of the imaginary axis
  bool unambiguous = false;  // for the roots tracked

  double length() const { return right->u - left->u; }
  Complex start(Index i) const { return left->values[i]; }
  Complex end(Index i) const { return right->values[onto[i]]; }
  Complex start_slope(Index i) const { return slopes[i]; }
  Complex end_slope(Index i) const { return right->slopes[onto[i]]; }

  /// Whether the step will not be halved again.
  bool shortest() const;
  /// Whether a root has left the eigenvalues computed and was matched to another.
  bool lost(Index root) const;
  /// The root that at the step's end, or at its start, lies where this one is reflected in the
  /// imaginary axis; -1 if none does.
  Index reflected(Index root, bool at_end) const;
  /// The cubic of a root at a fraction of the step.
  Complex at(Index root, double t) const;
  /// The same at a speed.
  Complex expected(Index root, double u) const { return at(root, (u - left->u) / length()); }
};

struct Tracking {
  std::function<SharedSample(double u)> take;
  std::function<bool(const Step&)> sure;   // whether the step need not be halved
  std::function<bool(const Step&)> whole;  // whether it is not to be
  std::function<bool(const Step&)> visit;  // each step in turn; false ends the tracking
  Cluster cluster;
  double longest;  // step
  /// Where the roots of a sample go at another speed; none where that is not found. May be empty.
  std::function<std::optional<Sample>(double u, const Sample& from)> near = {};
};

/// Column of each row so that the sum of their costs, (size, size) by rows, is least (the Hungarian
/// method): each row takes its cheapest column if that is free, and the others are added one by
/// one, along the shortest augmenting path by reduced costs. O(size^2) each.
Roots assignment(const std::vector<double>& cost, Index size);

/// Steps from the first sample through increasing speeds, short enough to be unambiguous. Of the
/// first sample the roots `tracked` are tracked with certainty, the others matched as well as they
/// can be. Throws NotConverged where steps are too many.
void track(const Tracking& tracking, SharedSample first, const std::vector<double>& speeds,
           Roots tracked);

/// Mode of each root, from 1, by the product of the two roots that share it, at rest the square of
/// the undamped frequency: conjugates, and of real roots neighbours by Rayleigh's quotient, the
/// square of that frequency by their shapes. With a loss factor the roots on each side of the real
/// axis by |lambda|.
Roots modes_of(const Values& values, const Reals& quotients, const Traits& traits);

/// Branches of eigenvalues at each of increasing speeds, (speeds, count) of each: a root, the other
/// of its pair, and of both whether they passed the check of their residual and how far they may be
/// off. With a loss factor of a pair that which is above the real axis and its conjugate, and NaN
/// where both are below.
struct RootLoci {
  Eigen::ArrayXXcd values, partners;
  Eigen::Array<bool, Eigen::Dynamic, Eigen::Dynamic> converged;
  Eigen::ArrayXXd errors;
};

/// The `count` lowest branches at the first speed, tracked among the `taken` lowest roots; none
/// where one climbs out of these. `report` is called after each sample with the number of speeds
/// done, and may throw.
std::optional<RootLoci> root_loci(Spectrum& spectrum, const std::vector<double>& speeds,
                                  Index count, Index taken,
                                  const std::function<void(Index done)>& report);

}  // namespace pipedyn
