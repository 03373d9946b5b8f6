// SPDX-License-Identifier: MIT
//
// Arguments and results of the determinants that are computed along the pipe
// (chain/dynamic_stiffness.hpp, galerkin/elimination.hpp).
#pragma once

#include <cstddef>

namespace pipedyn {

/// Values of lambda, at one speed u, and roots that are already known. Arrays have `count` and
/// `roots` entries.
struct Points {
  double u;
  std::ptrdiff_t count;
  const double *real, *imag;
  std::ptrdiff_t roots = 0;
  const double *root_real = nullptr, *root_imag = nullptr;
};

/// Products with the right and left null vectors, P X = 0 and Y^T P = 0, of `count` roots. Arrays
/// hold real and imaginary parts of each, one after the other.
struct PairsAsked {
  double* by_lambda;  // Y^T (dP/dlambda) X
  double* value;      // Y^T P X
  double* by_u;       // Y^T (dP/du) X
  double* by_right;   // X^H (dP/dlambda) X, or null
  double* rest;       // |Y|^T |P X|
  double* entries;    // sum of the absolute values of the terms of Y^T P X
  double* sums;       // bound on the rounding of sums along the pipe in it; `count` numbers in each
  double *right, *left;  // coordinates of X and Y, (n, 2, count), or null
  /// For a chain: whether each joint is loaded by a moment of the size of its terms, as in inverse
  /// iteration. Otherwise the vectors start at the clamp, where the last pivot is 0; that fails for
  /// modes whose amplitude is far larger elsewhere. The loads fail if segments differ by orders of
  /// magnitude.
  bool loaded;
};

}  // namespace pipedyn
