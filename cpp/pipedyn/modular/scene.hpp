// SPDX-License-Identifier: MIT
//
// A scene: a chain (chain/chain.hpp) of which guides and pins hold nodes, and on which modules
// written in Python act, with forces and inertia of their own. These speak redundant coordinates,
// q = (x_j, y_j, phi_j) at 3 (j - 1): where the end of segment j stands, x across and y down from
// the clamp, and the angle of joint j. All follow from the angles theta of the segments,
//
//   r_j = r_{j-1} + l_j (sin theta_j, cos theta_j), r_0 = (0, base), phi_j = theta_j - theta_{j-1},
//
// so that clamp and joints, eqs. (10) and (11) of Orsino and Di Giulio, are met at any angles.
//
// A row of weights w makes one number w . q of the coordinates, with the rate R theta'. A guide or
// pin holds it; an inertia (w . q')^2 / 2 acts on it with the force -(R theta')'. With mu the force
// along each row and M^-1 the chain's recursion, which takes O(n),
//
//   theta'' = M^-1 f + X mu,   X = M^-1 R^T,   (R theta')' + compliance mu = 0,
//
// where compliance is 0 of what is held and 1 of an inertia. A last segment may have no inertia but
// that of a row, and M no inverse then: it is lent one, which a row with compliance -1 takes back.
//
// Integrators' states may miss guides and pins by g, which decays as in a critically damped
// oscillator, k the return rate:
//
//   (R theta')' = -2 k R theta' - k^2 g.
//
// An integrator's errors off guides and pins do not grow then, and a state that meets them moves as
// above (Baumgarte 1972).
//
// Of changes x of a state the accelerations change by J x = J_0 x + X z, where J_0 holds z = mu. At
// held accelerations the rows change by E x besides, from which z follows,
//
//   R J x + E x + compliance z = 0:
//
// the dense J in O(n^2) a row, (nu - J) x = b in O(n) a row.

#pragma once

#include <vector>

#include "pipedyn/chain/chain.hpp"

namespace pipedyn {

/// Immutable; one scene may serve many threads. A state is [theta, theta'], or redundant [q, q'].
class Scene {
 public:
  /// inertia: rows of what has inertia besides the chain (rows, 3 n). held: x or y of nodes that
  /// guides or pins hold, each once, at value. Throws std::invalid_argument where arrays differ in
  /// length, a length is not positive or a coordinate is not the scene's.
  Scene(const Pipe& pipe, const Segments& segments, const Matrix& inertia,
        const std::vector<Index>& held, const Vector& value);

  const Chain& chain() const { return chain_; }
  Index dof() const { return length_.size(); }
  Index coordinates() const { return 3 * dof(); }
  /// The weights of each row (rows, 3 n): inertia first, then what is held, then what is lent.
  const Matrix& weights() const { return weights_; }
  const Vector& compliance() const { return compliance_; }
  /// As Chain::bodies, without the inertia that is lent.
  Matrix bodies() const;

  /// Redundant states (6 n, k) of segments at angles theta (n, k) that turn at omega (n, k).
  Matrix redundant(const Matrix& theta, const Matrix& omega) const;
  /// The angles and their rates (2 n, members) in redundant states (6 n, members).
  Matrix angles(const Batch& states) const;

  /// Rates of [theta, theta'] (2 n, members), O(n) a member and row. They return to guides and
  /// pins, and keep those that are met; what these say twice is enforced once. NaN where a
  /// direction has no inertia.
  void rhs(const Batch& batch, double* rates) const;
  /// The same of redundant states (6 n, members), of which the angles of the joints and their rates
  /// are read, and which do not return.
  void redundant_rhs(const Batch& states, double* rates) const;
  /// Those of [theta, theta', work done] (2 n + 1, members).
  void rhs_and_power(const Batch& batch, double* rates) const;

  /// What J_0 takes of one state, and what z follows from. Rows that follow from others have no z.
  struct Linear {
    Vector moments, slopes;  // of forces along the rows and further ones on the segments, and of
                             // each by its segment's angle; empty without any
    Matrix r, e, x;          // (size of z, n), (size of z, 2 n), (n, size of z)
    Vector compliance;
  };
  /// rate: k, 0 of `redundant_rhs`.
  Linear linearised(const Batch& one, double rate) const;
  /// J of each member (members, 2 n, 2 n), row-major: of `rhs`.
  void jacobian(const Batch& batch, double* out) const {
    derivative(batch, return_rate, Matrix(), out);
  }
  /// The same at any k. by_state: derivatives of further moments (n, 2 n) of a single member, which
  /// are else held.
  void derivative(const Batch& batch, double rate, const Matrix& by_state, double* out) const;

  /// Energy of states [theta, theta']; 0 at rest on the straight pipe.
  void energy(const Batch& batch, double* out) const;
  /// What flow, joints, drag and the pipe's terms add to it in unit time.
  void power(const Batch& batch, double* out) const { chain_.power(batch, out); }
  void axial(const Batch& batch, double* out) const { chain_.axial(batch, out); }

  /// Angles and rates (n, k) close to those given that meet guides and pins, by Newton's method in
  /// least steps. Returns how far the angles miss them (k), which is above `met` where no such
  /// angles are close by; then they are the closest found.
  Vector project(Matrix& theta, Matrix& omega) const;
  static constexpr double met = 1e-13;  // in L: a hundred times rounding

  /// Rate k at which a state off guides and pins returns to them, faster than flutter turns. Lower
  /// ones leave more of an implicit integrator's errors, higher ones of an explicit integrator's.
  static constexpr double return_rate = 60.0;

 private:
  Vector length_;
  double base_;
  bool lends_;
  Chain chain_, inertia_;  // the second without forces
  Index held_from_;        // the first row that is held
  Vector value_;           // of what is held
  Matrix weights_;
  Vector compliance_;
  // Of w . q: at rest on the axis of the base, by each sine and cosine, and by angles of joints.
  Vector origin_;
  Matrix across_, along_, joints_;

  /// What `enforce` needs of one state or some, members: scratch that the next call may reuse.
  struct Rows {
    Matrix sine, cosine;  // of theta, (n, members)
    /// R and the derivative of each entry by its angle, (n, rows members) with the members of a row
    /// together. Where it weighs nodes, w . q is origin_ less the sum of the derivatives.
    Matrix by_angles, turning;
    Matrix still, response;   // states at rest and X below their rates, (2 n, rows members)
    Matrix products, forces;  // R X + compliance, a member in a column, and mu (rows, members)
  };
  void set_rows(const Matrix& theta, Rows& rows) const;
  /// Turns the chain's accelerations, those and omega n rows of `stride` numbers, into the scene's.
  /// Returns the rows of the last member that follow from others.
  std::vector<Index> enforce(const Matrix& theta, Rows& rows, double rate, const double* omega,
                             double* acceleration, Index stride) const;
  /// Turns the chain's rates into the scene's.
  void add_rows(const Batch& batch, double rate, double* rates) const;
  double project_one(Vector& theta, Vector& omega) const;
  /// M^-1 times moments (n, k) where the angles are theta (n, k).
  Matrix solve(const Matrix& theta, const Matrix& moments) const;
};

}  // namespace pipedyn
