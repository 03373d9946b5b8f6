// SPDX-License-Identifier: MIT
//
// The modular route (Modular Modeling Methodology, Orsino 2016 and 2017) to the chain of Orsino and
// Di Giulio: modules write inertia and forces in redundant coordinates (modules.hpp), constraints
// are enforced afterwards, group by group (constraint.hpp, enforcement.hpp). The joint angles have
// no inertia: that in eqs. (2) and (4) is the nodes'.
#pragma once

#include <tuple>
#include <vector>

#include "pipedyn/chain/chain.hpp"
#include "pipedyn/modular/constraint.hpp"
#include "pipedyn/modular/enforcement.hpp"
#include "pipedyn/modular/modules.hpp"

namespace pipedyn {

/// What a scene is made of besides the terms of its pipe. Of the segments their springs are not
/// read.
struct Modules {
  Segments segments{};
  std::vector<TorsionalSpring> springs{};
  std::vector<Constraint> constraints{};  // any order gives the same motion
  std::vector<InertiaRow> inertia{};      // further
  bool flow = false;
  bool drag = false;
};

/// g (m), A (m, 3 n), b (m) and each row's group, counted as given.
struct ConstraintRows {
  Vector residual;
  Triplets matrix;
  Vector right_side;
  std::vector<std::int64_t> group;
};

/// Immutable; one scene may serve many threads. A state y = [q, q'] has 6 n entries. Each function
/// of a state in a Vector throws std::invalid_argument on a wrong size.
class Scene {
 public:
  /// Throws std::invalid_argument where arrays differ in length, a length is not positive, or a
  /// joint, node or coordinate is not the scene's.
  Scene(const Pipe& pipe, const Modules& modules);

  Index segments() const { return length_.size(); }
  Index coordinates() const { return 3 * segments(); }

  /// Coordinates of the straight pipe.
  Vector straight() const;
  RedundantOperators operators() const;

  /// Forces of all modules, without inertia.
  Vector forces(const Vector& y, double u) const;
  Derivatives force_derivatives(const Vector& y, double u) const;

  ConstraintRows constraints(const Vector& y) const;
  Hessians hessians(const Vector& q) const;

  /// States (6 n, k) of segments at absolute angles theta (n, k) that turn at omega (n, k):
  /// r_j = r_{j-1} + l_j (sin theta_j, cos theta_j), phi_j = theta_j - theta_{j-1}.
  Matrix from_angles(const Matrix& theta, const Matrix& omega) const;

  /// dy/dtau (6 n, members), O(n) a member unless inertia couples far nodes. force: further forces
  /// (3 n, members) or null. Accelerations are NaN where a direction has no inertia. What
  /// constraints say twice is enforced once.
  void rhs(const Batch& batch, const double* force, double* rates) const;
  /// Kinetic, elastic and gravity's energy of each member; 0 at rest on the straight pipe.
  void energy(const Batch& batch, double* out) const;
  /// What flow, joints, drag and the pipe's terms add to the energy in unit time.
  void power(const Batch& batch, const PowerParts& out) const;

  /// Angles and rates (n, k) close to those given that meet guides and pins, by Newton's method in
  /// least steps. Returns how far the angles miss them (k), which is above `met` where no such
  /// angles are close by; then they are the closest found.
  Vector project(Matrix& theta, Matrix& omega) const;
  static constexpr double met = 1e-13;  // in L: a hundred times rounding

  /// Rate at which a state off guides and pins returns to them, as fast as flutter turns.
  static constexpr double return_rate = 10.0;

  /// Rates of [theta, theta', work done] (2 n + 1, members). With P the projection above, the state
  /// moves as P(y) does, and y - P(y) decays at return_rate: an integrator's errors off guides and
  /// pins do not grow. Clamps and joints are met to rounding at any angles. NaN where P fails.
  void angle_rates(const Batch& batch, double* rates) const;

  /// Coordinate that moves most in a direction that the constraints allow at q and that has no
  /// inertia, -1 if there is none.
  Index lacking(const Vector& q) const;

 private:
  /// A coordinate of a node that guides or pins hold.
  struct Held {
    Index node;
    Index axis;  // 0 for x, 1 for y
    double value;
  };

  double direction_;
  double base_;
  Vector length_;
  std::tuple<std::vector<Body>, std::vector<TorsionalSpring>, std::vector<TermLoad>,
             std::vector<InternalFlow>, std::vector<Drag>>
      modules_;
  std::vector<Constraint> constraints_;
  std::vector<Held> held_;
  Index rows_ = 0;         // of all constraints
  Index matrix_size_ = 0;  // entries of their A
  Enforcement enforcement_;

  Enforcement assemble(const Pipe& pipe, const Modules& given);
  template <class Work>
  void for_each_module(const Work& work) const;
  template <class Work>
  void for_each_member(const Batch& batch, const Work& work) const;
  Motion motion(const double* y, double u) const;
  double project_one(Vector& theta, Vector& omega) const;
  void fill_constraints(const Motion& motion, double* residual, double* matrix,
                        double* right_side) const;
  int enforce(const Motion& motion, const double* force, double* accelerations) const;
};

}  // namespace pipedyn
