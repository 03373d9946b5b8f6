// SPDX-License-Identifier: MIT
//
// A scene: a chain (chain/chain.hpp) whose nodes guides and pins may hold, and on which modules
// written in Python may act with forces and inertia of their own. These modules use redundant
// coordinates q, with x_j, y_j and phi_j at 3 (j - 1): the position of the end of segment j, x
// across and y down from the clamp, and the angle of joint j. All follow from the angles theta of
// the segments,
//
//   r_j = r_{j-1} + l_j (sin theta_j, cos theta_j), r_0 = (0, base), phi_j = theta_j - theta_{j-1},
//
// so that any angles satisfy the constraints of clamp and joints, eqs. (10) and (11) of Orsino and
// Di Giulio.
//
// A row of weights w defines one number w . q, whose rate is a row of R theta'. A guide or pin
// holds this number; an inertia with the kinetic energy (w . q')^2 / 2 acts along it with the force
// -(R theta')'. With the forces mu along the rows and the chain's recursion M^-1, which takes O(n),
//
//   theta'' = M^-1 f + X mu,   X = M^-1 R^T,   (R theta')' + compliance mu = 0,
//
// where compliance is 0 for a row that is held and 1 for an inertia.
//
// The states of an integrator may miss guides and pins by a distance g. It decays as in a
// critically damped oscillator, with the return rate k:
//
//   (R theta')' = -2 k R theta' - k^2 g.
//
// An integrator's errors therefore do not grow, and a state that meets guides and pins moves as
// above (Baumgarte 1972).
//
// If a state changes by x, the accelerations change by J x = J_0 x + X z, where J_0 is the Jacobian
// at constant mu and z the change of mu. At constant accelerations the left sides of the rows
// change by E x; z follows from
//
//   R J x + E x + compliance z = 0.
//
// The dense J takes O(n^2) a row, and the solution of (nu - J) x = b takes O(n) a row.

#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "pipedyn/chain/chain.hpp"

namespace pipedyn {

/// What modules written in Python add at redundant states (6 n, members): their "moments" on the
/// segments (n, members), the "slopes" of these by one state [theta, theta'] (n, 2 n), their
/// potential "energy" (members), or the "work" in unit time of other forces (members).
using CustomForces = std::function<Matrix(const char* what, const Matrix& states)>;

/// A chain with guides, pins, further inertia and forces of modules written in Python. A state is
/// [theta, theta'], or the redundant state [q, q']. Immutable; many threads may use one scene.
class Scene {
 public:
  /// held: indices of the coordinates x or y of nodes that guides or pins hold, each once; value:
  /// their values. inertia: rows of weights of the inertia besides the chain's (rows, 3 n).
  /// customs: empty if no module is written in Python. Throws std::invalid_argument if arrays of
  /// the segments differ in length.
  Scene(const Pipe& pipe, const Segments& segments, const std::vector<Index>& held = {},
        const Vector& value = {}, const Matrix& inertia = {}, CustomForces customs = {});

  const Chain& chain() const { return chain_; }
  Index dof() const { return length_.size(); }
  Index coordinates() const { return 3 * dof(); }
  /// Number of rows: held coordinates, then inertia.
  Index row_count() const { return compliance_.size(); }
  bool has_customs() const { return static_cast<bool>(customs_); }

  /// Redundant states (6 n, k) for angles theta (n, k) and rates omega (n, k) of the segments.
  Matrix redundant(const Matrix& theta, const Matrix& omega) const;
  /// Angles of the segments and their rates (2 n, members) from the angles of the joints and their
  /// rates in redundant states (6 n, members).
  Matrix angles(const Batch& states) const;

  /// Rates of [theta, theta'] (2 n, members), in O(n) a member and row. Motions return to guides
  /// and pins at the return rate, and keep those that are met. Rows that depend on others are
  /// enforced once. NaN if a direction has no inertia.
  void rhs(const Batch& batch, double* rates) const;
  /// Rates of redundant states (6 n, members), of which only the angles of the joints and their
  /// rates are read. Motions do not return to guides and pins.
  void redundant_rhs(const Batch& states, double* rates) const;
  /// Rates of [theta, theta', work done] (2 n + 1, members).
  void rhs_and_power(const Batch& batch, double* rates) const;

