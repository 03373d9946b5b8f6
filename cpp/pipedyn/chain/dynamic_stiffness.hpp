// SPDX-License-Identifier: MIT
//
// The linear problem T(lambda, u) X = 0 of a straight chain, without eliminating unknowns. Each
// segment has the unknowns (phi_j, theta_j, w_j, Q_j): joint angle, angle, transverse displacement
// of its end, and the force that its end exerts on the segments beyond, less a U^2 theta_j. There
// are four equations a segment; z, f, t and g are the coefficients that `StiffnessSegment`
// explains below, with the contributions of the flow:
//   theta_j - theta_{j-1} - phi_j = 0,   w_j - w_{j-1} - l_j theta_j = 0,
//   e k_j phi_j - e k_{j+1} phi_{j+1} + g_j theta_j + f_j w_{j-1} + l_j Q_j = 0   (row j of P),
//   Q_{j-1} = Q_j + z_j w_{j-1} + t_j theta_j + a U^2 phi_j,
//   Q_n = -(1 - c) sqrt(beta) U lambda w_n; if the end is guided, less a U^2 theta_n, and g_n
//   contains the spring of its joint,
// where the joint's stiffness e k_j is k_j + c_j lambda, with hysteresis also + i mu dc_j / ddelta
// (mu: loss factor, delta: Kelvin-Voigt damping). No entry is a small difference of large numbers:
// entries of the order of lambda, as they are beyond a joint without a spring, are accurate to all
// digits. For the segments beyond to follow a motion of the end of segment j, Q_j must be A w_j + B
// theta_j, and -e k_{j+1} phi_{j+1} must be C w_j + D theta_j. With
//   G = l A + B,  R = g + D + l (C + G),  W = f + C + l A,  H = G + t,  p = e k + R
// row j gives phi_j = -(R theta_{j-1} + W w_{j-1}) / p. One segment nearer to the clamp, A, B, C
// and D become
//   A + z - (H + a U^2) W / p,   (H e k - a U^2 R) / p,   e k W / p,   e k R / p.
// If a guide holds the end of segment j, w_j = 0, its force is unknown and theta_j = -w_{j-1} / l.
// A, B, C and D then become the limit for a stiff spring there,
//   (e k + D + g) / l^2 - (f + t + a U^2) / l + z,   e k / l - a U^2,   e k / l,   e k.
// det P is the product of the pivots p of the segments that are not held; without damping and flow,
// the number of negative pivots is the number of roots below |lambda|. The left vector Y, with
// psi_j = y_j - y_{j-1}, satisfies the same equations with W and H + a U^2 exchanged. The cost is
// O(n) for each lambda, without pivoting; the residual of T, compared with the effect of rounding
// on its entries, shows how accurate a root is.
#pragma once

#include "pipedyn/chain/motion.hpp"
#include "pipedyn/vector/points.hpp"

namespace pipedyn {

/// Factors of lambda^0, lambda^1 and lambda^2 in a coefficient.
struct StiffnessParts {
  double stiffness, damping, mass;

  bool operator==(const StiffnessParts&) const = default;
};

/// Coefficients of one segment, without the contributions of the flow.
struct StiffnessSegment {
  double length;
  StiffnessParts joint;   // e k, of the joint, which has no inertia
  StiffnessParts force;   // z: force on all beyond the joint, by the joint's displacement
  StiffnessParts across;  // f: moment about the joint, by the joint's displacement
  StiffnessParts turned;  // t: force on all beyond the joint, by the angle
  StiffnessParts moment;  // g: moment about the joint, by the angle
  double joint_hysteresis, moment_hysteresis;  // imaginary parts of e k and of g
  double moment_size;  // sum of the absolute values of the numbers whose sum is g at lambda = 0
  bool held;           // whether a guide holds its end
  bool loaded;         // whether z, f or t is more than inertia, or g has damping or hysteresis
  bool repeats;        // whether the next segment equals it in all of the above

  bool operator==(const StiffnessSegment&) const = default;
};

/// The functions of one vector level.
struct StiffnessKernel {
  /// Computes d log det P / dlambda - sum_k 1 / (lambda - lambda_k) at each lambda of the points:
  /// all real parts, then all imaginary parts. Roots lambda_k equal to lambda are left out.
  void (*log_derivative)(const ChainModel&, const Points&, double* out);
  /// Computes right and left vectors, and numbers from them, at roots or at values near roots. Uses
  /// the thread's scratch (vector/scratch.hpp).
  void (*pairs)(const ChainModel&, const Points&, const PairsAsked&);
};

extern const StiffnessKernel stiffness_baseline, stiffness_avx2, stiffness_avx512;

}  // namespace pipedyn
