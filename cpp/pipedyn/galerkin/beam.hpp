// SPDX-License-Identifier: MIT
//
// Modes of a uniform beam, w'''' = kappa^4 w, with the end conditions of a pipe:
//
//   w(0) = 0, w''(0) = k_r w'(0)  (w'(0) = 0 of a clamp),
//   free w'' = w''' = 0, guided w' = w''' = 0, pinned w = w'' = 0, clamped w = w' = 0 at s = 1.
//
// Written with exponentials that decay from either end, which stays accurate for any mode number, a
// mode is
//
//   w = A cos(kappa s) + B sin(kappa s) + C exp(-kappa s) + D exp(-kappa (1 - s)).
//
// The lowest mode of a beam whose rotation at the root is resisted only by a soft spring is nearly
// straight; it is written as
//
//   w = K_1 + k_r K_2 + c K_3,   K_n = sum_j s^(4 j + n) kappa^(4 j) / (4 j + n)!
#pragma once

#include <vector>

#include "pipedyn/pipe.hpp"

namespace pipedyn {

/// The first modes of a uniform beam, each of unit mass. Immutable.
class BeamModes {
 public:
  BeamModes() = default;
  BeamModes(Index count, double root, End end);

  /// kappa^4 of each mode, (count,).
  const Vector& stiffness() const { return stiffness_; }
  /// Derivatives of the modes of this order, 0 to 2, at the points s: (len(s), count).
  Matrix evaluate(const Vector& s, int derivative) const;

 private:
  struct Waves {
    double kappa, cosine, sine, from_root, from_end;
  };
  std::vector<Waves> waves_;
  bool slow_ = false;              // the first mode is written with K_1 .. K_3
  Vector slow_parts_ = Vector(3);  // 1, k_r and c, scaled to a mode of unit mass
  Vector stiffness_;
};

/// The shape w = a s + b s^2 + c s^3 that a force at s = 1 gives a beam whose direction there is
/// held or not, scaled to w(1) = 1, and this force. The force does no work on any mode of the beam
/// held across at s = 1.
struct EndShape {
  double a, b, c, force;

  EndShape(double root, bool direction_held);
};

}  // namespace pipedyn
