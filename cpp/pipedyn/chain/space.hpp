// SPDX-License-Identifier: MIT
//
// The chain's motion in three dimensions, in O(n) a state.
//
// The tangent t_j of segment j is (0, 1, 0) turned by the rotation vector (a_z, 0, -a_x): its
// coordinates a = (a_x, a_z) are such that a motion in the plane z = 0 has a_x = theta, a_z = 0.
// With rho = |a|, a~ = (-a_z, a_x), and
//   S = sin rho / rho,  C = (1 - cos rho) / rho^2,  E = (1 - S) / rho^2,  E2 = (dE / drho) / rho,
// the turned axes are
//   t = (S a_x, cos rho, S a_z),
//   n_x = (1 - C a_x^2, -S a_x, -C a_x a_z),  n_z = (-C a_x a_z, -S a_z, 1 - C a_z^2).
// The rates w = (n_x . t', n_z . t') of the tangent, and their derivatives, are
//   w = a' - E m a~,   m = a~ . a',
//   (n_x . t'', n_z . t'') = a'' - E (a~ . a'') a~ - E2 (a . a') m a~ - E m a~' - C m w~,
// so that a plane motion has w = theta' and no further terms.
//
// The recursion is that of sweeps.hpp, whose numbers n . A n, t . A n and 1 / H become matrices of
// the two directions across a segment:
//   H = I + l^2 N^T A N,   N = (n_x, n_z).
// All functions of N^T A N commute, so that what is computed there without differences of nearly
// equal numbers is so computed here. Vectors and A are kept in the frame of the ground.
//
// Joints. With v = t_{j-1} x t_j, cos phi = t_{j-1} . t_j and F = phi / sin phi, the energy k phi^2
// / 2 gives the moment k F v. Twist-free material has the spin w3 about its tangent,
//   w3_j = w3_{j-1} - v . (t_{j-1}' + t_j') / (1 + cos phi),
// and Kelvin-Voigt damping acts on the rate of F v that this material sees,
//   D = (F v)' - (t_{j-1} x t_{j-1}' + w3_{j-1} t_{j-1}) x F v,
// with the power -c |D|^2. The moment c D also does work on the spins of all joints before it; the
// couple that collects this work along the pipe is `twist`.
//
// A joint before a guided or clamped end, whose tangent is the axis, resists like the others. Such
// an end keeps its direction and lets the pipe turn about it, so that the couple `twist` is 0
// there.
//
// Charts. At rho = pi, where a segment points backwards along the axis, rotation vectors are
// singular for motions across their plane. A second chart has rotation vectors from the opposite
// direction,
//   t = (S a_x, -cos rho, S a_z),
// the mirror image of the first, so that all formulas above hold with n_x, n_z and t mirrored in y.
// A state has a sign for each segment, -1 in the second chart (Batch::charts).
//
// Supports. Where the end of a segment is held, x = z = 0, a force across the straight pipe acts
// such that x'' + 2 k x' + k^2 x = 0, likewise z: a state that misses the support by the errors of
// its integrator returns to it (Baumgarte 1972). Unit forces turn the segments before them by
// moments p, one sweep to the clamp each, and accelerate one another's places by sum_j p . p / H.
//
// Source: rotation vectors of the tangent as coordinates, and the recursion for rigid bodies in a
// tree (Featherstone 2008, ch. 7). tests/test_space.py derives the equations from the energies.
//
// Local to each translation unit, like pack.hpp.
#pragma once

#include "pipedyn/chain/sweeps.hpp"
#include "pipedyn/terms/applied_force.hpp"
#include "pipedyn/terms/space.hpp"

namespace {

/// A symmetric matrix of the two directions across a segment.
template <class Number>
struct Symmetric2 {
  Number xx, xz, zz;

  Across<Number> times(const Across<Number>& v) const {
    return {xx * v.x + xz * v.z, xz * v.x + zz * v.z};
  }
  friend Symmetric2 operator*(const Number& factor, const Symmetric2& a) {
    return {factor * a.xx, factor * a.xz, factor * a.zz};
  }
};

template <class Number>
struct Symmetric3 {
  Number xx{}, yy{}, zz{}, xy{}, xz{}, yz{};

  Space<Number> times(const Space<Number>& v) const {
    return {xx * v.x + xy * v.y + xz * v.z, xy * v.x + yy * v.y + yz * v.z,
            xz * v.x + yz * v.y + zz * v.z};
  }
};

/// C, E, E2, S and cos rho, as functions of rho^2.
template <class Number>
struct Rotation {
  Number c, e, e2, s, cosine;

