// SPDX-License-Identifier: MIT
//
// Where the terms of a pipe are on a chain. A place at arc length s lies on segment j at an arm a
// from its joint. With r_j the joint of segment j and v_j its velocity,
//   r = r_j + a t_j,   v = v_j + a theta_j' n_j.
// Terms but those on the base stand on the ground: where the base moves they see its motion, too.
//
// Local to each translation unit, like pack.hpp.
#pragma once

#include "pipedyn/chain/motion.hpp"
#include "pipedyn/terms/laws.hpp"
#include "pipedyn/vector/pack.hpp"

namespace {

using pipedyn::MotionModel, pipedyn::SegmentTerm;

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

/// Change of a load's force by a variable of its station, or along v by its position or velocity;
/// then of its couple.
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
/// Change of the force along v by each component of its station's position or velocity.
template <class Real>
inline Plane<Real> work_by(const Slopes<Real>& slopes, Variable first, const Plane<Real>& v) {
  return {slopes.by[0][first] * v.x + slopes.by[1][first] * v.y,
          slopes.by[0][first + 1] * v.x + slopes.by[1][first + 1] * v.y};
}

/// A matrix, by rows, times a vector, and its transpose times one.
template <class Real>
inline Plane<Real> times(const Real (&rows)[2][2], const Plane<Real>& v) {
  return {rows[0][0] * v.x + rows[0][1] * v.y, rows[1][0] * v.x + rows[1][1] * v.y};
}
template <class Real>
inline Plane<Real> transposed_times(const Real (&rows)[2][2], const Plane<Real>& v) {
  return {rows[0][0] * v.x + rows[1][0] * v.y, rows[0][1] * v.x + rows[1][1] * v.y};
}

/// What drives a member, see Drive; all 0 where nothing does.
template <class Real>
struct Driven {
  Real rate{}, x{}, y{}, vx{}, vy{}, ax{}, ay{};

  /// row(k): row k of a batch's drive, which it has.
  template <class Row>
  static Driven of(const pipedyn::Batch& batch, const Row& row) {
    const bool driven = batch.drive != nullptr;
    // One by one: all zeros at once were written by eights of bytes and read by packs.
    const auto entry = [&](Count k) { return driven ? row(k) : Real{}; };
    return {entry(0), entry(1), entry(2), entry(3), entry(4), entry(5), entry(6)};
  }
};

/// From segment to segment, from the clamp on, past the places with a load.
template <class Real>
struct Walk {
  Real x, y, vx, vy;    // of the joint
  Real sine{}, cosine;  // of the segment's angle
  const SegmentTerm *next, *end;
  Driven<Real> driven;

  Walk(const MotionModel& model, const Driven<Real>& base)
      : x(base.x),
        y(base.y + model.base),
        vx(base.vx),
        vy(base.vy),
        cosine(all<Real>(1.0)),
        next(model.loads),
        end(model.loads + model.load_count),
        driven(base) {}

  /// Into the next segment, by sine and cosine of its joint angle.
  void turn(const Real& s, const Real& c) {
    const Real before = sine;
    sine = c * before + s * cosine;
    cosine = c * cosine - s * before;
  }

  /// Calls body(law, place, station) for each place of segment j, which has this angle and rate,
  /// then goes on to its end.
  template <class Body>
  void pass(Count j, double length, const Real& angle, const Real& rate, const Body& body) {
    for (; next != end && next->segment == j; ++next) {
      const double arm = next->arm;
      const Real swing = arm * rate;
      const Station<Real> at{x + arm * sine,      y + arm * cosine,  angle, sine, cosine,
                             vx + swing * cosine, vy - swing * sine, rate};
      Laws::with(next->term, [&]<class Law>(const Law& law) {
        if constexpr (Law::on_base) {
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

/// Sums over the places of one segment, with powers 0, 1, 2 of the arm as far as they are met.
template <class Real>
struct LoadMoments {
  Real load[2][2];  // by power: x, y
  Slopes<Real> slopes[3];
  bool any;  // whether there is a place
};

/// The moments of each segment of a chain in a state, given by sines and cosines of its angles, one
/// Real a segment, by angle(j) and by rate(j).
template <class Real, class Angle, class Rate>
inline void load_moments(const MotionModel& model, const double* sine, const double* cosine,
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
        // One arm for the work of a force, and one for the motion of its place.
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
