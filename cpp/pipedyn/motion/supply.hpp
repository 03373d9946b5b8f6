// SPDX-License-Identifier: MIT
//
// Constant head instead of constant speed (Bajaj, Sethna and Lundgren 1980). Along the tube, whose
// friction, weight and inlet pressure its fluid feels, with U = s u,
//   sqrt(beta) u' + s beta int t . r'' = h + s w y(1) - f u^2 / 2.
// The pipe's accelerations are affine in u', and so is their integral.
#pragma once

#include "pipedyn/chain/motion.hpp"

namespace pipedyn {

struct Supply {
  double head, friction, weight;   // h, f, w
  double root_of_beta, direction;  // sqrt(beta), s

  /// u' at a speed, a depth y(1), and the integral where u' is 0 and where it is 1.
  double rate(double u, double depth, double still, double pushed) const {
    const double driving = head + direction * weight * depth - 0.5 * friction * u * u;
    const double share = direction * root_of_beta;
    return (driving / root_of_beta - share * still) / (1.0 + share * (pushed - still));
  }
};

}  // namespace pipedyn
