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
// A row of weights w makes one number w . q of the coordinates, with w . q'' = R theta'' + D. A
// guide or pin holds it; an inertia (w . q')^2 / 2 acts on it with the force -w . q''. With mu the
// force along each row and M^-1 the chain's recursion, which takes O(n),
//
//   theta'' = M^-1 f + X mu,   X = M^-1 R^T,   R theta'' + D + compliance mu = 0,
//
// where compliance is 0 of what is held and 1 of an inertia. A last segment may have no inertia but
// that of a row, and M no inverse then: it is lent one, which a row with compliance -1 takes back.
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

  /// Rates of [theta, theta'] (2 n, members), O(n) a member and row. They keep guides and pins that
  /// are met; what these say twice is enforced once. NaN where a direction has no inertia.
  /// multipliers: mu (rows, members), or null.
  void rhs(const Batch& batch, double* rates, double* multipliers = nullptr) const;
  /// The same of redundant states (6 n, members), of which the angles of the joints and their rates
  /// are read.
  void redundant_rhs(const Batch& states, double* rates) const;
  /// Rates of [theta, theta', work done] (2 n + 1, members). With P the projection below, the state
  /// moves as P(y) does, and y - P(y) decays at return_rate: an integrator's errors off guides and
  /// pins do not grow. Further moments are those at P(y). NaN where P fails.
  void rhs_and_power(const Batch& batch, double* rates) const;

  /// Energy of states [theta, theta']; 0 at rest on the straight pipe.
  void energy(const Batch& batch, double* out) const;
  /// What flow, joints, drag and the pipe's terms add to it in unit time.
  void power(const Batch& batch, double* out) const { chain_.power(batch, out); }

  /// M^-1 times moments (n, k) where the angles are theta (n, k).
  Matrix solve(const Matrix& theta, const Matrix& moments) const;

  /// Angles and rates (n, k) close to those given that meet guides and pins, by Newton's method in
  /// least steps. Returns how far the angles miss them (k), which is above `met` where no such
  /// angles are close by; then they are the closest found.
  Vector project(Matrix& theta, Matrix& omega) const;
  static constexpr double met = 1e-13;  // in L: a hundred times rounding

  /// Rate at which a state off guides and pins returns to them, as fast as flutter turns.
  static constexpr double return_rate = 10.0;

 private:
  Vector length_;
  double base_;
  bool lends_;
  Chain chain_, inertia_;  // the second without forces
  Index held_from_;        // the first row that is held
  Vector value_;           // of what is held
  Matrix weights_;
  Vector compliance_;

  /// What the rows add to the chain's rates.
  void add_rows(const Batch& batch, double* rates, double* multipliers) const;
  struct Reached;
  Reached reach(Index row, const double* sine, const double* cosine, const double* omega,
                double* by_angles, Index stride) const;
  double project_one(Vector& theta, Vector& omega) const;
};

}  // namespace pipedyn
