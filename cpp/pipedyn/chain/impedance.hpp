// SPDX-License-Identifier: MIT
//
// The linear problem T(lambda, u) X = 0 of a straight chain, nothing eliminated, in the unknowns
// (phi_j, theta_j, w_j, Q_j) of each segment: joint angle, angle, transverse displacement of the
// end, and the force that all beyond the end exerts, less a U^2 theta_j. Four equations a segment:
//   theta_j - theta_{j-1} - phi_j = 0,   w_j - w_{j-1} - l_j theta_j = 0,
//   e k_j phi_j - e k_{j+1} phi_{j+1} + g_j theta_j + f_j w_{j-1} + l_j Q_j = 0   (row j of P),
//   Q_{j-1} = Q_j + z_j w_{j-1} + t_j theta_j + a U^2 phi_j,
//   Q_n = -(1 - c) sqrt(beta) U lambda w_n, less a U^2 theta_n where the end is guided, with the
//   spring of its joint in g_n,
// e k_j being k_j + c_j lambda, with a loss factor + i mu dc_j / ddelta. No entry is a difference
// of nearly equal numbers; beyond a joint that nothing holds all is of the order of lambda, with
// all its digits. What lies beyond segment j answers a motion of its end by Q_j = A w_j + B theta_j
// and -e k_{j+1} phi_{j+1} = C w_j
// + D theta_j. With
//   G = l A + B,  R = g + D + l (C + G),  W = f + C + l A,  H = G + t,  p = e k + R
// row j says phi_j = -(R theta_{j-1} + W w_{j-1}) / p, and before the segment
//   A + z - (H + a U^2) W / p,   (H e k - a U^2 R) / p,   e k W / p,   e k R / p
// stand in place of A, B, C, D. Where a guide holds the end, w_j = 0, its force is unknown and
// theta_j = -w_{j-1} / l; what stands before is the limit for a stiff spring there,
//   (e k + D + g) / l^2 - (f + t + a U^2) / l + z,   e k / l - a U^2,   e k / l,   e k.
// det P is the product of the other segments' pivots p; without damping and flow the negative ones
// are as many as roots lie below |lambda|. The left vector Y, in psi_j = y_j -
// y_{j-1}, obeys the same with W and H + a U^2 exchanged. O(n) for each lambda, without pivoting:
// the residual of T, and what rounding does to its entries, say how good a root is.
#pragma once

#include <cstddef>

#include "pipedyn/vector/points.hpp"

namespace pipedyn {

/// What multiplies lambda^0, lambda^1 and lambda^2.
struct ImpedanceParts {
  double still, rate, square;

  bool operator==(const ImpedanceParts&) const = default;
};

/// One segment, all but the flow's share of each coefficient.
struct ImpedanceSegment {
  double length;
  ImpedanceParts joint;            // e k, of the joint, which has no inertia
  ImpedanceParts force;            // z: on all beyond the joint, by its displacement
  ImpedanceParts across;           // f: moment about the joint, by its displacement
  ImpedanceParts turned;           // t: force on all beyond the joint, by the angle
  ImpedanceParts moment;           // g: moment about the joint, by the angle
  double joint_loss, moment_loss;  // imaginary parts of e k and of g
  // Sums of the absolute values of what t and g are at rest.
  double turned_size, moment_size;
  bool held;     // whether a guide holds its end
  bool loaded;   // whether z, f and t are more than inertia, or g has a rate or a loss
  bool repeats;  // whether the next segment equals it in all of the above

  bool operator==(const ImpedanceSegment&) const = default;
};

struct ImpedanceModel {
  const ImpedanceSegment* segments;
  std::ptrdiff_t size;  // n
  double coriolis;      // sqrt(beta) s
  double entry;         // (1 - c) sqrt(beta) s
  double thrust;        // a cos psi, a for short
  bool guided;          // whether the end keeps its direction
};

struct ImpedanceKernel {
  /// d log det P / dlambda - sum_k 1 / (lambda - lambda_k), real and imaginary parts of count
  /// values; roots k at lambda itself add nothing.
  void (*log_derivative)(const ImpedanceModel&, const Points&, double* out);
  /// Vectors of roots, or of values near them. Uses the thread's scratch (vector/scratch.hpp).
  void (*pairs)(const ImpedanceModel&, const Points&, const PairsAsked&);
};

extern const ImpedanceKernel impedance_baseline, impedance_avx2, impedance_avx512;

}  // namespace pipedyn
