// SPDX-License-Identifier: MIT
//
// The modular route: modules write their inertia and forces in the redundant coordinates
// x_j, y_j, phi_j (j = 1..n, at 3 (j - 1), 3 (j - 1) + 1, 3 (j - 1) + 2), constraints are enforced
// afterwards, group by group (enforcement.hpp). r_j = (x_j, y_j) is node P_j, x across, y down from
// the clamp; r_0 = (0, base) stays. Equations (1)-(11) of Orsino and Di Giulio, with U = s u.
// The joint angles phi have no inertia: that in eqs. (2) and (4) is the nodes'.
#pragma once

#include <cstdint>
#include <vector>

#include "pipedyn/chain.hpp"
#include "pipedyn/enforcement.hpp"
#include "pipedyn/pipe.hpp"

namespace pipedyn {

/// Entries (row, column, value) of a sparse matrix; those of one place add up.
struct Triplets {
  std::vector<std::int64_t> rows, columns;
  std::vector<double> values;

  void add(Index row, Index column, double value) {
    rows.push_back(row);
    columns.push_back(column);
    values.push_back(value);
  }
};

/// At joint j: energy 1/2 k ((phi - p)^2 - p^2), moment -k (phi - p) - c phi'.
struct TorsionalSpring {
  Index joint;
  double stiffness, damping, rest;
};

/// At node j: energy 1/2 k x^2.
struct TransverseSpring {
  Index node;
  double stiffness;
};

/// At node j: force -c x'.
struct Dashpot {
  Index node;
  double coefficient;
};

/// At node j: kinetic energy 1/2 m |r'|^2, gravity's -gamma m (y - y of the straight pipe).
struct PointMass {
  Index node;
  double mass;
};

/// Constraints on the coordinates, g = 0, with a = r_j - r_{j-1}, d = r_{j-1} - r_{j-2}:
///   clamp (eq. (10), j = 1): (y_1 - base) - l_1 cos phi_1,  x_1 - l_1 sin phi_1
///   joint (eq. (11), j >= 2): a . d / l_{j-1} - l_j cos phi_j,
///                             (a_x d_y - a_y d_x) / l_{j-1} - l_j sin phi_j
///   guide: x_j      pin: x_j - x, y_j - y
/// Twice differentiated: A q'' = b.
struct Constraint {
  enum class Kind : std::int64_t { clamp, joint, guide, pin };
  Kind kind;
  Index node;
  double x = 0.0, y = 0.0;

  int rows() const { return kind == Kind::guide ? 1 : 2; }
};

/// What a scene is made of. Segment j of Segments (its springs are not read; mass l_j):
///   kinetic energy 1/2 l (|r*'|^2 + eta^2 |r_j' - r_{j-1}'|^2 / l^2),
///   r* = (1 - chi) r_{j-1} + chi r_j, gravity's -gamma l (y* - y* of the straight pipe).
/// Flow, derived from eqs. (2)-(6): -sqrt(beta) U r_j' on r_{j-1} and sqrt(beta) U r_{j-1}' on r_j
/// for each segment, -sqrt(beta) U r_n' - a U^2 t_n on r_n; the centrifugal part of the Lagrangian
/// along a segment is taken up by its rigidity.
/// Drag (eq. (9)): -kappa l |v| v n at the drag point, v = n . ((1 - xi) r_{j-1}' + xi r_j'),
/// n = (t_y, -t_x), t = (r_j - r_{j-1}) / l.
struct Modules {
  Segments segments;
  std::vector<TorsionalSpring> springs;
  std::vector<TransverseSpring> transverse_springs;
  std::vector<Dashpot> dashpots;
  std::vector<PointMass> masses;
  std::vector<Constraint> constraints;  // in the order of enforcement
  Triplets inertia;                     // further inertia, symmetric and positive semidefinite
  bool flow = false;
  bool drag = false;
};

/// About the straight pipe: the forces are
///   -(stiffness + a u^2 flux) q - (s u (gyroscopic + end_flux) + damping) q' + constants
/// without drag; each (3 n, 3 n). Gravity's potential is linear, hence absent.
struct RedundantOperators {
  Triplets mass, gyroscopic, end_flux, damping, stiffness, flux;
};

/// g (m), A (m, 3 n), b (m) and each row's group, counted as given.
struct ConstraintRows {
  Vector residual;
  Triplets matrix;
  Vector right_side;
  std::vector<std::int64_t> group;
};

/// Derivatives by the coordinates and by their rates.
struct Derivatives {
  Triplets by_coordinates, by_rates;
};

/// What flow, joints, drag and dashpots add to the energy in unit time, an entry a member.
struct ScenePowerParts {
  double *flow, *joints, *drag, *others;
};

/// Immutable; one scene may serve many threads. A state y = [q, q'] has 6 n entries. Each function
/// of a state throws std::invalid_argument on a wrong size.
class Scene {
 public:
  /// Throws std::invalid_argument where arrays differ in length, a joint or node is not the
  /// scene's, an inertia or a mass is negative, or further inertia is not symmetric.
  Scene(const Pipe& pipe, Modules modules);

  Index segments() const { return modules_.segments.length.size(); }
  Index coordinates() const { return 3 * segments(); }

  /// Coordinates of the straight pipe.
  Vector straight() const;
  RedundantOperators operators() const;

  /// Forces of all modules, without inertia.
  Vector forces(const Vector& y, double u) const;
  /// Drag's share is 2 |v| dv, 0 where v = 0.
  Derivatives force_derivatives(const Vector& y, double u) const;

  ConstraintRows constraints(const Vector& y) const;
  /// sum_i multipliers_i d2 g_i / dq2 (3 n, 3 n).
  Triplets curvature(const Vector& q, const Vector& multipliers) const;
  /// Of A a - b (m, 3 n), with a held.
  Derivatives acceleration_derivatives(const Vector& y, const Vector& acceleration) const;

  /// States (6 n, k) of segments at absolute angles theta (n, k) that turn at omega (n, k):
  /// r_j = r_{j-1} + l_j (sin theta_j, cos theta_j), phi_j = theta_j - theta_{j-1}.
  Matrix from_angles(const Matrix& theta, const Matrix& omega) const;

  /// dy/dtau (6 n, members), O(n) a member unless far coordinates are coupled. force: further
  /// forces (3 n, members) or null. NaN accelerations where a direction has no inertia.
  void rhs(const Batch& batch, const double* force, double* rates) const;
  /// Kinetic, elastic and gravity's energy of each member; 0 at rest on the straight pipe.
  void energy(const Batch& batch, double* out) const;
  void power(const Batch& batch, const ScenePowerParts& out) const;

  /// Coordinate that moves most in a direction that the constraints allow at q and that has no
  /// inertia, -1 if there is none.
  Index lacking(const Vector& q) const;

 private:
  Pipe pipe_;
  Modules modules_;
  Vector joint_stiffness_, joint_damping_, joint_moment_;  // sums at each joint; moment: k p
  Vector weight_;                                          // gravity's force on y_j
  std::vector<std::size_t> matrix_start_;  // of each group in the constraints' values
  Index rows_ = 0;
  Enforcement enforcement_;

  void add_forces(const double* q, const double* rates, double u, double* force) const;
  void fill_constraints(const double* q, const double* rates, double* residual, double* matrix,
                        double* right_side) const;
  void require(const char* name, Index size, Index expected) const;
};

}  // namespace pipedyn
