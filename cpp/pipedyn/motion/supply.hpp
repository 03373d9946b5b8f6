// SPDX-License-Identifier: MIT
//
// Flow under constant head instead of constant speed (Bajaj, Sethna and Lundgren 1980). The balance
// of momentum of the fluid along the tube, with friction, weight and inlet pressure and U = s u, is
//   sqrt(beta) u' + s beta int t . r'' = h + s w y(1) - f u^2 / 2.
// The accelerations r'' of the pipe are affine in u', and so is their integral.
#pragma once

#include "pipedyn/chain/motion.hpp"

namespace pipedyn {

struct Supply {
  double head, friction, weight;   // h, f, w
  double root_of_beta, direction;  // sqrt(beta), s

  /// The rate u' at speed u and depth y(1), from the values of the integral for u' = 0 and u' = 1.
  double rate(double u, double depth, double still, double pushed) const {
    const double driving = head + direction * weight * depth - 0.5 * friction * u * u;
    const double share = direction * root_of_beta;
    return (driving / root_of_beta - share * still) / (1.0 + share * (pushed - still));
  }
};

}  // namespace pipedyn
