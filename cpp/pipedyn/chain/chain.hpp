// SPDX-License-Identifier: MIT
//
// Chain of n rigid segments joined by torsional springs (Orsino and Di Giulio, eqs. (1)-(11)).
//
// Where the paper's equations stand:
//   (1)       Hamilton's principle     this file, below: what it gives for each segment
//   (2), (5)  Lagrangian               chain/sweeps.hpp, recursion in O(n)
//   (3), (6)  momentum through the end chain/sweeps.hpp
//   (4)       centres, tangents        chain/sweeps.hpp
//   (7), (8)  end coefficient          python/pipedyn/models/end_coefficient.py
//   (9)       drag                     chain/sweeps.hpp
//   (10), (11) clamp and joints        met by the angles; modular/scene.hpp
// (2)-(6) and (9)-(11) in redundant coordinates: tests/redundant.py.
// Their limit for short segments, with its linear equation: galerkin/galerkin.hpp.
//
// Linear about the straight pipe, with the angle theta_j of segment j and p_k = l_k sum_{i>k} l_i
// + chi_k l_k^2, row k reads
//
//   sum_i M_ki theta_i'' + sqrt(beta) U (l_k^2 theta_k' + 2 sum_{i>k} l_k l_i theta_i')
//     - (1 - c) sqrt(beta) U l_k sum_i l_i theta_i' + a U^2 l_k (theta_n - theta_k)
//     + gamma p_k theta_k
//     + (1 + delta d/dtau) (k_k phi_k - k_{k+1} phi_{k+1}) = 0,     phi_j = theta_j - theta_{j-1},
//
// U = s u. Joints may have a damping c_k of their own in place of delta k_k, and an angle
// psi_k at which they rest, in k_k (phi_k - psi_k). Two coordinates are used: the angles theta, and
// the joint angles phi, in which the elastic stiffness is diagonal and small eigenvalues survive
// rounding at any n.
//
// How the pipe is held (pipe.hpp): a root's spring k_r lies in series with the first joint, which
// has 1 / k_1 + 1 / k_r for 1 / k_1 and, to first order in the damping, c_1 = delta k^2 / k_1 with
// k of both: the root's spring is undamped, and c_1 vanishes beside k_r as n grows. A guided or
// clamped end keeps the direction of the axis: a joint n + 1 with phi_{n+1} = -theta_n, the mirror
// image of the clamp's, and a flow that leaves along the axis, so that 0 stands for theta_n in a
// U^2 l_k (theta_n - theta_k). What holds x of nodes is no part of the chain: modular/scene.hpp.
//
// At any amplitude, with c_ki = l_min(k,i) p_max(k,i) (k != i), c_kk = M_kk, t the tangents,
//   sum_i c_ki (cos(theta_k - theta_i) theta_i'' + sin(theta_k - theta_i) theta_i'^2)
//     + sqrt(beta) U (l_k^2 theta_k' + 2 sum_{i>k} l_k l_i cos(theta_k - theta_i) theta_i')
//     - (1 - c) sqrt(beta) U l_k sum_i l_i cos(theta_k - theta_i) theta_i'
//     + sqrt(beta) U' l_k sum_{i>k} l_i sin(theta_i - theta_k)
//     + a U^2 l_k sin(theta_n + psi - theta_k)
//     + X'' p_k cos theta_k + (gamma - Y'') p_k sin theta_k
//     + (1 + delta d/dtau) (k_k phi_k - k_{k+1} phi_{k+1}) = drag_k,
// where the jet leaves at the angle psi to the last segment, the inflow has the share c of the free
// end's velocity and the force -kappa l_j |v_j| v_j acts across each segment at its drag point;
// solved in O(n). The base, with the clamp, may stand at (X, Y), functions of time: inflow and drag
// then see its velocity, too.
//
// Rotary inertia J of the cross-sections adds J l_j to the inertia of segment j about its centre,
// as a larger radius of gyration does.
//
// Segments of a pipe whose mass per length varies have masses m_j in place of l_j: sum_{i>k} l_i in
// M and p_k becomes the mass beyond, while the flow's terms keep the lengths, as the fluid's share
// does not vary.
//
// The terms of the pipe (terms/) act at places of the segments (stations.hpp). A mass on a segment
// changes the segment's own mass, centre and radius of gyration, and rotary inertia its radius. A
// load f at an arm a of segment j adds -n_k . f times l_k, k < j, or a, k = j, to row k, and a
// couple c adds -c to row j: what acts where two segments meet turns with the one that ends there.
// Mass that moves across the segments alone adds sum_j m_j (n_j . n_k) (n_j . n_i) l_k l_i, j
// beyond both, and its own share on the last of them.
#pragma once

#include <complex>
#include <vector>

#include "pipedyn/chain/impedance.hpp"
#include "pipedyn/chain/motion.hpp"
#include "pipedyn/pipe.hpp"

namespace pipedyn {

/// The segments of a chain, one entry a segment, from the clamp to the free end.
struct Segments {
  Vector length;           // l_j; with the base they sum to 1
  Vector center;           // chi_j, centre of mass as a fraction of the length
  Vector gyration_radius;  // eta_j, about the centre of mass
  Vector spring;         // k_j, joint at the segment's clamped side; of a guided or clamped end one
                         // more, of the joint between the last segment and the end
  Vector drag_point;     // xi_j, as a fraction of the length
  double base = 0.0;     // length of the fixed part at the clamp
  Vector damping{};      // c_j of the joints, as many; where empty delta k_j
  Vector rest_moment{};  // k_j psi_j, of joints at rest at the angle psi_j; where empty 0
  Vector mass{};         // of each, in the pipe's; where empty its length
};

/// Immutable; one chain may serve many threads.
class Chain {
 public:
  /// Throws std::invalid_argument if the arrays differ in length or are empty.
  Chain(const Pipe& pipe, Segments segments);

