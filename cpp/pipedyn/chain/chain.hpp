// SPDX-License-Identifier: MIT
//
// Chain of n rigid segments joined by torsional springs (Orsino and Di Giulio, eqs. (1)-(11)).
//
// Files in which the paper's equations are used:
//   (1)       Hamilton's principle     this file, below: the equation of motion of each segment
//   (2), (5)  Lagrangian               chain/sweeps.hpp, recursion in O(n)
//   (3), (6)  momentum through the end chain/sweeps.hpp
//   (4)       centres, tangents        chain/sweeps.hpp
//   (7), (8)  end coefficient          python/pipedyn/models/end_coefficient.py
//   (9)       drag                     chain/sweeps.hpp
//   (10), (11) clamp and joints        any angles satisfy them; modular/scene.hpp
// tests/redundant.py has (2)-(6) and (9)-(11) in redundant coordinates. galerkin/galerkin.hpp has
// the limit of short segments, and its linear equation.
//
// Linearised about the straight pipe, with the angle theta_j of segment j and p_k = l_k sum_{i>k}
// l_i + chi_k l_k^2, row k of the equations of motion is
//
//   sum_i M_ki theta_i'' + sqrt(beta) U (l_k^2 theta_k' + 2 sum_{i>k} l_k l_i theta_i')
//     - (1 - c) sqrt(beta) U l_k sum_i l_i theta_i' + a U^2 l_k (theta_n - theta_k)
//     + gamma cos(iota) p_k theta_k
//     + (1 + delta d/dtau) (k_k phi_k - k_{k+1} phi_{k+1}) = 0,     phi_j = theta_j - theta_{j-1},
//
// with U = s u. A joint may have a damping c_k of its own in place of delta k_k, and an angle psi_k
// at which it has no moment, so that its moment is k_k (phi_k - psi_k). Two sets of coordinates are
// used: the angles theta, and the joint angles phi, in which the elastic stiffness is diagonal and
// small eigenvalues stay accurate despite rounding at any n.
//
// How the pipe is held (pipe.hpp): a root's spring k_r lies in series with the first joint. In
// place of 1 / k_1 both together have the compliance 1 / k = 1 / k_1 + 1 / k_r and, to first order
// in the damping, c_1 = delta k^2 / k_1: the root's spring is undamped, and c_1 becomes negligible
// beside k_r as n grows. A guided or clamped end keeps the direction of the axis: there is a joint
// n + 1 with phi_{n+1} = -theta_n, the mirror image of the clamp's joint, and the flow leaves along
// the axis, so that a U^2 l_k (theta_n - theta_k) has 0 in place of theta_n. Supports that hold x
// of nodes are not part of the chain; they are in modular/scene.hpp.
//
// At any amplitude, with c_ki = l_min(k,i) p_max(k,i) (k != i) and c_kk = M_kk, row k reads
//   sum_i c_ki (cos(theta_k - theta_i) theta_i'' + sin(theta_k - theta_i) theta_i'^2)
//     + sqrt(beta) U (l_k^2 theta_k' + 2 sum_{i>k} l_k l_i cos(theta_k - theta_i) theta_i')
//     - (1 - c) sqrt(beta) U l_k sum_i l_i cos(theta_k - theta_i) theta_i'
//     + sqrt(beta) U' l_k sum_{i>k} l_i sin(theta_i - theta_k)
//     + a U^2 l_k sin(theta_n + psi - theta_k)
//     + X'' p_k cos theta_k - Y'' p_k sin theta_k + gamma p_k sin(theta_k - iota)
//     + (1 + delta d/dtau) (k_k phi_k - k_{k+1} phi_{k+1}) = drag_k,
// where the jet leaves at the angle psi to the last segment, the inflow has the share c of the free
// end's velocity, and the force -kappa l_j |v_j| v_j acts across each segment at its drag point.
// The equations are solved in O(n). The base, which carries the clamp, may move, at the position
// (X, Y) as a function of time; the velocities of inflow and drag then include that of the base.
//
// Rotary inertia J of the cross-sections adds J l_j to the inertia of segment j about its centre,
// which is the effect of a larger radius of gyration.
//
// If the mass per length of the pipe varies, segments have masses m_j in place of l_j: sum_{i>k}
// l_i in M and p_k becomes the mass beyond segment k. The terms of the flow keep the lengths, since
// the fluid's mass per length does not vary.
//
// The terms of the pipe (terms/) act at places of the segments (stations.hpp). A mass on a segment
// changes the segment's own mass, centre and radius of gyration; rotary inertia changes its radius.
// With n_j the normal of segment j, a load f at an arm a of segment j adds -l_k n_k . f to row k
// for k < j and -a n_j . f to row j; a couple c adds -c to row j. A load where two segments meet
// belongs to the segment that ends there and turns with it. Mass that has inertia only across the
// segments adds to entry (k, i) of the mass matrix sum_j m_j (n_j . n_k) (n_j . n_i) l_k l_i over
// the segments j beyond k and i, and the part of the last segment of the two itself.
#pragma once

