// SPDX-License-Identifier: MIT
//
// What a law of force knows of the pipe, and what it answers. A term is a law at one place of the
// pipe, or per length all along it. It knows nothing of chains, functions or scenes: each of these
// says once where its stations are and how it takes loads, slopes and mass.
//
// x is across the straight pipe and y along it, downward; t = (sin theta, cos theta). At a station
// with virtual displacement dr a term does the virtual work load . dr; with the velocity v and the
// acceleration a it adds mass a . dr to the inertia's, and its mass has weight like the pipe's. A
// couple does the virtual work couple dtheta.
//
// Local to each translation unit, like vector/pack.hpp, since the kernels of all vector levels
// include it.
#pragma once

#include "pipedyn/vector/pack.hpp"

namespace {

/// A place of the moving pipe. Real is a number or a pack of them.
template <class Real>
struct Station {
  Real x, y;          // position
  Real sine, cosine;  // of the angle theta, so the tangent
  Real vx, vy;        // velocity
  Real omega;         // theta'
};

/// A force, or a force per length, and a couple that does work as theta turns.
template <class Real>
struct Load {
  Real x, y, couple{};
};

/// Derivatives of a load; rows are its components.
template <class Real>
struct Slopes {
  Real by_position[2][2] = {};  // by x, by y
  Real by_velocity[2][2] = {};  // by vx, by vy
  Real by_angle[2] = {};        // by theta, position and velocity held
  Real by_rate[2] = {};         // by theta', velocity held
  Real couple_by_velocity[2] = {};
  Real couple_by_angle{};
};

/// A law without effect; each law redefines those of these functions in which it has one.
struct NoLaw {
  static constexpr bool along = false;  // acts per length, all along the pipe
  static constexpr bool loads = false;  // has a load
  // Stands on the base and not on the ground: where the base moves, its station is about that.
  static constexpr bool on_base = false;
  // Has a couple, along the pipe; of second degree in velocities, as are slopes by theta', so that
  // about rest neither has a part.
  static constexpr bool couples = false;

  double mass() const { return 0.0; }  // or mass per length
  /// Mass per length that moves with v_n = v . n alone, without weight: adds (n . a) n . dr.
  double normal_mass() const { return 0.0; }
  template <class Real>
  Load<Real> load(const Station<Real>&) const {
    return {Real{}, Real{}};
  }
  template <class Real>
  Slopes<Real> slopes(const Station<Real>&) const {
    return {};
  }
  /// Potential of the load, 0 on the straight pipe.
  template <class Real>
  Real energy(const Station<Real>&) const {
    return Real{};
  }
  /// Power of what the potential does not have.
  template <class Real>
  Real power(const Station<Real>&) const {
    return Real{};
  }
};

/// A station about a place with a velocity.
template <class Real>
Station<Real> about(const Station<Real>& at, const Real& x, const Real& y, const Real& vx,
                    const Real& vy) {
  return {at.x - x, at.y - y, at.sine, at.cosine, at.vx - vx, at.vy - vy, at.omega};
}

/// What a law's load adds to the energy, beside its power, as the base moves with the velocity (vx,
/// vy); of the fluid that moves with the pipe the energy is counted about the base, of springs on
/// the ground.
template <class Law, class Real>
Real base_power(const Law& law, const Station<Real>& at, const Load<Real>& load, const Real& vx,
                const Real& vy) {
  if constexpr (Law::on_base) return Real{};
  if constexpr (Law::couples) {
    const Station<Real> alone = about(at, Real{}, Real{}, vx, vy);
    const Load<Real> own = law.load(alone);
    return (load.x - own.x) * alone.vx + (load.y - own.y) * alone.vy +
           (load.couple - own.couple) * at.omega;
  }
  return -(load.x * vx + load.y * vy);
}

}  // namespace