  const Pipe& pipe() const { return pipe_; }
  Index dof() const { return segments_.length.size(); }

  /// Operators in the angles theta, O(n^2), about the straight pipe or a configuration at rest (n):
  /// what multiplies theta'' and theta' there, and the derivatives of the moments of springs,
  /// gravity and loads (stiffness) and of the follower force (flux). Throws std::invalid_argument
  /// unless there is one angle a segment.
  Operators operators(const Vector& angles = Vector()) const;

  /// Operators in the joint angles divided by scale, phi = scale * z, O(n^2). Throws
  /// std::invalid_argument unless scale has one entry a segment.
  Operators joint_operators(const Vector& scale) const;

  /// Product with a part of the operators in the joint angles, in O(n); x and the result (n, k).
  /// Throws std::invalid_argument unless x has one row a segment.
  Matrix joint_times(const Matrix& x, const LinearPart& part) const;

  /// The same masses without any force: its rates under further moments f are theta'' = M^-1 f.
  Chain without_forces() const;

  /// The same with guides at the ends of those segments that are held (n), in `impedance` alone.
  Chain guided(std::vector<bool> held) const;

  /// The segments with the masses of terms on them: mass, center, gyration_radius, and the mass
  /// that moves across alone (n, 4).
  Matrix bodies() const;

  /// The linear problem for the recursion in impedance.hpp; valid as long as the chain is.
  ImpedanceModel impedance() const;
  /// Spring, damping and moment at rest of each joint, with a root's and a guided end's (joints,
  /// 3).
  Matrix joints() const;
  const Vector& springs() const { return segments_.spring; }
  /// Whether two chains have one linear problem without flow.
  bool is_same_at_rest(const Chain& other) const { return impedances_ == other.impedances_; }
  /// Displacements of the held ends by joint angles in units of scale (n), (n, how many).
  Matrix held_rows(const Vector& scale) const;
  /// A chain of about so many segments, and more where ends are held, that moves like this one:
  /// neighbours joined.
  Chain coarser(Index segments) const;

  /// The places of the terms' loads: segment from 0, arm, and weight, which a load counts (k, 3).
  Matrix places() const;
  /// The laws' loads there (k, 3), without the weights, at stations (k, 8) with the columns of
  /// Station. Throws std::invalid_argument unless there is a station for each place.
  Matrix loads(const Matrix& stations) const;

  // Motion, with the vectors that the processor has (levels.hpp). A state y = [theta, theta'] has
  // 2 n entries; a batch holds one a column. The arrays are the caller's and of the sizes given;
  // scratch belongs to the thread and is allocated by its first call for a size.

  /// dy/dtau (2 n, members), O(n) a member.
  void rhs(const Batch& batch, double* rates) const;
  /// Those of [theta, theta', W] (2 n + 1, members), W' the sum of the power: an integrator sums it
  /// to its own order, so that E(t) - E(0) - W(t) audits a motion.
  void rhs_and_power(const Batch& batch, double* rates) const;
  /// MotionKernel::axial of [theta, theta', theta''] (3 n, members), O(n) a member.
  void axial(const Batch& batch, double* out) const;
  /// d(dy/dtau)/dy (members, 2 n, 2 n), row-major, O(n^2) a member. Drag's share is 2 |v| dv, 0
  /// where v = 0; further moments change by their slopes.
  void jacobian(const Batch& batch, double* out) const;
  /// (mu - J) x = b for MotionKernel::shifts complex mu, J the Jacobian of a state, in O(n):
  /// factors with room for factor_numbers() make b (2 n, 2 shifts) x. Real parts are first, in mu
  /// too.
  Index factor_numbers() const;
  void factorise(const Batch& one, const double* mu, double* factors) const;
  void solve(double u, double* factors, double* b) const;
  /// Kinetic, elastic and gravity's energy of each member, in the frame of the base, and the terms'
  /// on the ground; 0 at rest on the straight pipe.
  void energy(const Batch& batch, double* out) const;
  /// What flow, joints, drag, terms (others) and the base's motion add to the energy in unit time,
  /// (5, members); their sum is dE/dtau.
  void power(const Batch& batch, double* out) const;

 private:
  Pipe pipe_;
  Segments segments_;      // centre and radius with the masses of terms
  Vector first_moment_;    // p_k
  Vector damped_springs_;  // dc_j / ddelta where the joints' damping is the pipe's
  double end_spring_ = 0.0, end_damping_ = 0.0;
  std::vector<bool> held_;  // see `guided`
  bool damped_, bent_;      // any joint, the second at rest
  std::vector<Link> links_;
  std::vector<SegmentTerm> loads_;
  std::vector<ImpedanceSegment> impedances_;  // about the straight pipe

  const Link& link(Index j) const { return links_[static_cast<std::size_t>(j)]; }
  void linearise();
  void add_loads(const Vector& angles, const Vector& sine, const Vector& cosine,
                 Operators& ops) const;
  void add_normal_mass(const Vector& sine, const Vector& cosine, Matrix& mass) const;
  MotionModel motion() const;
};

}  // namespace pipedyn
