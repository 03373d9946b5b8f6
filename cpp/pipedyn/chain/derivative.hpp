// SPDX-License-Identifier: MIT
//
// Derivative of the chain's motion in O(n^2): the sweeps (sweeps.hpp) are differentiated with
// respect to the angle and the rate of each segment m, and each derivative is a column. With D for
// a derivative, in the frame of the clamp,
//   D a_j = D a_{j-1} + l_j D theta_j'' n_j + [j = m] jump_m,
//   D theta_j'' = g_j - e_j . D a_{j-1},
//   jump_m = -l_m (theta_m'' t_m + w_m^2 n_m) for the angle, -2 l_m w_m t_m for the rate.
// The segments beyond node j need the force A_j D a_j + b_j, where for each column
//   g_j = (tau_j - l_j n_j . b_j) / H_j,   b_{j-1} = b_j + c_j g_j   for j < m,
// and the moment tau_j, of the joint's spring, acts on the neighbours of m alone. The velocity of
// all segments beyond m changes by V_m = -l_m w_m t_m for the angle, or l_m n_m for the rate, so
// that only drag changes there, with r_j = 2 kappa l_j |v_j|:
//   b_j = R_j V_m,   g_j = q_j . V_m,   q_j = -(l_j R_j^T n_j + xi_j l_j r_j n_j) / H_j,
//   R_{j-1} = R_j + r_j n_j n_j^T + c_j q_j^T,   R_n = -(1 - c) sqrt(beta) U.
// The (2, 2) matrix R_j is the same for all columns. Let V_j be the sum over the places of segment
// j of the derivatives of the terms' loads by velocity, and V'_j the same sum weighted with the
// arms. V_j adds -V_j to R_{j-1} and V'_j adds n_j . V'_j / H_j to q_j^T; derivatives of couples
// add to q_j^T as well. The derivatives of loads by position do the same in a second pair of R_j
// and q_j: by the angle of m, the position of all segments beyond changes by l_m n_m.
// A column starts in row m, since all forces on segment m itself change. One sweep takes the rows
// from the tip to the clamp and one back; each row is computed for all its columns, either as
// vectors along the columns of one state, or with one state in each lane.
//
// Local to each translation unit, like pack.hpp.
#pragma once

#include "pipedyn/chain/sweeps.hpp"

namespace {

/// Directions along and across a segment.
template <class Real>
struct Frame {
  Plane<Real> t, n;

