// SPDX-License-Identifier: MIT
//
// Functions w_i(s) on 0 <= s <= 1, the transverse displacements onto which a reduced model
// projects. They are 0 at the root, where w_i' is 0 unless the root turns, and where the end keeps
// its direction w_i'(1) = 0. Whether the pipe is held across at its end or between is not theirs:
// in large motions that is no condition on their sum.
#pragma once

#include <vector>

#include "pipedyn/galerkin/beam.hpp"
#include "pipedyn/pipe.hpp"

namespace pipedyn {

enum class Family {
  beam,      // the beam's own modes, unit mass, and before them the shape that a force at s = 1
             // gives it if it is held across there, unit stiffness
  legendre,  // w_i'' = sqrt(2 i + 1) P_i(2 s - 1), normalised Legendre curvature, unit stiffness
};

/// The first m functions of a family. Immutable.
///
/// A term inside the pipe makes the shear jump, which curvatures that are smooth all along
/// follow only algebraically. So Legendre curvatures may live on panels that end there: on a panel
/// of length h from a, w_i'' = sqrt((2 k + 1) / h) P_k(2 (s - a) / h - 1), elsewhere 0, and w_i',
/// w_i are the integrals from the clamp, constant and linear beyond the panel. The unit stiffness
/// stays. A root that turns adds w = s, of the root's stiffness or, if that is above 1, of unit
/// stiffness. An end that keeps its direction takes away s^2 / 2, combined with which it lets the
/// root turn: s^2 / 2 - s.
///
/// The first functions of a larger basis are those of a smaller one: function by function the panel
/// that has fewest gets the next, the longest of these, and one that has f(h) more the later the
/// less length it has for each function beyond f (Adams's rule: none above its share rounded up).
/// Waves need functions in proportion to length; a smooth shape needs f = 4 on any panel but the
/// shortest, where h^f < 1e-6, the size of its Legendre coefficients there, comes first.
class Basis {
 public:
  /// joints: inner ends of the panels, ascending; none for beam modes. more: added to f on panels
  /// where that many functions still move a mass above rounding. Of the pipe how it is held is
  /// read. Throws std::invalid_argument unless 0 < joints < 1 ascend and m is enough for one
  /// function on each panel.
  Basis(Family family, Index m, const Vector& joints = Vector(), Index more = 0,
        const Pipe& held = Pipe());

  Family family() const { return family_; }
  Index size() const { return size_; }

  /// Ends of the panels, from 0 to 1.
  const Vector& ends() const { return ends_; }
  /// The functions on each panel, by degree, those of a smaller basis on the same panels first; of
  /// degree 0 only combinations may be functions, whose first may be none (-1).
  std::vector<std::vector<Index>> by_panel() const;
  /// Of the slope at a root that turns and of the amplitudes of Legendre curvatures, panel by panel
  /// and by degree, the part that functions with amplitudes q (m, r) have: (1 or 0 + functions on
  /// panels, r).
  Matrix on_panels(const Matrix& q) const;
  /// Whether they are orthonormal with the straight pipe's mass.
  bool orthonormal() const { return family_ == Family::beam && !held_across_; }
  /// Number of functions on the panel that has most.
  Index most_on_a_panel() const;
  /// Gauss nodes on a panel that integrate products of two functions. Legendre products are
  /// polynomials of twice a panel's functions and 2; beam mode m has about m / 2 waves and a layer
  /// of width 1 / (m pi) at either end.
  Index nodes_of_products() const {
    return family_ == Family::beam ? 2 * size_ + 30 : most_on_a_panel() + 3;
  }

  /// w_i, w_i' or w_i'' (derivative 0, 1, 2) at the points s, shape (len(s), m), O(len(s) m).
  /// At a joint the curvature is that of the panel beyond. Throws std::invalid_argument for another
  /// derivative.
  Matrix evaluate(const Vector& s, int derivative) const;

  /// Elastic stiffness of each function on a uniform pipe, integral of w_i''^2 and k_r w_i'(0)^2,
  /// shape (m,). In either form they are orthogonal.
  Vector stiffness() const;

 private:
  Matrix evaluate_panels(const Vector& s, int derivative) const;
  /// Legendre functions before those on panels, and how many of those are none.
  Index ahead() const { return family_ == Family::legendre && turns_ && !directed_ ? 1 : 0; }
  Index dropped() const { return family_ == Family::legendre && directed_ && !turns_ ? 1 : 0; }

  Family family_;
  Index size_;
  double root_;
  bool turns_, directed_, held_across_;  // the root; the end, in direction and across
  BeamModes modes_;                      // beam only
  Vector ends_;
  std::vector<std::vector<Index>> numbers_;  // on each panel, by degree, counted from 0
};

}  // namespace pipedyn
