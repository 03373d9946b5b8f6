// SPDX-License-Identifier: MIT
//
// Modules of the modular route (Orsino and Di Giulio, eqs. (2)-(6) and (9)): each writes its
// inertia and forces in the redundant coordinates and knows of no other and of no constraint. A
// module is whatever hides those of Module's functions in which it has a share; t, n and U as in
// chain.hpp.
#pragma once

#include <vector>

#include "pipedyn/modular/enforcement.hpp"
#include "pipedyn/modular/redundant.hpp"

namespace pipedyn {

/// No share in anything.
struct Module {
  /// Throws std::invalid_argument unless it fits a scene of n segments.
  void check(Index) const {}
  void add_inertia(std::vector<InertiaRow>&) const {}
  void add_operators(RedundantOperators&) const {}
  void add_force(const Motion&, const Loads&) const {}
  void add_derivatives(const Motion&, Derivatives&) const {}
  double energy(const Motion&) const { return 0.0; }
  void add_power(const Motion&, ScenePower&) const {}
};

/// Rigid segment j: kinetic energy 1/2 l (|r*'|^2 + eta^2 |r_j' - r_{j-1}'|^2 / l^2),
/// r* = (1 - chi) r_{j-1} + chi r_j, gravity's -gamma l (y* - y* of the straight pipe).
struct Segment : Module {
  Index node = 1;
  double length = 1.0, center = 0.5, gyration_radius = 0.0;
  double weight = 0.0;           // gamma l
  double straight_height = 0.0;  // y* of the straight pipe

  void check(Index) const;
  void add_inertia(std::vector<InertiaRow>& rows) const;
  void add_operators(RedundantOperators& ops) const;
  void add_force(const Motion& motion, const Loads& loads) const;
  double energy(const Motion& motion) const;
};

/// At joint j: energy 1/2 k ((phi - p)^2 - p^2), moment -k (phi - p) - c phi'.
struct TorsionalSpring : Module {
  Index joint;
  double stiffness, damping, rest;

  TorsionalSpring(Index at, double k, double c, double p)
      : joint(at), stiffness(k), damping(c), rest(p) {}
  void check(Index segments) const;
  void add_operators(RedundantOperators& ops) const;
  void add_force(const Motion& motion, const Loads& loads) const;
  void add_derivatives(const Motion& motion, Derivatives& out) const;
  double energy(const Motion& motion) const;
  void add_power(const Motion& motion, ScenePower& out) const;
};

/// At node j: energy 1/2 k x^2.
struct TransverseSpring : Module {
  Index node;
  double stiffness;

  TransverseSpring(Index at, double k) : node(at), stiffness(k) {}
  void check(Index segments) const;
  void add_operators(RedundantOperators& ops) const;
  void add_force(const Motion& motion, const Loads& loads) const;
  void add_derivatives(const Motion& motion, Derivatives& out) const;
  double energy(const Motion& motion) const;
};

/// At node j: force -c x'.
struct Dashpot : Module {
  Index node;
  double coefficient;

  Dashpot(Index at, double c) : node(at), coefficient(c) {}
  void check(Index segments) const;
  void add_operators(RedundantOperators& ops) const;
  void add_force(const Motion& motion, const Loads& loads) const;
  void add_derivatives(const Motion& motion, Derivatives& out) const;
  void add_power(const Motion& motion, ScenePower& out) const;
};

/// At node j: kinetic energy 1/2 m |r'|^2, gravity's -gamma m (y - y of the straight pipe).
struct PointMass : Module {
  Index node;
  double mass;
  double weight = 0.0;           // gamma m, from the scene
  double straight_height = 0.0;  // y of the straight pipe, from the scene

  PointMass(Index at, double m) : node(at), mass(m) {}
  void check(Index segments) const;
  void add_inertia(std::vector<InertiaRow>& rows) const;
  void add_operators(RedundantOperators& ops) const;
  void add_force(const Motion& motion, const Loads& loads) const;
  double energy(const Motion& motion) const;
};

/// -sqrt(beta) U r_j' on r_{j-1} and sqrt(beta) U r_{j-1}' on r_j for each segment; at the end
/// -sqrt(beta) U r_n' - a U^2 t_n, t_n = (r_n - r_{n-1}) / l_n. The centrifugal part of the
/// Lagrangian along a segment is taken up by its rigidity.
struct InternalFlow : Module {
  Index segments = 1;
  double last_length = 1.0;
  double sqrt_beta = 0.0, centrifugal = 1.0;

  void add_operators(RedundantOperators& ops) const;
  void add_force(const Motion& motion, const Loads& loads) const;
  void add_derivatives(const Motion& motion, Derivatives& out) const;
  void add_power(const Motion& motion, ScenePower& out) const;
};

/// On segment j at the fraction xi: -kappa l |v| v n, v = n . ((1 - xi) r_{j-1}' + xi r_j'),
/// n = (t_y, -t_x), t = (r_j - r_{j-1}) / l.
struct Drag : Module {
  Index node = 1;
  double length = 1.0, point = 0.5, coefficient = 0.0;  // kappa

  void add_force(const Motion& motion, const Loads& loads) const;
  /// Its share is 2 |v| dv, 0 where v = 0.
  void add_derivatives(const Motion& motion, Derivatives& out) const;
  void add_power(const Motion& motion, ScenePower& out) const;

 private:
  Point normal(const Motion& motion) const;
  Point velocity(const Motion& motion) const;
};

/// 1/2 q'^T W q' with a constant W, symmetric and positive semidefinite.
struct FurtherInertia : Module {
  Triplets matrix;

  void check(Index segments) const;
  /// By elimination from the last coordinate, so that what couples neighbours has local rows.
  void add_inertia(std::vector<InertiaRow>& rows) const;
  void add_operators(RedundantOperators& ops) const;
  double energy(const Motion& motion) const;
};

}  // namespace pipedyn