  PIPEDYN_INLINE explicit Rotation(const Number& square) {
    // Interpolation at Chebyshev's points up to rho^2 = 10, which is beyond half a turn; the errors
    // are 7e-20 and 3e-20.
    constexpr double limit = 10.0;
    constexpr double for_c[] = {
        0x1.0000000000000p-1,   -0x1.5555555555555p-5,  0x1.6c16c16c16bf7p-10,
        -0x1.a01a01a0193ccp-16, 0x1.27e4fb77628b3p-22,  -0x1.1eed8ef657cbep-29,
        0x1.939747dcc1f83p-37,  -0x1.ae7ebdacbbbcdp-45, 0x1.6817ffd583650p-53,
        -0x1.e2edc04168efap-62, 0x1.e6b176323ab0bp-71};
    constexpr double for_e2[] = {-0x1.1111111111111p-6,  0x1.a01a01a01a015p-11,
                                 -0x1.1566abc01137fp-16, 0x1.ae64567f40c77p-23,
                                 -0x1.b96d7982cdfccp-30, 0x1.42df6da642be4p-37,
                                 -0x1.6286a2d1eb217p-45, 0x1.2f3fe9c9ac539p-53,
                                 -0x1.9e42cc37f05c8p-62, 0x1.aaa0a313256f0p-71};
    using Traits = NumberTraits<Number>;
    using Real = typename Traits::Plain;
    c = polynomial(for_c, square);
    e2 = polynomial(for_e2, square);
    if (any_beyond(Traits::value(square), limit)) {
      // C and E2 with their derivatives by rho^2.
      Real packs[] = {Traits::value(square), {}, {}, {}};
      lane_by_lane(packs, [](double (&of)[4]) {
        const double x = of[0], rho = std::sqrt(x), sine = std::sin(rho) / rho;
        of[0] = (1.0 - std::cos(rho)) / x;
        of[1] = (0.5 * sine - of[0]) / x;
        of[2] = (of[0] - 3.0 * (1.0 - sine) / x) / x;
        of[3] = (of[1] - 2.5 * of[2]) / x;
      });
      c = Traits::where_above(square, limit, Traits::with(packs[0], packs[1], square), c);
      e2 = Traits::where_above(square, limit, Traits::with(packs[2], packs[3], square), e2);
    }
    e = (1.0 / 3.0) * (c - square * e2);
    s = 1.0 - square * e;
    cosine = 1.0 - square * c;
  }
};

/// F = phi / sin phi of a joint, as a function of z = sin^2 (phi / 2), and h = (F - 1) / z.
template <class Number>
struct Bend {
  Number f, h;

  PIPEDYN_INLINE explicit Bend(const Number& z) {
    // h is interpolated at Chebyshev's points for phi up to 60 degrees; the error is 4e-18.
    constexpr double limit = 0.25;
    constexpr double for_h[] = {0x1.5555555555555p-1, 0x1.11111111110e3p-1,  0x1.d41d41d423eadp-2,
                                0x1.a01a019d0cecfp-2, 0x1.7a4630c0cc534p-2,  0x1.5d2cfdcaba210p-2,
                                0x1.45e85498d8ab4p-2, 0x1.329145a8bd4d0p-2,  0x1.246a4d198c9d1p-2,
                                0x1.05cd4eaf0dc3fp-2, 0x1.5f9560609b012p-2,  -0x1.9152c9f51202cp-4,
                                0x1.31c214d692619p+0, -0x1.6a762d239e584p+0, 0x1.ac91a906b5fbap+0};
    using Traits = NumberTraits<Number>;
    using Real = typename Traits::Plain;
    h = polynomial(for_h, z);
    if (any_beyond(Traits::value(z), limit)) {
      Real packs[] = {Traits::value(z), {}};
      lane_by_lane(packs, [](double (&of)[2]) {
        const double at = of[0], w = std::sqrt(at), rest = 1.0 - at;
        const double found = std::asin(w) / (w * std::sqrt(rest));
        of[0] = (found - 1.0) / at;
        const double by_z = -((1.0 - 2.0 * at) * of[0] - 2.0) / (2.0 * rest);
        of[1] = (by_z - of[0]) / at;
      });
      h = Traits::where_above(z, limit, Traits::with(packs[0], packs[1], z), h);
    }
    f = 1.0 + z * h;
  }
};

/// Replaces the lower half of a symmetric A (rows, rows) by its Cholesky factor, with the inverse
/// of its diagonal.
template <class Number>
void factorise_symmetric(Number* a, Count rows) {
  for (Count i = 0; i < rows; ++i) {
    for (Count j = 0; j <= i; ++j) {
      Number sum = a[i * rows + j];
      for (Count k = 0; k < j; ++k) sum = sum - a[i * rows + k] * a[j * rows + k];
      a[i * rows + j] = j < i ? Number(sum * a[j * rows + j]) : inverse_of(root_of(sum));
    }
  }
}
/// Replaces b (rows,) by A^-1 b.
template <class Number>
void solve_symmetric(const Number* factor, Count rows, Number* b) {
  for (Count i = 0; i < rows; ++i) {
    for (Count j = 0; j < i; ++j) b[i] = b[i] - factor[i * rows + j] * b[j];
    b[i] = b[i] * factor[i * rows + i];
  }
  for (Count i = rows - 1; i >= 0; --i) {
    for (Count j = i + 1; j < rows; ++j) b[i] = b[i] - factor[j * rows + i] * b[j];
    b[i] = b[i] * factor[i * rows + i];
  }
}

// --------------------------------------------------------------------------------------- states

/// Whether a batch has a row of a drive; if not, the row is 0.
inline bool drives(const Batch& batch, Count row) {
  return batch.drive != nullptr && row < batch.drive_rows;
}

/// A block of states of the motion in space as the recursion reads them: rows of [a_x (n), a_z (n),
/// a_x' (n), a_z' (n)].
template <class Real>
struct States {
  Members<Real> members;

