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

  /// Calls body(law, place, station) for each place of segment j, then goes on to its end.
  template <class Body>
  void pass(Count j, double length, const Real& rate, const Body& body) {
    for (; next != end && next->segment == j; ++next) {
      const double arm = next->arm;
      const Real swing = arm * rate;
      const Station<Real> at{x + arm * sine,      y + arm * cosine,  sine, cosine,
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

/// Sums over the places of one segment, with powers 0, 1, 2 of the arm.
template <class Real>
struct LoadMoments {
  Real load[2][2];  // by power: x, y
  Slopes<Real> slopes[3];
  bool any;  // whether there is a place
};

template <class Real>
inline void add(Slopes<Real>& sum, double weight, const Slopes<Real>& more) {
  for (int i = 0; i < 2; ++i) {
    for (int k = 0; k < 2; ++k) {
      sum.by_position[i][k] += weight * more.by_position[i][k];
      sum.by_velocity[i][k] += weight * more.by_velocity[i][k];
    }
    sum.by_angle[i] += weight * more.by_angle[i];
    sum.by_rate[i] += weight * more.by_rate[i];
    sum.couple_by_velocity[i] += weight * more.couple_by_velocity[i];
  }
  sum.couple_by_angle += weight * more.couple_by_angle;
}

/// The moments of each segment of a chain in a state, given by sines and cosines of its angles, one
/// Real a segment, and by rate(j).
template <class Real, class Rate>
inline void load_moments(const MotionModel& model, const double* sine, const double* cosine,
                         const Rate& rate, const Driven<Real>& driven, LoadMoments<Real>* out) {
  Walk<Real> walk(model, driven);
  for (Count j = 0; j < model.size; ++j) {
    LoadMoments<Real>& sum = out[j];
    sum = {};
    walk.sine = load<Real>(sine + j * lanes<Real>);
    walk.cosine = load<Real>(cosine + j * lanes<Real>);
    const auto visit = [&](const auto& law, const SegmentTerm& place, const Station<Real>& at) {
      const Load<Real> force = law.load(at);
      const Slopes<Real> slopes = law.slopes(at);
      double weight = place.weight;
      sum.any = true;
      for (int power = 0; power < 3; ++power) {
        add(sum.slopes[power], weight, slopes);
        if (power < 2) {
          sum.load[power][0] += weight * force.x;
          sum.load[power][1] += weight * force.y;
        }
        weight *= place.arm;
      }
    };
    walk.pass(j, model.links[j].length, rate(j), visit);
  }
}

}  // namespace