  Frame(const Real& sine, const Real& cosine) : t{sine, cosine}, n{cosine, -sine} {}
  Plane<Real> plane(const Real& along, const Real& across) const {
    return {along * t.x + across * n.x, along * t.y + across * n.y};
  }
};

/// Updates of one row for all its columns, the parts of the derivative that cost O(n^2).
template <class Real>
inline void row_inward(Count count, Plane<Real> moment, Plane<Real> force, Real* __restrict bx,
                       Real* __restrict by, Real* __restrict row) {
  for (Count m = 0; m < count; ++m) {
    const Real g = moment.x * bx[m] + moment.y * by[m];
    row[m] = g;
    bx[m] += force.x * g;
    by[m] += force.y * g;
  }
}

template <class Real>
inline void add_row_of_motion(Count count, Plane<Real> answer, const Real* __restrict vx,
                              const Real* __restrict vy, Real* __restrict row) {
  for (Count m = 0; m < count; ++m) row[m] += answer.x * vx[m] + answer.y * vy[m];
}

template <class Real>
inline void row_outward(Count count, Plane<Real> e, Plane<Real> step, Real* __restrict ax,
                        Real* __restrict ay, Real* __restrict row) {
  for (Count m = 0; m < count; ++m) {
    const Real acceleration = row[m] - e.x * ax[m] - e.y * ay[m];
    row[m] = acceleration;
    ax[m] += step.x * acceleration;
    ay[m] += step.y * acceleration;
  }
}

/// Changes with which a column starts in segment m, per change of the segment's angle or rate;
/// components along (t) and across (n) the segment.
template <class Real>
struct Source {
  Real jump_t{}, jump_n{};    // difference in acceleration between the segment's ends
  Real force_t{}, force_n{};  // force on the segment
  Real moment{};              // moment on the segment, without its joints' moments
  Real v_t{}, v_n{};          // velocity of all segments beyond
  Real end_t{}, end_n{};      // follower force
};

/// Stiffness of joint j if angle, else its damping; joint n is the joint of a guided end.
inline double joint(const MotionModel& model, Count j, bool angle) {
  if (j == model.size) return angle ? model.end_spring : model.end_damping;
  return angle ? model.links[j].spring : model.links[j].damping;
}

template <class Real>
Source<Real> angle_source(const MotionModel& model, const Kept<Real>& here, Count m, const Real& w,
                          const Real& u) {
  const Link& link = model.links[m];
  const double l = link.length;
  const Real square = w * w, thrust = m + 1 < model.size || model.guided ? Real{} : Real(u * u);
  const Real force =
      here.tt * (here.at - l * square) + here.tn * (here.an + l * here.acceleration) + here.bt;
  Real slope{}, pull{};
  if (model.drag) {
    const Real speed = absolute(here.v);
    slope = -2.0 * link.drag * speed * here.vt;
    pull = link.drag * speed * here.v;
  }
  return {.jump_t = -l * here.acceleration,
          .jump_n = -l * square,
          .force_t = -(2.0 * model.coriolis * u * l * w + pull),
          .force_n = slope,
          .moment = l * force + link.first_moment * here.at - link.drag_arm * slope,
          .v_t = -l * w,
          .end_t = -thrust * model.thrust[1],
          .end_n = thrust * model.thrust[0]};
}

template <class Real>
Source<Real> rate_source(const MotionModel& model, const Kept<Real>& here, Count m, const Real& w,
                         const Real& u) {
  const Link& link = model.links[m];
  const double l = link.length;
  const Real coriolis = model.coriolis * u;
  Real slope{};
  if (model.drag) slope = 2.0 * link.drag * absolute(here.v) * link.drag_arm;
  return {.jump_t = -2.0 * l * w,
          .force_n = 2.0 * coriolis * l + slope,
          .moment = -coriolis * l * l - link.drag_arm * slope,
          .v_n = all<Real>(l)};
}

/// Adds to a source the change of the loads on the segment by its own angle or rate, and the change
/// of the forces of mass that has inertia only across the segment. w: rate of the segment.
template <class Real>
void add_loads_to(Source<Real>& source, const MotionModel& model, const Link& link,
                  const Kept<Real>& here, const LoadMoments<Real>& loads, const Frame<Real>& frame,
                  bool angle, const Real& w) {
  const double first_moment = 0.5 * link.length * link.added;
  // Change of the velocity of a place, per unit of its arm.
  const Plane<Real> by = angle ? Plane<Real>{-w * frame.t.x, -w * frame.t.y} : frame.n;
  const Slopes<Real>(&slopes)[3] = loads.slopes;
  Plane<Real> force = force_by(slopes[1], by_velocity, by);
  Plane<Real> about = force_by(slopes[2], by_velocity, by);
  const Variable own = angle ? by_angle : by_rate;
  force = plus(force, force_by(slopes[0], own));
  about = plus(about, force_by(slopes[1], own));
  source.moment += slopes[0].by[2][own] + dot(couple_by(slopes[1], by_velocity), by);
  if (angle) {
    force = plus(force, force_by(slopes[1], by_position, frame.n));
    about = plus(about, force_by(slopes[2], by_position, frame.n));
    source.moment += dot(couple_by(slopes[1], by_position), frame.n);
    source.moment -= dot(frame.t, plane(loads.load[1]));
    // Acceleration of the joint, without the acceleration of the clamp that represents gravity.
    const Real at = here.at + model.gravity * frame.t.y, an = here.an + model.gravity * frame.n.y;
    source.force_t -= link.added * an;
    source.force_n -= link.added * at - first_moment * w * w;
    source.moment += first_moment * (at - here.at);
  } else {
    source.force_t += 2.0 * first_moment * w;
  }
  source.force_t -= dot(frame.t, force);
  source.force_n -= dot(frame.n, force);
  source.moment += dot(frame.n, about);
}

/// The matrix R_j: force that the segments beyond node j need per change of the velocity, or the
/// position, of all of them.
template <class Real>
struct Response {
  Real rows[2][2] = {};  // R