  bool has_charts() const { return members.batch.charts != nullptr; }

  Real row(Count j) const { return members.row(j); }
  Real speed() const { return members.speed(); }
  /// Sign of segment j in its chart.
  Real chart(Count j) const { return members.read_row(members.batch.charts, j); }
  Real driven(Count k) const {
    const Batch& of = members.batch;
    return drives(of, k) ? members.read_row(of.drive, k) : Real{};
  }
};

/// One state, with derivatives by some of its rows side by side in the lanes, from row `first` on;
/// the row after the last stands for the flow speed.
template <class Real>
struct Seeded {
  using Number = Dual<Real, 1u>;
  const Batch& batch;
  Count member, first, rows;

  bool has_charts() const { return batch.charts != nullptr; }
  Number seeded(double value, Count place) const {
    double slopes[lanes<Real>] = {};
    if (place >= first && place < first + lanes<Real>) slopes[place - first] = 1.0;
    return {all<Real>(value), {load<Real>(slopes)}};
  }
  Number row(Count j) const { return seeded(batch.y[j * batch.members + member], j); }
  Number speed() const { return seeded(batch.u[member * batch.u_step], rows); }
  Real chart(Count j) const { return all<Real>(batch.charts[j * batch.members + member]); }
  Number driven(Count k) const {
    return constant<Number>(drives(batch, k) ? batch.drive[k * batch.members + member] : 0.0);
  }
};

/// Writes derivatives of a number by a seeded state (rows,), from row `first` on; and, unless
/// `value` is null, its value and its derivative by the flow speed.
inline void put_derivatives(const Dual<Pack, 1u>& x, Count first, Count rows, double* by_rows,
                            double* value, double* by_speed) {
  double slopes[width], values[width];
  store(slopes, x.slopes[0]);
  store(values, x.value);
  if (value != nullptr) *value = values[0];
  for (Count lane = 0; lane < width; ++lane) {
    if (first + lane < rows) by_rows[first + lane] = slopes[lane];
    if (first + lane == rows && value != nullptr) *by_speed = slopes[lane];
  }
}

/// Drive of a state in space.
template <class Number>
struct SpatialDrive {
  Number rate;
  Space<Number> position, velocity, acceleration;

  template <class Rows>
  explicit SpatialDrive(Rows rows) : rate(rows.driven(0)) {
    using pipedyn::Drive;
    const auto vector = [&](Count at, Count z) -> Space<Number> {
      return {rows.driven(at), rows.driven(at + 1), rows.driven(z)};
    };
    position = vector(Drive::position, Drive::position_z);
    velocity = vector(Drive::velocity, Drive::velocity_z);
    acceleration = vector(Drive::acceleration, Drive::acceleration_z);
  }
};

/// A law as it acts on a pipe in space at a time: an applied force is made from rows(k), row k of
/// the drive.
template <class Number, class Law, class Rows>
auto acting_in_space(const Law& law, double s, const Rows& rows) {
  if constexpr (Law::applied) {
    const auto row = [&](std::ptrdiff_t k) { return rows.driven(pipedyn::Drive::rows + k); };
    return AppliedNow<Number>(law, s, row, true);
  } else {
    return law;
  }
}

/// A direction of the pipe in space and how it turns.
template <class Number>
struct Direction {
  Space<Number> t, nx, nz, rate;  // t, n_x, n_z, t'
  Across<Number> a, w, bias;      // bias: what N^T t'' has besides the terms in a''
  Number c, e, e2, s, square;     // C, E, E2, S, |t'|^2

  Space<Number> lifted(const Across<Number>& x) const { return x.x * nx + x.z * nz; }
  Across<Number> across(const Space<Number>& x) const { return {dot(nx, x), dot(nz, x)}; }
  Space<Number> normal(const Space<Number>& x) const { return x - dot(x, t) * t; }
  /// Components across the tangent of its change, if a changes by x: R x, R = I - E a~ a~^T.
  Across<Number> across_by(const Across<Number>& x) const {
    const Across<Number> aside = a.turned();
    return x - (e * dot(aside, x)) * aside;
  }

