// SPDX-License-Identifier: MIT
//
// What is asked of a determinant along the pipe (chain/impedance.hpp, galerkin/elimination.hpp),
// and what it answers.
#pragma once

#include <cstddef>

namespace pipedyn {

/// Values of lambda at one speed u, and roots known; count and roots entries in each array.
struct Points {
  double u;
  std::ptrdiff_t count;
  const double *real, *imag;
  std::ptrdiff_t roots = 0;
  const double *root_real = nullptr, *root_imag = nullptr;
};

/// What is known of roots, by vectors X and Y with P X = 0 and Y^T P = 0; real and imaginary parts
/// of count values, one after the other.
struct PairsAsked {
  double* by_lambda;     // Y^T (dP/dlambda) X
  double* value;         // Y^T P X
  double* by_u;          // Y^T (dP/du) X
  double* by_right;      // X^H (dP/dlambda) X, or none
  double* rest;          // |Y|^T |P X|, and
  double* entries;       // the sum of the absolute values of what Y^T P X sums
  double* sums;          // what rounding of sums along the pipe may add to it; count numbers each
  double *right, *left;  // coordinates of X and Y, (n, 2, count), or none
  /// Of a chain, whether a moment of the size of its terms loads each joint, as in inverse
  /// iteration. Without, vectors start at the clamp, where the last pivot is 0: that fails for
  /// modes with far larger amplitudes elsewhere, which the loads may drown if segments differ by
  /// orders of magnitude.
  bool loaded;
};

}  // namespace pipedyn