  /// Replaces R_j by R_{j-1} and returns q_j. frame, l, inverse, c: frame, length, 1 / H_j and c_j
  /// of segment j; drag, arm: r_j and the arm of the drag point; slopes: derivatives of the loads,
  /// of which those by the variables `by` and by + 1 are V_j; loads: derivatives of the loads'
  /// moment on the segment by the same variables.
  Plane<Real> pass(const Frame<Real>& frame, double l, const Real& inverse, const Plane<Real>& c,
                   const Real& drag, double arm, const Slopes<Real>& slopes, Variable by,
                   const Plane<Real>& loads) {
    const Plane<Real> across = frame.n, beyond = transposed_times(rows, across);
    const Real own = arm * drag;
    const Plane<Real> q{-(l * beyond.x + own * across.x - loads.x) * inverse,
                        -(l * beyond.y + own * across.y - loads.y) * inverse};
    rows[0][0] += drag * across.x * across.x + c.x * q.x - slopes.by[0][by];
    rows[0][1] += drag * across.x * across.y + c.x * q.y - slopes.by[0][by + 1];
    rows[1][0] += drag * across.y * across.x + c.y * q.x - slopes.by[1][by];
    rows[1][1] += drag * across.y * across.y + c.y * q.y - slopes.by[1][by + 1];
    return q;
  }
};

/// A state, or a block of states, about which the motion is linearised, and the quantities from
/// which its derivatives are computed.
template <class Real>
struct Linearised {
  const MotionModel& model;
  Members<Real> members;
  Real u, push;  // u and sqrt(beta) U'
  Sweep<Real> sweep;
  double *sine, *cosine;  // of each segment's angle
  Kept<Real>* kept;
  LoadMoments<Real>* loads;  // filled if the model has loads

  Linearised(const MotionModel& of, const Members<Real>& about, Layout& layout)
      : model(of),
        members(about),
        u(about.speed()),
        push{},
        sweep(of.size, layout),
        sine(layout.take(whole_packs(of.size * lanes<Real>))),
        cosine(layout.take(whole_packs(of.size * lanes<Real>))),
        kept(layout.take<Kept<Real>>(of.size)),
        loads(layout.take<LoadMoments<Real>>(loaded() ? of.size : 0)) {}

  /// Fills the arrays for the state.
  void linearise() {
    const Count n = model.size;
    const Driven<Real> driven = members.drive();
    push = model.coriolis * driven.rate;
    accelerations_of<true>(model, members, sweep, nullptr, kept);
    for (Count j = 0; j < n; ++j) sweep.set(sweep.turn, j, members.row(j));
    sincos(sweep.array(sweep.turn), n * lanes<Real>, sine, cosine);
    const auto angle_of = [this](Count j) { return members.row(j); };
    const auto rate_of = [this](Count j) { return rate(j); };
    if (loaded()) load_moments(model, sine, cosine, angle_of, rate_of, driven, loads);
  }
  bool loaded() const { return model.load_count > 0; }
  Real rate(Count k) const { return members.row(model.size + k); }
  Frame<Real> frame(Count k) const {
    return {load<Real>(sine + k * lanes<Real>), load<Real>(cosine + k * lanes<Real>)};
  }
  /// Derivatives of the loads' moment on segment k by the velocity, or the position, of its joint.
  Plane<Real> moment_by(Variable variable, Count k) const {
    const Slopes<Real>(&of)[3] = loads[k].slopes;
    return plus(work_by(of[1], variable, frame(k).n), couple_by(of[0], variable));
  }
  Real drag_slope(Count k) const {
    return model.drag ? Real(2.0 * model.links[k].drag * absolute(kept[k].v)) : Real{};
  }
  /// Source of the column for the angle of segment k, or for its rate.
  Source<Real> source(Count k, bool angle) const {
    const Real w = rate(k);
    Source<Real> found =
        angle ? angle_source(model, kept[k], k, w, u) : rate_source(model, kept[k], k, w, u);
    if (loaded() && loads[k].any) {
      add_loads_to(found, model, model.links[k], kept[k], loads[k], frame(k), angle, w);
    }
    const double* const slopes = members.batch.slopes;  // derivatives of the batch's moments
    if (angle && slopes != nullptr) found.moment += members.read_row(slopes, k);
    if (angle) found.force_n += push * model.links[k].length;
    return found;
  }
};

/// Scratch of the 2 n columns: n for the angles, then n for the rates.
template <class Real>
struct Columns {
  Real *bx, *by;                         // force b
  Real *ax, *ay;                         // change D a of the node's acceleration
  Real *vx, *vy;                         // V
  Real *jump_x, *jump_y;                 // jump
  Plane<Real>*answer, *position_answer;  // q of each segment, for velocity and for position