  PIPEDYN_INLINE void set(const Across<Number>& vector, const Across<Number>& da) {
    a = vector;
    const Rotation<Number> by(dot(a, a));
    c = by.c;
    e = by.e;
    e2 = by.e2;
    s = by.s;
    const Number cx = c * a.x;
    t = {s * a.x, by.cosine, s * a.z};
    nx = {1.0 - cx * a.x, -t.x, -(cx * a.z)};
    nz = {nx.z, -t.z, 1.0 - c * (a.z * a.z)};
    const Across<Number> aside = a.turned();
    const Number m = dot(aside, da);
    w = across_by(da);
    square = dot(w, w);
    bias = -1.0 * ((c * m) * w.turned() + (e2 * (dot(a, da) * m)) * aside + (e * m) * da.turned());
    rate = lifted(w);
  }

  /// The place at an arm along this direction from a place r that moves with the velocity v.
  SpatialStation<Number> station(const Space<Number>& r, const Space<Number>& v, double arm) const {
    return {r + arm * t, v + arm * rate, t, rate, nx, nz, a, w, e, s};
  }

  /// 1 - cos rho.
  Number drop() const { return c * dot(a, a); }
};

/// A segment in space: its direction and motion, then its loads, then what the recursion keeps.
template <class Number>
struct SpatialSegment : Direction<Number> {
  using Direction<Number>::a, Direction<Number>::t, Direction<Number>::rate;
  Space<Number> force, lever;  // sums of the loads, and of their moments as loads times arms
  // Of the segment's joint: sin^2 (phi / 2), F, v, c D and, with the sign of a resistance,
  // factors of the forces on both tangents.
  Number z, f, by_cosine, about;  // about: 1 / (1 + cos phi)
  Space<Number> v, resistance;
  Symmetric2<Number> inverse, turned;  // 1 / H, and (l N^T A N + m chi l) / H
  Across<Number> free, along;          // acceleration without that of the joint; l N^T A t / H

  /// Sets direction and motion from row j of a state of n segments.
  template <class Rows>
  PIPEDYN_INLINE void move(const Rows& rows, Count n, Count j) {
    this->set({rows.row(j), rows.row(n + j)}, {rows.row(2 * n + j), rows.row(3 * n + j)});
    if (!rows.has_charts()) return;
    const auto sign = rows.chart(j);
    for (Space<Number>* const of : {&this->t, &this->nx, &this->nz, &this->rate}) {
      of->y = sign * of->y;
    }
  }

  /// a'' from the components of t'' across the segment, by the inverse of R.
  Across<Number> acceleration(const Across<Number>& found) const {
    const Across<Number> own = found - this->bias, aside = a.turned();
    return own + (this->e * inverse_of(this->s) * dot(aside, own)) * aside;
  }

  /// Sets the joint with the tangent t0 before it; `resists`: also for its damping.
  PIPEDYN_INLINE void join(const Space<Number>& t0, bool resists) {
    const Space<Number> apart = t - t0;
    z = 0.25 * dot(apart, apart);
    const Bend<Number> bend(z);
    f = bend.f;
    if (!resists) return;
    about = 0.5 * inverse_of(Number(1.0 - z));
    by_cosine = 0.5 * (((1.0 - 2.0 * z) * bend.h - 2.0) * about);
  }
  /// The square of the joint's angle.
  Number angle_square() const { return 4.0 * (z * (1.0 - z)) * (f * f); }

  /// Sets the damping of the joint, and adds the spin at the joint to that before it. rate0: t0'.
  PIPEDYN_INLINE void resist(const Space<Number>& t0, const Space<Number>& rate0, double damping,
                             Number& spin) {
    v = cross(t0, t);
    const Number closing = dot(rate0, t) + dot(t0, rate), turning = dot(v, rate0);
    // v' - (t_{j-1} x t_{j-1}' + w3 t_{j-1}) x v
    const Number carried = spin * (1.0 - 2.0 * z) - turning;
    const Space<Number> seen = plus_cross(cross(rate0, t), t0, rate) - carried * t0 + spin * t;
    resistance = (damping * f) * seen + (damping * by_cosine * closing) * v;
    spin = spin - (turning + dot(v, rate)) * about;
  }
};

// ------------------------------------------------------------------------------------ recursion

/// The unit vector along the straight pipe.
template <class Number>
inline Space<Number> axis() {
  return {Number{}, constant<Number>(1.0), Number{}};
}

/// Scratch of the recursion. Rows 2 b and 2 b + 1 belong to x and z of support b.
template <class Number>
struct SpatialRoom {
  // (n + 2,): the n segments, between two that stand for the axis at the clamp and a guided end.
  SpatialSegment<Number>* all;
  Across<Number>* pulls;      // p of each row (rows, n)
  Number *products, *forces;  // sums of p . p / H (rows, rows); forces at supports (rows,)

