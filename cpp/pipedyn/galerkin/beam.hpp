// SPDX-License-Identifier: MIT
//
// A uniform beam's own modes, w'''' = kappa^4 w, held as a pipe is at its ends:
//
//   w(0) = 0, w''(0) = k_r w'(0)  (w'(0) = 0 of a clamp),
//   free w'' = w''' = 0, guided w' = w''' = 0, pinned w = w'' = 0, clamped w = w' = 0 at s = 1.
//
// With exponentials that decay from either end, which holds at any number,
//
//   w = A cos(kappa s) + B sin(kappa s) + C exp(-kappa s) + D exp(-kappa (1 - s)).
//
// The lowest of a beam that a soft spring alone keeps from turning is nearly straight; there
//
//   w = K_1 + k_r K_2 + c K_3,   K_n = sum_j s^(4 j + n) kappa^(4 j) / (4 j + n)!
#pragma once

#include <vector>

#include "pipedyn/pipe.hpp"

namespace pipedyn {

/// The first modes, of unit mass. Immutable.
class BeamModes {
 public:
  BeamModes() = default;
  BeamModes(Index count, double root, End end);

  /// kappa^4, (count,).
  const Vector& stiffness() const { return stiffness_; }
  /// Derivatives of this order, 0 to 2, at the points s: (len(s), count).
  Matrix evaluate(const Vector& s, int derivative) const;

 private:
  struct Waves {
    double kappa, cosine, sine, from_root, from_end;
  };
  std::vector<Waves> waves_;
  bool slow_ = false;              // the first is by K_1 .. K_3
  Vector slow_parts_ = Vector(3);  // 1, k_r and c, times what makes its mass 1
  Vector stiffness_;
};

/// The shape w = a s + b s^2 + c s^3 that a force at s = 1 gives a beam, 1 there, the end's
/// direction held or not, and the force. No mode of the beam held across there does work with it.
struct EndShape {
  double a, b, c, force;

  EndShape(double root, bool direction_held);
};

}  // namespace pipedyn