  Columns(const MotionModel& model, Layout& layout) {
    Real** const each[] = {&bx, &by, &ax, &ay, &vx, &vy, &jump_x, &jump_y};
    for (Real** const of : each) *of = layout.take<Real>(2 * model.size);
    answer = layout.take<Plane<Real>>(model.resists() ? model.size : 0);
    position_answer = layout.take<Plane<Real>>(model.load_count > 0 ? model.size : 0);
  }
};

/// Starts the column of a source in row k. b: change of the force that the segments beyond need; c:
/// c_k; row: row k of the result.
template <class Real>
void start_column(const Linearised<Real>& about, const Columns<Real>& columns, Count k,
                  Count column, const Source<Real>& source, Plane<Real> b, Plane<Real> c,
                  Real* row) {
  const Link& link = about.model.links[k];
  const Kept<Real>& here = about.kept[k];
  const Frame<Real> frame = about.frame(k);
  const Real pull_t = here.tt * source.jump_t + here.tn * source.jump_n;
  const Real pull_n = here.tn * source.jump_t + here.nn * source.jump_n;
  const Real g = (source.moment - link.length * (pull_n + dot(frame.n, b))) * here.inverse;
  const double lever = link.first_moment / link.length;  // m chi
  const Plane<Real> force = frame.plane(pull_t + lever * source.jump_t + source.force_t,
                                        pull_n + lever * source.jump_n + source.force_n);
  const Plane<Real> v = frame.plane(source.v_t, source.v_n);
  const Plane<Real> jump = frame.plane(source.jump_t, source.jump_n);
  row[column] = g;
  columns.bx[column] = b.x + force.x + c.x * g;
  columns.by[column] = b.y + force.y + c.y * g;
  columns.vx[column] = v.x;
  columns.vy[column] = v.y;
  columns.jump_x[column] = jump.x;
  columns.jump_y[column] = jump.y;
}

/// Sweep from the tip to the clamp. Writes g_k of the columns m >= k to row k of out (n, 2 n).
template <class Real>
void columns_inward(const Linearised<Real>& about, const Columns<Real>& columns, Real* out) {
  const MotionModel& model = about.model;
  const Count n = model.size;
  const bool loaded = about.loaded();
  const LoadMoments<Real> none{};
  Response<Real> to_velocity, to_position;
  to_velocity.rows[0][0] = to_velocity.rows[1][1] = -model.entry * about.u;
  Plane<Real> e_beyond{};  // e of the segment beyond
  for (Count k = n - 1; k >= 0; --k) {
    const Link& link = model.links[k];
    const Kept<Real>& here = about.kept[k];
    const Frame<Real> frame = about.frame(k);
    const double l = link.length;
    const Real inverse = here.inverse;
    const Plane<Real> c = frame.plane(l * here.tn, l * here.nn + link.first_moment);
    const Plane<Real> moment{-l * inverse * frame.n.x, -l * inverse * frame.n.y};
    Real* const row = out + k * 2 * n;
    for (Count block = 0; block <= n; block += n) {
      const bool angle = block == 0;
      const double spring = joint(model, k + 1, angle);
      const Count next = block + k + 1;
      row_inward(n - k - 1, moment, c, columns.bx + next, columns.by + next, row + next);
      if (k + 1 < n) {
        const Real g = spring * inverse;
        row[next] += g;
        columns.bx[next] += c.x * g;
        columns.by[next] += c.y * g;
      }
      Source<Real> source = about.source(k, angle);
      source.moment -= joint(model, k, angle) + spring;
      const Plane<Real> v = frame.plane(source.v_t, source.v_n);
      const Plane<Real> moved = times(to_velocity.rows, v);
      Plane<Real> b{moved.x + e_beyond.x * spring, moved.y + e_beyond.y * spring};
      if (k + 1 == n) b = plus(b, frame.plane(source.end_t, source.end_n));
      if (loaded && angle) b = plus(b, times(to_position.rows, {l * frame.n.x, l * frame.n.y}));
      start_column(about, columns, k, block + k, source, b, c, row);
    }
    e_beyond = {c.x * inverse, c.y * inverse};
    if (!model.resists()) continue;
    const LoadMoments<Real>& sums = loaded ? about.loads[k] : none;
    columns.answer[k] =
        to_velocity.pass(frame, l, inverse, c, about.drag_slope(k), link.drag_arm, sums.slopes[0],
                         by_velocity, loaded ? about.moment_by(by_velocity, k) : Plane<Real>{});
    if (!loaded) continue;
    columns.position_answer[k] = to_position.pass(frame, l, inverse, c, Real{}, 0.0, sums.slopes[0],
                                                  by_position, about.moment_by(by_position, k));
  }
}

/// Sweep from the clamp to the tip. Replaces g in every column by the change of theta''.
template <class Real>
void columns_outward(const Linearised<Real>& about, const Columns<Real>& columns, Real* out) {
  const MotionModel& model = about.model;
  const Count n = model.size;
  const bool loaded = about.loaded();
  for (Count m = 0; m < 2 * n; ++m) columns.ax[m] = columns.ay[m] = Real{};
  for (Count k = 0; k < n; ++k) {
    const Link& link = model.links[k];
    const Kept<Real>& here = about.kept[k];
    const Frame<Real> frame = about.frame(k);
    const double l = link.length;
    const Real inverse = here.inverse;
    const Plane<Real> e =
        frame.plane(l * here.tn * inverse, (l * here.nn + link.first_moment) * inverse);
    Real* const row = out + k * 2 * n;
    for (Count block = 0; block <= n; block += n) {
      if (model.resists()) {
        add_row_of_motion(k, columns.answer[k], columns.vx + block, columns.vy + block,
                          row + block);
      }
      // An angle changes positions by the vectors by which its rate changes velocities.
      if (loaded && block == 0) {
        add_row_of_motion(k, columns.position_answer[k], columns.vx + n, columns.vy + n, row);
      }
      if (k > 0) row[block + k - 1] += joint(model, k, block == 0) * inverse;
    }
    row_outward(2 * n, e, {l * frame.n.x, l * frame.n.y}, columns.ax, columns.ay, row);
    for (Count m = k; m < 2 * n; m += n) {
      columns.ax[m] += columns.jump_x[m];
      columns.ay[m] += columns.jump_y[m];
    }
  }
}

/// Writes the Jacobian (2 n, 2 n) of a state, or of each state of a block: n rows of derivatives of
/// theta', which are 0 and 1, then n rows of derivatives of theta''.
template <class Real>
void jacobian_of(const MotionModel& model, const Members<Real>& members, double* out) {
  const Count n = model.size, rows = 2 * n, half = n * rows;
  struct Scratch {
    Linearised<Real> about;
    Columns<Real> columns;
    Real* block;
  };
  constexpr bool alone = lanes<Real> == 1;
  auto [about, columns, block] = laid_out([&](Layout& layout) {
    return Scratch{Linearised<Real>(model, members, layout), Columns<Real>(model, layout),
                   layout.take<Real>(alone ? 0 : half)};
  });
  double* const to = out + members.first * 2 * half;
  for (Count i = 0; i < members.used * 2 * half; ++i) to[i] = 0.0;
  Real* accelerations = block;
  if constexpr (alone) {
    accelerations = to + half;
  } else {
    for (Count i = 0; i < half; ++i) block[i] = Real{};
  }
  about.linearise();
  columns_inward(about, columns, accelerations);
  columns_outward(about, columns, accelerations);
  for (Count k = 0; k < members.used; ++k) {
    double* const own = to + k * 2 * half;
    for (Count j = 0; j < n; ++j) own[j * rows + n + j] = 1.0;
    if constexpr (!alone) {
      const double* const lane = reinterpret_cast<const double*>(block) + k;
      for (Count i = 0; i < half; ++i) own[half + i] = lane[i * lanes<Real>];
    }
  }
}

/// Largest number of segments for which a batch is differentiated with one state in each lane of a
/// pack. Measured with 2, 4 and 8 lanes: this is three times as fast for few segments, and no
/// faster from 50 on, where the columns of one state fill packs as well and take less memory.
constexpr Count side_by_side = 40;

void jacobian(const MotionModel& model, const Batch& batch, double* out) {
  if (model.size > side_by_side || batch.members == 1) {
    for (Count k = 0; k < batch.members; ++k) {
      jacobian_of(model, Members<double>{batch, k, 1}, out);
    }
    return;
  }
  for_each_members(batch, [&](const Members<Pack>& block) { jacobian_of(model, block, out); });
}

}  // namespace
