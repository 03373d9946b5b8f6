// SPDX-License-Identifier: MIT
//
// Places of a pipe's terms on a chain. A place at arc length s lies on segment j at an arm a from
// its joint. With the position r_j and the velocity v_j of that joint, its position and velocity
// are
//   r = r_j + a t_j,   v = v_j + a theta_j' n_j.
// All terms but those on the base stand on the ground: if the base moves, r and v include its
// motion.
//
// Local to each translation unit, like pack.hpp.
#pragma once

#include "pipedyn/chain/motion.hpp"
#include "pipedyn/terms/laws.hpp"
#include "pipedyn/vector/pack.hpp"

namespace {

using pipedyn::ChainModel, pipedyn::SegmentTerm;

template <class Real>
struct Plane {
  Real x, y;
};

template <class Real>
inline Real dot(const Plane<Real>& a, const Plane<Real>& b) {
  return a.x * b.x + a.y * b.y;
}
template <class Real>
inline Plane<Real> plus(const Plane<Real>& a, const Plane<Real>& b) {
  return {a.x + b.x, a.y + b.y};
}
template <class Real>
inline Plane<Real> scaled(double factor, const Plane<Real>& a) {
  return {factor * a.x, factor * a.y};
}
template <class Real>
inline Plane<Real> plane(const Real (&entries)[2]) {
  return {entries[0], entries[1]};
}

/// Derivative of a load's force by one variable of its station; with v, the change of the force if
/// the station's position or velocity changes by v. `couple_by`: derivatives of the load's couple
/// by both components of the position or velocity.
template <class Real>
inline Plane<Real> force_by(const Slopes<Real>& slopes, Variable variable) {
  return {slopes.by[0][variable], slopes.by[1][variable]};
}
template <class Real>
inline Plane<Real> force_by(const Slopes<Real>& slopes, Variable first, const Plane<Real>& v) {
  return {slopes.by[0][first] * v.x + slopes.by[0][first + 1] * v.y,
          slopes.by[1][first] * v.x + slopes.by[1][first + 1] * v.y};
}
template <class Real>
inline Plane<Real> couple_by(const Slopes<Real>& slopes, Variable first) {
  return {slopes.by[2][first], slopes.by[2][first + 1]};
}
/// Derivatives of the force's component along v by both components of its station's position or
/// velocity.
template <class Real>
inline Plane<Real> work_by(const Slopes<Real>& slopes, Variable first, const Plane<Real>& v) {
  return {slopes.by[0][first] * v.x + slopes.by[1][first] * v.y,
          slopes.by[0][first + 1] * v.x + slopes.by[1][first + 1] * v.y};
}

/// Numbers of the members of a block, from an array; if it has fewer members than there are lanes,
/// the last one fills the others.
template <class Real>
inline Real read_members(const double* from, Count used) {
  if (lanes<Real> == 1 || used == lanes<Real>) return load<Real>(from);
  double each[lanes<Real>];
  for (Count i = 0; i < lanes<Real>; ++i) each[i] = from[i < used ? i : used - 1];
  return load<Real>(each);
}

/// The drive of a member, in the order of the rows of Drive; all 0 if the batch has none.
template <class Real>
struct Driven {
  Real rate{}, x{}, y{}, vx{}, vy{}, ax{}, ay{};
  const double* applied = nullptr;  // rows of applied forces, `apart` numbers apart; null: none
  Count apart = 0, used = 0;

  /// What an applied force is for the member at the arc length s.
  AppliedNow<Real> force(const AppliedForce& law, double s) const {
    if (applied == nullptr) return {};
    return {law, s, [this](Count k) { return read_members<Real>(applied + k * apart, used); }};
  }

  /// The drive of a member of a batch. row(k): entry of the member in row k of the batch's drive;
  /// called only if the batch has one.
  template <class Row>
  static Driven of(const pipedyn::Batch& batch, const Row& row) {
    const bool driven = batch.drive != nullptr;
    // Entries are set one by one: a struct of zeros was written in pieces of eight bytes and read
    // in packs, which is slow.
    const auto entry = [&](Count k) { return driven ? row(k) : Real{}; };
    return {entry(0), entry(1), entry(2), entry(3), entry(4), entry(5), entry(6)};
  }
};

/// Position, velocity and direction of one segment after the other, from the clamp to the end, and
/// of the places with a load on them.
template <class Real>
struct Walk {
  Real x, y, vx, vy;    // position and velocity of the joint
  Real sine{}, cosine;  // of the segment's angle
  const SegmentTerm *next, *end;
  Count found;  // segment of the next place, -1 if there is none
  Driven<Real> driven;