  /// Linearisation about one state: the moments that J_0 needs, and the system for z. Rows that
  /// depend on others have no entry in z.
  struct Linear {
    // Moments of forces along the rows and further moments on the segments (n), and derivative of
    // each by its segment's angle (n); empty if there are none.
    Vector moments, slopes;
    Matrix r, e, x;  // R (size of z, n), E (size of z, 2 n), X (n, size of z)
    Vector compliance;
  };
  /// Linearisation about the state of the batch. rate: k; it is 0 for `redundant_rhs`.
  Linear linearised(const Batch& one, double rate) const;
  /// Jacobian of `rhs` for each member (members, 2 n, 2 n), row-major.
  void jacobian(const Batch& batch, double* out) const { derivative(batch, return_rate, out); }
  /// Jacobian as in `jacobian`, for any return rate.
  void derivative(const Batch& batch, double rate, double* out) const;

  /// Rates of each member, followed by their derivatives by the speed and by the state (members, 2
  /// + 2 n, 2 n).
  void linearise(const Batch& batch, double* out) const;

  /// Energy of states [theta, theta'] (members,); 0 for the straight pipe at rest.
  void energy(const Batch& batch, double* out) const;
  /// Powers of flow, joints, drag, others (terms and modules written in Python) and base, as in
  /// Chain::power.
  void power(const Batch& batch, double* out) const;
  void axial(const Batch& batch, double* out) const { chain_.axial(batch, out); }

  /// Replaces angles and rates (n, k) by close ones that meet guides and pins, by Newton's method
  /// with steps of least norm. Returns the largest distance of each from guides and pins (k). If no
  /// angles close by meet them, it exceeds `met`, and the angles are the closest found.
  Vector project(Matrix& theta, Matrix& omega) const;
  static constexpr double met = 1e-13;  // in L; a hundred times the rounding error

  /// Rate k at which a state off guides and pins returns to them. It exceeds the rate at which
  /// flutter turns. With lower rates more of an implicit integrator's errors remain, with higher
  /// rates more of an explicit integrator's.
  static constexpr double return_rate = 60.0;

 private:
  Vector length_;
  double base_;
  CustomForces customs_;
  Chain chain_;
  std::optional<Chain> inertia_;  // the chain without forces, if there are rows or customs
  Vector value_;                  // values of the held coordinates
  Vector compliance_;
  // Coefficients of w . q for each row: the constant from the base; the factors of sin theta_j and
  // cos theta_j; and those of theta_j, from the angles of the joints.
  Vector origin_;
  Matrix across_, along_, joints_;

  /// Scratch of `enforce` for one state or several members; the next call may reuse it.
  struct Rows {
    Matrix sine, cosine;  // of theta, (n + 7, members)
    /// R, and the derivative of each entry by its angle, (n, rows members); the members of a row
    /// are neighbours. If a row weighs nodes alone, w . q is origin_ less the sum of the
    /// derivatives.
    Matrix by_angles, turning;
    Matrix still, response;   // states at rest, and rates with X below (2 n, rows members)
    Matrix products, forces;  // R X + compliance, a member in a column; mu (rows, members)
  };
  /// What modules written in Python add at states that begin with [theta, theta'].
  Matrix custom(const char* what, const Batch& batch) const;
  /// The batch with the moments of these modules, which `moments` keeps.
  Batch loaded(Batch batch, Matrix& moments) const;
  /// Computes sine, cosine, by_angles and turning at the angles theta (n, members).
  void set_rows(const Matrix& theta, Rows& rows) const;
  /// Adds the effect of the forces along the rows to the chain's accelerations. omega and
  /// acceleration have n rows, each `stride` numbers after the one before; rate: k. Returns the
  /// rows of the last member that depend on others.
  std::vector<Index> enforce(const Matrix& theta, Rows& rows, double rate, const double* omega,
                             double* acceleration, Index stride) const;
  /// Adds the effect of the forces along the rows to the chain's rates (2 n, members).
  void add_rows(const Batch& batch, double rate, double* rates) const;
  /// `project` for one state.
  double project_one(Vector& theta, Vector& omega) const;
  /// Product of M^-1 and moments (n, k) at the angles theta (n, k).
  Matrix solve(const Matrix& theta, const Matrix& moments) const;
};

}  // namespace pipedyn