#include <complex>
#include <vector>

#include "pipedyn/chain/dynamic_stiffness.hpp"
#include "pipedyn/chain/motion.hpp"
#include "pipedyn/pipe.hpp"
#include "pipedyn/vector/levels.hpp"

namespace pipedyn {

/// The segments of a chain: arrays with one entry a segment, from the clamp to the free end.
struct Segments {
  Vector length;           // l_j; with the base they sum to 1
  Vector center;           // chi_j, centre of mass as a fraction of the length
  Vector gyration_radius;  // eta_j, about the centre of mass
  // k_j of the joint at the segment's clamped side; for a guided or clamped end one entry more, of
  // the joint between the last segment and the end
  Vector spring;
  Vector drag_point;     // xi_j, as a fraction of the length
  double base = 0.0;     // length of the fixed part at the clamp
  Vector damping{};      // c_j, one entry a spring; if empty delta k_j
  Vector rest_moment{};  // k_j psi_j, psi_j the angle at which joint j has no moment; if empty 0
  Vector mass{};         // mass of each, in units of the pipe's mass; if empty its length
};

/// A chain of rigid segments with its pipe. Immutable; many threads may use one chain.
class Chain {
 public:
  /// Throws std::invalid_argument if the arrays differ in length or are empty.
  Chain(const Pipe& pipe, Segments segments);

  const Pipe& pipe() const { return pipe_; }
  Index dof() const { return segments_.length.size(); }

  /// Operators in the angles theta, in O(n^2), about the configuration at rest `angles` (n), or, if
  /// that is empty, about the straight pipe: the factors of theta'' and theta', and the derivatives
  /// of the moments of springs, gravity and loads (stiffness) and of the follower force (flux).
  /// joints: whether springs and dampers of the joints between segments are included. Throws
  /// std::invalid_argument unless there is one angle a segment.
  Operators operators(const Vector& angles = Vector(), bool joints = true) const;

  /// Product of x with a sum of the operators in the joint angles, whose factors part gives, in
  /// O(n) a column; x and the result have shape (n, k). Throws std::invalid_argument unless x has
  /// one row a segment.
  Matrix joint_times(const Matrix& x, const LinearPart& part) const;

  /// A chain of the same masses without any force: under moments f on the segments, its rates at
  /// rest are theta'' = M^-1 f.
  Chain without_forces() const;

  /// This chain with guides at the ends of the segments for which `held` (n) is true. The guides
  /// act in the linear problem of dynamic_stiffness.hpp alone.
  Chain guided(std::vector<bool> held) const;

  /// The segments with the masses of terms on them: columns mass, center, gyration_radius, and the
  /// mass that has inertia only across the segment (n, 4).
  Matrix bodies() const;

  /// What the kernels read; it points into the chain, and is valid as long as the chain exists.
  ChainModel model() const;
  /// Spring, damping and moment at rest of each joint, a row for each (joints, 3). The first joint
  /// includes the root's spring; the joint of a guided end is the last row.
  Matrix joints() const;
  const Vector& springs() const { return segments_.spring; }
  /// Joint angle for a unit of each elastic coordinate (n): 1 / sqrt(k_j). A joint whose spring is
  /// 0 or below 1e-3 of the mean takes its scale from the mean.
  Vector elastic_scale() const;
  /// Whether a joint, or the root of the pipe, has no spring.
  bool turns_freely() const { return springs().minCoeff() <= 0.0; }
  /// Derivatives of the displacements of the held ends by the joint angles in units of scale (n); a
  /// column for each held end (n, held ends).
  Matrix held_rows(const Vector& scale) const;
  /// A chain that approximates this one: neighbouring segments are joined, so that about `segments`
  /// remain, and more where ends are held.
  Chain coarser(Index segments) const;