  Walk(const ChainModel& model, const Driven<Real>& base)
      : x(base.x),
        y(base.y + model.base),
        vx(base.vx),
        vy(base.vy),
        cosine(all<Real>(1.0)),
        next(model.loads),
        end(model.loads + model.load_count),
        driven(base) {
    find();
  }
  void find() { found = next != end ? next->segment : -1; }

  /// Turns to the direction of the next segment. s, c: sine and cosine of its joint angle.
  void turn(const Real& s, const Real& c) {
    const Real before = sine;
    sine = c * before + s * cosine;
    cosine = c * cosine - s * before;
  }

  /// Calls body(law, place, station) for each place of segment j, then moves to the segment's end.
  /// angle, rate: theta_j and theta_j'.
  template <class Body>
  void pass(Count j, double length, const Real& angle, const Real& rate, const Body& body) {
    // One comparison, as registers are saved for the laws only after the first of two.
    for (; found == j; ++next, find()) {
      const double arm = next->arm;
      const Real swing = arm * rate;
      const Station<Real> at{x + arm * sine,      y + arm * cosine,  angle, sine, cosine,
                             vx + swing * cosine, vy - swing * sine, rate};
      Laws::with(next->term, [&]<class Law>(const Law& law) {
        if constexpr (Law::applied) {
          const Driven<Real> now = driven;  // a copy, which leaves the walk in registers
          body(now.force(law, next->term.at), *next, at);
        } else if constexpr (Law::on_base) {
          body(law, *next, about(at, driven.x, driven.y, driven.vx, driven.vy));
        } else {
          body(law, *next, at);
        }
      });
    }
    const Real step = length * rate;
    x += length * sine;
    y += length * cosine;
    vx += step * cosine;
    vy -= step * sine;
  }
};

/// Sums of the loads over the places of one segment, weighted with powers 0, 1, 2 of the arm; only
/// the sums that the equations need are computed.
template <class Real>
struct LoadMoments {
  Real load[2][2];         // [power]: x and y of the load
  Slopes<Real> slopes[3];  // [power]: derivatives of the loads
  bool any;                // whether there is a place
};

/// Computes the LoadMoments of each segment of a chain in a state. The state is given by sines and
/// cosines of the angles, one Real a segment, by angle(j) and by rate(j). out: (n,).
template <class Real, class Angle, class Rate>
inline void load_moments(const ChainModel& model, const double* sine, const double* cosine,
                         const Angle& angle, const Rate& rate, const Driven<Real>& driven,
                         LoadMoments<Real>* out) {
  Walk<Real> walk(model, driven);
  for (Count j = 0; j < model.size; ++j) {
    LoadMoments<Real>& sum = out[j];
    sum = {};
    walk.sine = load<Real>(sine + j * lanes<Real>);
    walk.cosine = load<Real>(cosine + j * lanes<Real>);
    const auto visit = [&](const auto& law, const SegmentTerm& place, const Station<Real>& at) {
      const auto load = differentiated_load(law, at);
      const Acting<Real> force(load);
      const double first = place.weight * place.arm;
      const double weights[3] = {place.weight, first, first * place.arm};
      sum.any = true;
      for (int power = 0; power < 2; ++power) {
        sum.load[power][0] += weights[power] * force.x;
        sum.load[power][1] += weights[power] * force.y;
      }
      for_each_slope(load, [&](auto row, auto k, const Real& slope) {
        // The moment of a force multiplies by the arm once, and the motion of its place once more.
        constexpr int powers = 1 + (row < 2) + (k != by_angle && k != by_rate);
        for (int power = 0; power < powers; ++power) {
          sum.slopes[power].by[row][k] += weights[power] * slope;
        }
      });
    };
    walk.pass(j, model.links[j].length, angle(j), rate(j), visit);
  }
}

}  // namespace
