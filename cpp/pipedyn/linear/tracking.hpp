// SPDX-License-Identifier: MIT
//
// Eigenvalues tracked along the flow speed: the match of two neighbouring samples (see
// `pipedyn.linear.tracking`) and what it shows of crossings of the imaginary axis (see
// `pipedyn.linear.crossings`). O(r^2) for r eigenvalues, O(r^3) where their order changes much.
#pragma once

#include <complex>
#include <cstdint>
#include <limits>
#include <tuple>
#include <vector>

namespace pipedyn {

using Complex = std::complex<double>;
using Root = std::int64_t;  // place of an eigenvalue in its sample, or -1
using Roots = std::vector<Root>;
using Flags = std::vector<std::uint8_t>;

inline constexpr double infinite = std::numeric_limits<double>::infinity();

/// The lowest eigenvalues at one speed, (size) of each.
struct Sample {
  double u;
  Root size;
  const Complex *values, *slopes;     // lambda and d lambda / du
  const double *noise, *slope_noise;  // their rounding, of the slopes' real parts only
  const std::int8_t* signatures;      // Krein's on the axis of a conservative system, else 0
};

/// Roots that need not be distinguished: |1 + damping lambda| < radius, and |lambda| < zero.
struct Cluster {
  double damping, radius, zero;
};

/// The match of two samples, by the roots of the left one.
struct Match {
  Roots onto;                   // which root of the right sample continues it
  std::vector<double> error;    // e, by which the slopes at either end disagree about the middle
  Roots meets;                  // the root that it meets on the real axis within the step
  std::vector<Complex> slopes;  // the left sample's; of roots that leave zero at rest, estimated
  bool unambiguous;             // for the roots tracked
};

Match match(const Sample& left, const Sample& right, const Roots& tracked, const Cluster& cluster);

/// Which roots of a sample are unstable: by the sign of Re lambda, or as before where it has none.
/// onto: which roots; before: (onto.size).
Flags unstable(const Sample& at, const Roots& onto, const Flags& before, double zero);

/// A matched step, and what is known of the roots of its left sample.
struct Step {
  Sample left, right;
  const Roots &onto, &meets;
  const double* error;
  const Roots& modes;     // counted from rest, from 1; 0 for others
  const Flags& unstable;  // at the left end
};

/// Which roots are looked at, and how.
struct Search {
  Root resolved;      // the highest mode
  Root certain;       // beyond this mode those that are heavily damped at both ends are not
  double zero;        // |lambda| below which a root counts as zero
  bool conservative;  // whether eigenvalues come in fours
};

/// One root of each conjugate pair; those that meet another on the real axis are not scanned.
struct Scan {
  Roots roots;        // looked at
  Flags leaving;      // (left.size), which leave the axis at rest to the right
  Flags after;        // (left.size), which are unstable at the right end
  bool clear = true;  // the cubics show all; without this there are no crossings
  /// Root, fraction of the step, whether it turns unstable; in order along each root.
  std::vector<std::tuple<Root, double, bool>> crossings;
};

/// Crossings of the imaginary axis within a step, by the cubics of real parts.
Scan scan(const Step& step, const Search& search);

}  // namespace pipedyn
