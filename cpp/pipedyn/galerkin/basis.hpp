// SPDX-License-Identifier: MIT
//
// Functions w_i(s) on 0 <= s <= 1, the transverse displacements onto which a reduced model projects
// the equation of motion. All are 0 at the root; w_i' is 0 there as well unless the root turns, and
// w_i'(1) = 0 if the end keeps its direction. The functions do not satisfy x = 0 at supports across
// the pipe, at its end or inside it: in large motions that is not a condition on their sum.
#pragma once

#include <vector>

#include "pipedyn/galerkin/beam.hpp"
#include "pipedyn/pipe.hpp"

namespace pipedyn {

enum class Family {
  beam,      // modes of the beam, of unit mass; if it is held across at s = 1, after the shape
             // that a force there gives it, of unit stiffness
  legendre,  // w_i'' = sqrt(2 i + 1) P_i(2 s - 1), normalised Legendre curvature, unit stiffness
};

/// The first m functions of a family. Immutable.
///
/// A term inside the pipe makes the shear jump. Curvatures that are smooth all along the pipe
/// converge only algebraically to such a solution, so Legendre curvatures may live on panels that
/// end at the terms. On a panel of length h that starts at a,
/// w_i'' = sqrt((2 k + 1) / h) P_k(2 (s - a) / h - 1); elsewhere it is 0. w_i' and w_i are its
/// integrals from the clamp, constant and linear beyond the panel. The functions keep unit
/// stiffness. A root that turns adds w = s, with the stiffness of the root or, if that is above 1,
/// scaled to unit stiffness. If the end keeps its direction, s^2 / 2 is removed from the functions;
/// if the root also turns, s^2 / 2 - s takes its place.
///
/// The first functions of a larger basis are those of a smaller one. Functions are distributed over
/// the panels one by one. Panels with at most f functions come first: the one with fewest functions
/// and, among several, the longest one. A panel of length h with more than f(h) functions comes the
/// later the less length it has for each function beyond f (Adams's rule: no panel gets more than
/// its share rounded up). Waves need functions in proportion to the length of the panel. A smooth
/// shape needs f = 4 functions on any panel, except on the shortest, where h^f, the size of its
/// Legendre coefficients there, falls below 1e-6 at a smaller f.
class Basis {
 public:
  /// joints: inner ends of the panels, ascending; none for beam modes. more: added to f on panels
  /// where that many functions still move a mass above rounding. held: only its conditions at root
  /// and end are read. Throws std::invalid_argument unless 0 < joints < 1 ascend and m is enough
  /// for one function on each panel.
  Basis(Family family, Index m, const Vector& joints = Vector(), Index more = 0,
        const Pipe& held = Pipe());

  Family family() const { return family_; }
  Index size() const { return size_; }

  /// Ends of the panels, from 0 to 1.
  const Vector& ends() const { return ends_; }
  /// The numbers of the functions on each panel, ordered by degree; on the same panels, those of a
  /// smaller basis come first. If the end keeps its direction, only combinations of the curvatures
  /// of degree 0 are functions, and the first of these may not exist (-1).
  std::vector<std::vector<Index>> by_panel() const;
  /// Converts amplitudes q (m, r) of the functions to the slope at a root that turns and the
  /// amplitudes of Legendre curvatures, panel by panel and by degree: (1 or 0 + functions on
  /// panels, r).
  Matrix on_panels(const Matrix& q) const { return to_panels_ * q; }
  /// Whether the functions are orthonormal with the mass of the straight uniform pipe.
  bool orthonormal() const { return family_ == Family::beam && !held_across_; }
  /// Number of functions on the panel that has the most of them.
  Index most_on_a_panel() const;
  /// Number of Gauss nodes on a panel that integrate products of two functions. Products of
  /// Legendre functions are polynomials, whose degree is twice the number of functions on the panel
  /// plus 2. Beam mode m has about m / 2 waves and a boundary layer of width 1 / (m pi) at either
  /// end.
  Index nodes_of_products() const {
    return family_ == Family::beam ? 2 * size_ + 30 : most_on_a_panel() + 3;
  }

  /// w_i, w_i' or w_i'' (derivative 0, 1, 2) at the points s, shape (len(s), m), in O(len(s) m). At
  /// a joint the curvature is the one of the panel beyond it. Throws std::invalid_argument for
  /// another derivative.
  Matrix evaluate(const Vector& s, int derivative) const;

  /// Elastic stiffness of each function on a uniform pipe: the integral of w_i''^2 plus
  /// k_r w_i'(0)^2, shape (m,). The functions of either family are orthogonal in the elastic
  /// energy.
  Vector stiffness() const;

 private:
  void set_panels();
  Matrix evaluate_panels(const Vector& s, int derivative) const;
  /// Number of Legendre functions that precede those on panels, and number of functions on panels
  /// that the conditions at the end remove.
  Index ahead() const { return family_ == Family::legendre && turns_ && !end_guided_ ? 1 : 0; }
  Index dropped() const { return family_ == Family::legendre && end_guided_ && !turns_ ? 1 : 0; }

  Family family_;
  Index size_;
  double root_;
  bool turns_, end_guided_, held_across_;  // root turns; end held in direction; end held across
  BeamModes modes_;                        // beam only
  Vector ends_;
  std::vector<std::vector<Index>> numbers_;  // functions on each panel, by degree, counted from 0
  Matrix to_panels_;                         // converts amplitudes as `on_panels` does
};

}  // namespace pipedyn