  // Motion, computed with the vector instructions of the processor (levels.hpp). A state y =
  // [theta, theta'] has 2 n entries; each column of a batch is a state. The caller provides arrays
  // of the sizes given; scratch belongs to the thread and is allocated by its first call for a
  // size.

  /// Rates dy/dtau (2 n, members), in O(n) a member.
  void rhs(const Batch& batch, double* rates) const { motion_kernel().rhs(model(), batch, rates); }
  /// Rates of [theta, theta', W] (2 n + 1, members), where W' is the sum of the powers. An
  /// integrator integrates W with the order of its method, so that E(t) - E(0) - W(t) measures the
  /// error of a motion.
  void rhs_and_power(const Batch& batch, double* rates) const {
    motion_kernel().rhs_and_power(model(), batch, rates);
  }
  /// MotionKernel::axial of [theta, theta', theta''] (3 n, members), in O(n) a member.
  void axial(const Batch& batch, double* out) const { motion_kernel().axial(model(), batch, out); }
  /// Jacobians d(dy/dtau)/dy (members, 2 n, 2 n), row-major, in O(n^2) a member. The derivative of
  /// drag is 2 |v| dv, which is 0 where v = 0; moments of the batch change by their slopes.
  void jacobian(const Batch& batch, double* out) const {
    motion_kernel().jacobian(model(), batch, out);
  }
  /// Solution of (mu - J) x = b for MotionKernel::shifts complex mu at once, J the Jacobian of a
  /// state, in O(n). `factorise` fills factors, an array of factor_numbers() numbers; `solve`
  /// replaces b (2 n, 2 shifts) by x. Real parts stand before imaginary parts, in mu as well.
  Index factor_numbers() const { return motion_kernel().factor_numbers(model()); }
  void factorise(const Batch& one, const double* mu, double* factors) const {
    motion_kernel().factorise(model(), one, mu, factors);
  }
  void solve(double* factors, double* b) const { motion_kernel().solve(model(), factors, b); }
  /// Energy of each member (members,): kinetic, elastic and gravitational energy in the frame of
  /// the base, and the terms' energy in the frame of the ground. It is 0 for the straight pipe at
  /// rest.
  void energy(const Batch& batch, double* out) const {
    motion_kernel().energy(model(), batch, out);
  }
  /// Powers of flow, joints, drag, terms (others) and the base's motion (5, members); their sum is
  /// dE/dtau.
  void power(const Batch& batch, double* out) const { motion_kernel().power(model(), batch, out); }

 private:
  Pipe pipe_;
  Segments segments_;      // centres and radii include the masses of terms
  Vector first_moment_;    // p_k
  Vector damped_springs_;  // dc_j / ddelta of joints that have the pipe's damping
  double end_spring_ = 0.0, end_damping_ = 0.0;
  std::vector<bool> held_;  // whether a guide holds the end of each segment
  bool bent_;               // whether any joint is bent at rest
  std::vector<Link> links_;
  std::vector<SegmentTerm> loads_;
  std::vector<StiffnessSegment> dynamic_stiffnesses_;  // about the straight pipe

  const Link& link(Index j) const { return links_[static_cast<std::size_t>(j)]; }
  void linearise();
  /// Product of x, changes of the angles of the segments (n, k), with a sum of the operators about
  /// the configuration at rest `angles` (n), without the joints between segments. It takes O(n) a
  /// column.
  Matrix moments(const Matrix& x, const LinearPart& part, const Vector& angles) const;
  /// Factors of the joint angles in the moments of the joints between segments (n).
  Vector joint_factors(const LinearPart& part) const;
};

/// Positions x and y of the end of segments of given lengths (n,) from their start, and its
/// velocities x' and y', (4, k), at angles and rates (k, n).
using StateRows = Eigen::Ref<const Matrix, 0, Eigen::Stride<Eigen::Dynamic, Eigen::Dynamic>>;
Matrix ends(const StateRows& angles, const StateRows& rates, const Vector& lengths);

}  // namespace pipedyn