  SpatialRoom(const ChainModel& model, Layout& layout) {
    const Count n = model.size, rows = 2 * model.held_count;
    all = layout.take<SpatialSegment<Number>>(n + 2);
    pulls = layout.take<Across<Number>>(rows * n);
    products = layout.take<Number>(rows * rows);
    forces = layout.take<Number>(rows);
  }
};

/// Adds the forces of supports to the accelerations of the segments without that of their joint.
/// room.forces: accelerations that are lacking at the supports; the forces replace them.
template <class Number>
void hold(const ChainModel& model, const SpatialRoom<Number>& room) {
  const Count n = model.size, rows = 2 * model.held_count;
  for (Count row = 0; row < rows; ++row) {
    const Number minus = constant<Number>(-1.0), none{};
    Space<Number> bias =
        row % 2 == 0 ? Space<Number>{minus, none, none} : Space<Number>{none, none, minus};
    Across<Number>* const own = room.pulls + row * n;
    Number* const products = room.products + row * rows;
    for (Count other = 0; other <= row; ++other) products[other] = Number{};
    for (Count j = model.held[row / 2]; j >= 0; --j) {
      const SpatialSegment<Number>& here = room.all[j + 1];
      const double l = model.links[j].length;
      const Across<Number> across = here.across(bias), turning = here.inverse.times(across);
      own[j] = l * across;
      for (Count other = 0; other <= row; ++other) {
        if (j > model.held[other / 2]) continue;
        products[other] = products[other] + l * dot(turning, room.pulls[other * n + j]);
      }
      bias = here.lifted(model.links[j].exchange * turning) +
             (dot(here.t, bias) - l * dot(here.along, across)) * here.t;
    }
  }
  factorise_symmetric(room.products, rows);
  solve_symmetric(room.products, rows, room.forces);
  for (Count row = 0; row < rows; ++row) {
    for (Count j = model.held[row / 2]; j >= 0; --j) {
      SpatialSegment<Number>& here = room.all[j + 1];
      here.free = here.free - room.forces[row] * here.inverse.times(room.pulls[row * n + j]);
    }
  }
}

/// What the x axis becomes at the end of material that does not twist, turned least at each joint.
template <class Number>
PIPEDYN_NOINLINE Space<Number> carried_axis(const SpatialSegment<Number>* segments, Count n) {
  Space<Number> side{constant<Number>(1.0), Number{}, Number{}}, t0 = axis<Number>();
  for (Count j = 0; j < n; ++j) {
    const SpatialSegment<Number>& here = segments[j];
    const Number share = 0.5 * (inverse_of(Number(1.0 - here.z)) * dot(here.t, side));
    side = side - share * (t0 + here.t);
    t0 = here.t;
  }
  return side;
}

/// Adds the loads of terms on a segment, from the given one on, and returns the first beyond it. r,
/// v: place and velocity of the segment's joint. Not inlined, so that chains without terms are not
/// slower for all the laws.
template <class Number, class Rows>
PIPEDYN_NOINLINE const SegmentTerm* add_terms(const SegmentTerm* term, const SegmentTerm* last,
                                              Space<Number> r, Space<Number> v,
                                              const SpatialDrive<Number>& drive, Rows rows,
                                              SpatialSegment<Number>& here,
                                              PowerParts<Number>& power) {
  for (const Count j = term->segment; term != last && term->segment == j; ++term) {
    const double arm = term->arm, weight = term->weight;
    const SpatialStation<Number> place = here.station(r, v, arm);
    Laws::with(term->term, [&]<class Law>(const Law& of) {
      if constexpr (!Law::moves) return;
      const auto law = acting_in_space<Number>(of, term->term.at, rows);
      with_station(law, place, drive.position, drive.velocity, [&](const auto& at) {
        const SpatialLoad<Number> load = law.load_in_space(at);
        here.force += weight * load.force;
        here.lever += (weight * arm) * load.force + here.lifted(weight * load.couple);
        power.terms = power.terms + weight * power_of(law, at, load);
        power.base = power.base - weight * base_loss(law, at, load, drive.velocity);
      });
    });
  }
  return term;
}

/// Takes from a segment the weight and the centripetal force of mass that moves across it alone,
/// and returns the power that this mass takes from the acceleration of the base.
template <class Number>
PIPEDYN_NOINLINE Number correct_added(const ChainModel& model, const Link& link, Space<Number> own,
                                      const SpatialDrive<Number>& drive,
                                      SpatialSegment<Number>& here) {
  const double arm = 0.5 * link.length;
  const Space<Number> lift =
      (-model.gravity * link.added) * here.normal(in_plane<Number>(model.down));
  here.force += lift - (arm * link.added * here.square) * here.t;
  here.lever += arm * lift;
  return link.added * dot(drive.acceleration, here.normal(own));
}

/// Computes the accelerations of a state of the motion in space, and returns the powers, or zeros
/// without `powers`. put(j, rates, accelerations): receives a' and a'' of each segment.
template <bool powers, class Number, class Rows, class Put>
PowerParts<Number> spatial_accelerations(const ChainModel& model, Rows rows,
                                         SpatialRoom<Number> room, Put put) {
  SpatialSegment<Number>* const segments = room.all + 1;
  const Link* const links = model.links;
  const Count n = model.size, joints = n + model.guided;
  const Number u = rows.speed(), coriolis = model.coriolis * u, entry = model.entry * u;
  const SpatialDrive<Number> drive(rows);
  const Number push = model.coriolis * drive.rate;
  bool resists = model.end_damping != 0.0;
  for (Count j = 0; j < n; ++j) resists = resists || links[j].damping != 0.0;
  PowerParts<Number> power{}, of_terms{};

  Space<Number> r = drive.position + model.base * axis<Number>(), velocity = drive.velocity;
  Number spin{};
  const SegmentTerm* term = model.loads;
  const SegmentTerm* const last_term = model.loads + model.load_count;
  const bool places = model.load_count + model.held_count > 0;
  Count support = 0;
  // Loops of their own, so that a processor computes polynomials of several segments at once.
  for (Count j = 0; j < n; ++j) segments[j].move(rows, n, j);
  for (const Count j : {Count{-1}, n}) {
    segments[j].t = axis<Number>();
    segments[j].rate = segments[j].lever = Space<Number>{};
  }
  for (Count j = 0; j < joints; ++j) segments[j].join(segments[j - 1].t, resists);
  for (Count j = 0; j < joints; ++j) {
    SpatialSegment<Number>& here = segments[j];
    if (resists) {
      const double damping = j < n ? links[j].damping : model.end_damping;
      here.resist(segments[j - 1].t, segments[j - 1].rate, damping, spin);
      if (powers && damping != 0.0) {
        power.joints = power.joints - (1.0 / damping) * dot(here.resistance, here.resistance);
      }
    }
    if (j == n) break;
    const Link& link = links[j];
    const Space<Number> own = velocity - drive.velocity;  // relative to the base
    here.force = (-link.length * (2.0 * coriolis)) * here.rate;
    here.lever = (-link.length_square * coriolis) * here.rate;
    if constexpr (powers) {
      power.flow = power.flow - link.length * push * dot(here.t, own);
      power.base =
          power.base - dot(drive.acceleration, link.mass * own + link.first_moment * here.rate);
    }
    const auto act = [&](const Space<Number>& force, double arm) {
      here.force += force;
      here.lever += arm * force;
    };
    if (model.drag) {
      const Space<Number> at = velocity + link.drag_arm * here.rate;
      const Space<Number> normal = here.normal(at);
      const Space<Number> force = (-link.drag * root_of(dot(normal, normal))) * normal;
      act(force, link.drag_arm);
      if constexpr (powers) {
        power.drag = power.drag + dot(force, at);
        power.base = power.base - dot(force, drive.velocity);
      }
    }
    if (term != last_term && term->segment == j) {
      term = add_terms(term, last_term, r, velocity, drive, rows, here, of_terms);
    }
    if (link.added != 0.0) power.base = power.base - correct_added(model, link, own, drive, here);
    if (places) r += link.length * here.t;
    velocity += link.length * here.rate;
    if (support == model.held_count || model.held[support] != j) continue;
    const double k = model.return_rate;
    const Space<Number> missed = k * (2.0 * (velocity - drive.velocity) + k * (r - drive.position));
    room.forces[2 * support] = -missed.x;
    room.forces[2 * support + 1] = -missed.z;
    ++support;
  }
  power.terms = of_terms.terms;
  power.base = power.base + of_terms.base;
  Space<Number> jet = model.thrust[0] * segments[joints - 1].t;
  if (model.thrust[1] != 0.0) jet += model.thrust[1] * carried_axis(segments, joints);
  jet = (u * u) * jet;
  const Space<Number> end = velocity - drive.velocity;
  power.flow = power.flow - dot(coriolis * end - entry * velocity + jet, end);

  Symmetric3<Number> inertia;
  Space<Number> bias = jet - entry * velocity, beyond{};
  Number twist{};
  for (Count j = joints - 1; j >= 0; --j) {
    SpatialSegment<Number>& here = segments[j];
    const Space<Number> before = segments[j - 1].t;
    const double spring = j < n ? links[j].spring : model.end_spring;
    // Moments are without what they have along their segment's tangent, which turns nothing.
    Number stiff = spring * here.f;
    if (resists) stiff = stiff - here.by_cosine * dot(here.resistance, here.v);
    const Space<Number> pull = stiff * (here.t - before);
    Space<Number> moment = beyond + here.lever - pull;
    beyond = pull;
    if (resists) {
      const Space<Number> c = here.f * here.resistance;
      const Number spun = twist * here.about, along = dot(c, before);  // v is normal to t_{j-1}
      moment = plus_cross(moment, before, c) - spun * here.v;
      beyond = plus_cross(beyond, c, here.t) - (spun + along) * here.v;
      twist = twist + along * (1.0 - 2.0 * here.z) - dot(c, here.t);
    }
    if (j == n) continue;
    const Link& link = links[j];
    const double l = link.length;
    const Across<Number> tau = here.across(moment);
    const Space<Number> of_x = inertia.times(here.nx), of_z = inertia.times(here.nz);
    const Symmetric2<Number> nn{dot(here.nx, of_x), dot(here.nz, of_x), dot(here.nz, of_z)};
    const Across<Number> nt{dot(here.t, of_x), dot(here.t, of_z)};
    const Number tt = inertia.xx + inertia.yy + inertia.zz - nn.xx - nn.zz;
    const Symmetric2<Number> h{link.inertia + link.length_square * nn.xx,
                               link.length_square * nn.xz,
                               link.inertia + link.length_square * nn.zz};
    const Number share = inverse_of(Number(h.xx * h.zz - h.xz * h.xz));
    const Symmetric2<Number> inverse{share * h.zz, -(share * h.xz), share * h.xx};
    // (p + q N^T A N) / H, which is symmetric.
    const auto over_h = [&](double p, double q) -> Symmetric2<Number> {
      const Number xx = p + q * nn.xx, xz = q * nn.xz, zz = p + q * nn.zz;
      return {xx * inverse.xx + xz * inverse.xz, xx * inverse.xz + xz * inverse.zz,
              xz * inverse.xz + zz * inverse.zz};
    };
    const Number inward = l * here.square;
    const Across<Number> b = here.across(bias) - inward * nt;
    const Symmetric2<Number> turned = over_h(link.first_moment, l);
    const Across<Number> slant = inverse.times(nt);
    here.inverse = inverse;
    here.turned = turned;
    here.along = l * slant;
    here.free = inverse.times(tau - l * b);
    const Across<Number> force = turned.times(tau) + link.exchange * inverse.times(b);
    const Number force_along = dot(here.t, bias) + l * (push + dot(nt, here.free)) - inward * tt -
                               link.first_moment * here.square;
    bias = here.lifted(force) + force_along * here.t - here.force;
    const Symmetric2<Number> across = over_h(link.own_inertia, link.end_inertia);
    const Across<Number> mixed = link.exchange * slant;
    const Number along = tt + link.mass - link.length_square * dot(nt, slant);
    const Space<Number> x = here.lifted({across.xx, across.xz}) + mixed.x * here.t;
    const Space<Number> z = here.lifted({across.xz, across.zz}) + mixed.z * here.t;
    const Space<Number> t = here.lifted(mixed) + along * here.t;
    const auto entry_of = [&](auto row, auto column) {
      return x.*row * here.nx.*column + z.*row * here.nz.*column + t.*row * here.t.*column;
    };
    constexpr auto ix = &Space<Number>::x, iy = &Space<Number>::y, iz = &Space<Number>::z;
    inertia = {entry_of(ix, ix), entry_of(iy, iy), entry_of(iz, iz),
               entry_of(ix, iy), entry_of(ix, iz), entry_of(iy, iz)};
  }

  const Space<Number> start = drive.acceleration - model.gravity * in_plane<Number>(model.down);
  // If the pipe is held, once without its supports: that tells their forces.
  for (bool known = model.held_count == 0;; known = true) {
    Space<Number> joint = start;
    support = 0;
    for (Count j = 0; j < n; ++j) {
      const Link& link = links[j];
      const SpatialSegment<Number>& here = segments[j];
      const Across<Number> across = here.across(joint);
      const Number along = dot(here.t, joint);
      const Across<Number> free = here.free - along * here.along;
      if (known) put(j, here, here.acceleration(free - here.turned.times(across)));
      joint = here.lifted(link.exchange * here.inverse.times(across) + link.length * free) +
              (along - link.length * here.square) * here.t;
      if (known || support == model.held_count || model.held[support] != j) continue;
      Number* const lacking = room.forces + 2 * support++;
      lacking[0] = lacking[0] - (joint.x - start.x);
      lacking[1] = lacking[1] - (joint.z - start.z);
    }
    if (known) break;
    hold(model, room);
  }
  return power;
}

/// Energy of a state of the motion in space.
template <class Number, class Rows>
Number spatial_energy(const ChainModel& model, const Rows& rows) {
  const SpatialDrive<Number> drive(rows);
  Number twice{};
  Space<Number> r = drive.position + model.base * axis<Number>(), velocity{};
  Space<Number> t0 = axis<Number>();
  const SegmentTerm* term = model.loads;
  const SegmentTerm* const last_term = model.loads + model.load_count;
  SpatialSegment<Number> here;
  for (Count j = 0; j < model.size; ++j) {
    const Link& link = model.links[j];
    here.move(rows, model.size, j);
    here.join(t0, false);
    twice += link.spring * here.angle_square();
    twice += link.mass * dot(velocity, velocity) + link.inertia * here.square;
    twice += (2.0 * link.first_moment) * dot(velocity, here.rate);
    twice += (2.0 * link.weight) * (model.down[1] * here.drop() - model.down[0] * here.t.x);
    for (; term != last_term && term->segment == j; ++term) {
      const SpatialStation<Number> place = here.station(r, velocity + drive.velocity, term->arm);
      Laws::with(term->term, [&]<class Law>(const Law& law) {
        if constexpr (Law::moves) {
          with_station(law, place, drive.position, drive.velocity, [&](const auto& at) {
            twice += (2.0 * term->weight) * law.energy_in_space(at);
          });
        }
      });
    }
    if (link.added != 0.0) {
      twice += link.added * dot(here.normal(velocity), velocity);
    }
    r += link.length * here.t;
    velocity += link.length * here.rate;
    t0 = here.t;
  }
  if (model.guided) {
    here.t = axis<Number>();
    here.join(t0, false);
    twice += model.end_spring * here.angle_square();
  }
  return 0.5 * twice;
}

// ---------------------------------------------------------------------------------------- entry

/// Calls body(states, room) for a member alone or for every block of members.
template <class Body>
void for_each_spatial_block(const ChainModel& model, const Batch& batch, const Body& body) {
  const auto made = [&]<class Number>(const Number&) {
    return laid_out([&](Layout& layout) { return SpatialRoom<Number>(model, layout); });
  };
  if (batch.members == 1) return body(States<double>{{batch, 0, 1}}, made(0.0));
  const SpatialRoom<Pack> room = made(Pack{});
  for_each_members(batch, [&](const Members<Pack>& block) { body(States<Pack>{block}, room); });
}

template <bool with_power>
void spatial_rhs(const ChainModel& model, const Batch& batch, double* rates) {
  const Count n = model.size;
  for_each_spatial_block(
      model, batch, [&]<class Real>(const States<Real>& states, const SpatialRoom<Real>& room) {
        const Members<Real> members = states.members;
        const auto put = [=](Count j, const auto&, const Across<Real>& acceleration) {
          members.set_row(rates, j, members.row(2 * n + j));
          members.set_row(rates, n + j, members.row(3 * n + j));
          members.set_row(rates, 2 * n + j, acceleration.x);
          members.set_row(rates, 3 * n + j, acceleration.z);
        };
        const auto parts = spatial_accelerations<with_power>(model, states, room, put);
        if (with_power) members.set_row(rates, 4 * n, parts.total());
      });
}

void spatial_power(const ChainModel& model, const Batch& batch, double* out) {
  for_each_spatial_block(
      model, batch, [&]<class Real>(const States<Real>& states, const SpatialRoom<Real>& room) {
        const auto nothing = [](Count, const auto&, const auto&) {};
        spatial_accelerations<true>(model, states, room, nothing)
            .each([&](Count k, const Real& power) { states.members.set_row(out, k, power); });
      });
}

void spatial_energy(const ChainModel& model, const Batch& batch, double* out) {
  for_each_spatial_block(model, batch,
                         [&]<class Real>(const States<Real>& states, const SpatialRoom<Real>&) {
                           states.members.set_row(out, 0, spatial_energy<Real>(model, states));
                         });
}

/// Jacobian of each member, row-major, (members, 4 n, 4 n); with `all_rates`, before it the rates
/// and their derivative by the speed, (members, 2 + 4 n, 4 n).
template <bool all_rates>
void spatial_jacobian(const ChainModel& model, const Batch& batch, double* out) {
  using Number = Dual<Pack, 1u>;
  const Count n = model.size, rows = 4 * n, before = all_rates ? 2 : 0;
  const auto room = laid_out([&](Layout& layout) { return SpatialRoom<Number>(model, layout); });
  for (Count member = 0; member < batch.members; ++member) {
    double* const to = out + member * (before + rows) * rows;
    double* const slopes = to + before * rows;
    for (Count i = 0; i < (before + rows) * rows; ++i) to[i] = 0.0;
    for (Count j = 0; j < 2 * n; ++j) slopes[j * rows + 2 * n + j] = 1.0;
    for (Count first = 0; first < rows + all_rates; first += width) {
      const Seeded<Pack> seeded{batch, member, first, rows};
      const auto keep = [&](Count row, const Number& acceleration) {
        double* const value = all_rates ? to + row : nullptr;
        put_derivatives(acceleration, first, rows, slopes + row * rows, value, to + rows + row);
      };
      spatial_accelerations<false>(model, seeded, room,
                                   [&](Count j, const auto&, const Across<Number>& acceleration) {
                                     keep(2 * n + j, acceleration.x);
                                     keep(3 * n + j, acceleration.z);
                                   });
    }
    if (!all_rates) continue;
    for (Count j = 0; j < 2 * n; ++j) to[j] = batch.y[(2 * n + j) * batch.members + member];
  }
}

}  // namespace
