// SPDX-License-Identifier: MIT
//
// Modules of the modular route (Orsino and Di Giulio, eqs. (2)-(6) and (9)): each writes its
// inertia and forces in the redundant coordinates and knows of no other and of no constraint. A
// module redefines those of Module's functions in which it has a share; t, n and U as in
// chain.hpp.
#pragma once

#include <vector>

#include "pipedyn/modular/enforcement.hpp"
#include "pipedyn/modular/redundant.hpp"

namespace pipedyn {

/// A module without effect.
struct Module {
  void add_force(const Motion&, const Loads&) const {}
  void add_derivatives(const Motion&, Derivatives&) const {}
  /// Potential energy.
  double energy(const Motion&) const { return 0.0; }
  void add_power(const Motion&, Power&) const {}
};

/// A mass m on segment j, the segment's own or a term's: kinetic energy
/// 1/2 m (|r*'|^2 + (eta / l)^2 |r_j' - r_{j-1}'|^2), r* = (1 - chi) r_{j-1} + chi r_j, gravity's
/// -gamma m (y* - y* of the straight pipe).
struct Body : Module {
  Index node;
  double mass, center, turning;  // m, chi, eta / l
  double weight;                 // gamma m
  double straight_height;        // y* of the straight pipe

  void add_inertia(std::vector<InertiaRow>& rows) const;
  void add_force(const Motion&, const Loads& loads) const {
    loads.add(node - 1, {0.0, (1.0 - center) * weight});
    loads.add(node, {0.0, center * weight});
  }
  double energy(const Motion& motion) const {
    const double above = motion.place(node - 1).y(), below = motion.place(node).y();
    return -weight * ((1.0 - center) * above + center * below - straight_height);
  }
};

/// At joint j: energy 1/2 k ((phi - p)^2 - p^2), moment -k (phi - p) - c phi'.
struct TorsionalSpring : Module {
  Index joint;
  double stiffness, damping, rest;

  TorsionalSpring(Index at, double k, double c, double p)
      : joint(at), stiffness(k), damping(c), rest(p) {}
  void add_force(const Motion& motion, const Loads& loads) const {
    const double bent = motion.place.angle(joint) - rest;
    loads.add_moment(joint, -stiffness * bent - damping * motion.rate.angle(joint));
  }
  void add_derivatives(const Motion&, Derivatives& out) const {
    out.by_coordinates.add(phi_of(joint), phi_of(joint), -stiffness);
    out.by_rates.add(phi_of(joint), phi_of(joint), -damping);
  }
  double energy(const Motion& motion) const {
    const double phi = motion.place.angle(joint);
    return 0.5 * stiffness * phi * (phi - 2.0 * rest);
  }
  void add_power(const Motion& motion, Power& out) const {
    const double turning = motion.rate.angle(joint);
    out.joints -= damping * turning * turning;
  }
};

/// A station on segment j: r = (1 - xi) r_{j-1} + xi r_j. A force f there is (1 - xi) f and xi f on
/// the nodes; it counts `weight` times.
struct Place {
  Index node;
  double point, weight;  // xi
};

/// The load of one of the pipe's terms.
struct TermLoad : Module {
  Place place;
  Term term;

  TermLoad(const Place& at, const Term& of) : place(at), term(of) {}
  void add_force(const Motion& motion, const Loads& loads) const;
  void add_derivatives(const Motion& motion, Derivatives& out) const;
  double energy(const Motion& motion) const;
  void add_power(const Motion& motion, Power& out) const;
};

/// -kappa l |v| v n at the drag point of a segment of length l, v = n . r', n = (t_y, -t_x),
/// t = (r_j - r_{j-1}) / l. Its derivative has the share 2 |v| dv, 0 where v = 0.
struct Drag : Module {
  Place place;  // weight: l
  double coefficient;

  Drag(const Place& at, double kappa) : place(at), coefficient(kappa) {}
  void add_force(const Motion& motion, const Loads& loads) const;
  void add_derivatives(const Motion& motion, Derivatives& out) const;
  void add_power(const Motion& motion, Power& out) const;

 private:
  Point normal(const Motion& motion) const;
};

/// -sqrt(beta) U r_j' on r_{j-1} and sqrt(beta) U r_{j-1}' on r_j for each segment; at the end
/// -sqrt(beta) U r_n' - a U^2 t_n, t_n = (r_n - r_{n-1}) / l_n. The centrifugal part of the
/// Lagrangian along a segment is taken up by its rigidity.
struct InternalFlow : Module {
  Index segments;
  double last_length, sqrt_beta, centrifugal;

  InternalFlow(const Pipe& pipe, const Vector& length)
      : segments(length.size()),
        last_length(length[segments - 1]),
        sqrt_beta(pipe.sqrt_beta()),
        centrifugal(pipe.centrifugal) {}
  void add_force(const Motion& motion, const Loads& loads) const;
  void add_derivatives(const Motion& motion, Derivatives& out) const;
  void add_power(const Motion& motion, Power& out) const;
};

}  // namespace pipedyn
