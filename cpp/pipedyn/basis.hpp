// SPDX-License-Identifier: MIT
//
// Functions w_i(s) on 0 <= s <= 1 with w_i(0) = w_i'(0) = 0, the transverse displacements onto
// which a reduced model projects.
#pragma once

#include "pipedyn/pipe.hpp"

namespace pipedyn {

enum class Family {
  beam,      // the clamped-free beam's own modes, unit mass
  legendre,  // w_i'' = sqrt(2 i + 1) P_i(2 s - 1), normalised Legendre curvature, unit stiffness
};

/// The first m functions of a family. Immutable.
class Basis {
 public:
  /// Throws std::invalid_argument if m < 1.
  Basis(Family family, Index m);

  Family family() const { return family_; }
  Index size() const { return size_; }

  /// w_i, w_i' or w_i'' (derivative 0, 1, 2) at the points s, shape (len(s), m), O(len(s) m).
  /// Beam modes are written with exponentials that decay from either end, which holds at any
  /// number: with e = exp(-kappa), A = (sin kappa - cos kappa - e) / (1 - e^2 + 2 e sin kappa),
  ///   w = -cos(kappa s) + (1 - 2 A e) sin(kappa s) + A exp(-kappa (1 - s))
  ///       + (1 - A e) exp(-kappa s).
  /// Throws std::invalid_argument for another derivative.
  Matrix evaluate(const Vector& s, int derivative) const;

  /// Elastic stiffness of each function, integral of w_i''^2, shape (m,).
  Vector stiffness() const;

 private:
  Family family_;
  Index size_;
  Vector roots_;  // beam only: kappa_i, roots of cos(kappa) cosh(kappa) = -1
};

}  // namespace pipedyn
