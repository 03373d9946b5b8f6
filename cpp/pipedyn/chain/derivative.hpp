// SPDX-License-Identifier: MIT
//
// Derivative of the chain's motion in O(n^2): the sweeps (sweeps.hpp) differentiated with respect
// to the angle or the rate of one segment m, a column each. With D for that derivative, in the
// frame of the clamp,
//   D a_j = D a_{j-1} + l_j D theta_j'' n_j + [j = m] jump_m,
//   D theta_j'' = g_j - e_j . D a_{j-1},
//   jump_m = -l_m (theta_m'' t_m + w_m^2 n_m) for the angle, -2 l_m w_m t_m for the rate,
// and the force that all beyond node j needs is A_j D a_j + b_j, with this column's
//   g_j = (tau_j - l_j n_j . b_j) / H_j,   b_{j-1} = b_j + c_j g_j   for j < m,
// where tau_j, of the spring between them, acts on the neighbours of m alone. Beyond m everything
// moves with V_m = -l_m w_m t_m or l_m n_m, so that only drag acts there, r_j = 2 kappa l_j |v_j|:
//   b_j = R_j V_m,   g_j = q_j . V_m,   q_j = -(l_j R_j^T n_j + xi_j l_j r_j n_j) / H_j,
//   R_{j-1} = R_j + r_j n_j n_j^T + c_j q_j^T,   R_n = -(1 - c) sqrt(beta) U,
// one (2, 2) matrix R_j for all columns. The slopes of the terms' loads by velocity, summed over
// the places of segment j as V_j and with the arms as V'_j, add -V_j to R_{j-1} and n_j . V'_j /
// H_j to q_j^T. Their slopes by position do the same in a second pair of R_j and q_j, for the
// change of position l_m n_m of all beyond by the angle of m; those of couples add to the second.
// Row m, where all of it changes,
// starts the column. The rows go from the tip to the clamp and back, each over its columns as
// vectors.
//
// Local to each translation unit, like pack.hpp.
#pragma once

#include "pipedyn/chain/sweeps.hpp"

namespace {

/// Directions along and across a segment.
struct Frame {
  Plane t, n;

  Frame(double sine, double cosine) : t{sine, cosine}, n{cosine, -sine} {}
  Plane plane(double along, double across) const {
    return {along * t.x + across * n.x, along * t.y + across * n.y};
  }
};

/// The sweeps of one row over the columns, the parts of the derivative that cost O(n^2).
inline void row_inward(Count count, Plane moment, Plane force, double* __restrict bx,
                       double* __restrict by, double* __restrict row) {
  for (Count m = 0; m < count; ++m) {
    const double g = moment.x * bx[m] + moment.y * by[m];
    row[m] = g;
    bx[m] += force.x * g;
    by[m] += force.y * g;
  }
}

inline void add_row_of_motion(Count count, Plane answer, const double* __restrict vx,
                              const double* __restrict vy, double* __restrict row) {
  for (Count m = 0; m < count; ++m) row[m] += answer.x * vx[m] + answer.y * vy[m];
}

inline void row_outward(Count count, Plane e, Plane step, double* __restrict ax,
                        double* __restrict ay, double* __restrict row) {
  for (Count m = 0; m < count; ++m) {
    const double acceleration = row[m] - e.x * ax[m] - e.y * ay[m];
    row[m] = acceleration;
    ax[m] += step.x * acceleration;
    ay[m] += step.y * acceleration;
  }
}

/// What a column starts from: segment m itself changes, in angle or in rate.
struct Source {
  double jump_t = 0.0, jump_n = 0.0;    // of the acceleration from one end to the other
  double force_t = 0.0, force_n = 0.0;  // on the segment
  double moment = 0.0;                  // in its own row, without the joints'
  double v_t = 0.0, v_n = 0.0;          // change of velocity of all beyond
  double end_t = 0.0, end_n = 0.0;      // change of the follower force
};

/// What joint j resists a turn with, its angle or its rate; that of the end if it is guided.
inline double joint(const MotionModel& model, Count j, bool angle) {
  if (j == model.size) return angle ? model.end_spring : model.end_damping;
  return angle ? model.links[j].spring : model.links[j].damping;
}

Source angle_source(const MotionModel& model, const Kept& here, Count m, double w, double u) {
  const Link& link = model.links[m];
  const double l = link.length, square = w * w,
               thrust = m + 1 < model.size || model.guided ? 0.0 : u * u;
  const double force =
      here.tt * (here.at - l * square) + here.tn * (here.an + l * here.acceleration) + here.bt;
  const double speed = model.drag ? std::fabs(here.v) : 0.0;
  const double slope = model.drag ? -2.0 * link.drag * speed * here.vt : 0.0;
  const double pull = model.drag ? link.drag * speed * here.v : 0.0;
  return {.jump_t = -l * here.acceleration,
          .jump_n = -l * square,
          .force_t = -(2.0 * model.coriolis * u * l * w + pull),
          .force_n = slope,
          .moment = l * force + link.first_moment * here.at - link.drag_arm * slope,
          .v_t = -l * w,
          .end_t = -thrust * model.thrust[1],
          .end_n = thrust * model.thrust[0]};
}

Source rate_source(const MotionModel& model, const Kept& here, Count m, double w, double u) {
  const Link& link = model.links[m];
  const double l = link.length, coriolis = model.coriolis * u;
  const double slope = model.drag ? 2.0 * link.drag * std::fabs(here.v) * link.drag_arm : 0.0;
  return {.jump_t = -2.0 * l * w,
          .force_n = 2.0 * coriolis * l + slope,
          .moment = -coriolis * l * l - link.drag_arm * slope,
          .v_n = l};
}

/// Adds the change of the loads on a segment itself, with the rate w, by its angle or its rate, and
/// of the inertia of mass that moves across it alone.
void add_loads_to(Source& source, const MotionModel& model, const Link& link, const Kept& here,
                  const LoadMoments& loads, const Frame& frame, bool angle, double w) {
  const double first_moment = 0.5 * link.length * link.added;
  const Plane by = angle ? Plane{-w * frame.t.x, -w * frame.t.y} : frame.n;  // velocity by the arm
  Plane force = times(loads.slopes[1].by_velocity, by);
  Plane about = times(loads.slopes[2].by_velocity, by);
  if (angle) {
    force = plus(force, times(loads.slopes[1].by_position, frame.n));
    about = plus(about, times(loads.slopes[2].by_position, frame.n));
    force = plus(force, plane(loads.slopes[0].by_angle));
    about = plus(about, plane(loads.slopes[1].by_angle));
    source.moment -= dot(frame.t, plane(loads.load[1]));
    source.moment += loads.slopes[0].couple_by_angle;
    // The acceleration of the joint, without the clamp's that stands for gravity.
    const double at = here.at + model.gravity * frame.t.y, an = here.an + model.gravity * frame.n.y;
    source.force_t -= link.added * an;
    source.force_n -= link.added * at - first_moment * w * w;
    source.moment += first_moment * (at - here.at);
  } else {
    source.force_t += 2.0 * first_moment * w;
    force = plus(force, plane(loads.slopes[0].by_rate));
    about = plus(about, plane(loads.slopes[1].by_rate));
  }
  source.moment += dot(plane(loads.slopes[1].couple_by_velocity), by);
  source.force_t -= dot(frame.t, force);
  source.force_n -= dot(frame.n, force);
  source.moment += dot(frame.n, about);
}

/// Force that all beyond a segment needs for a change of its motion.
struct Response {
  double rows[2][2] = {};  // R

  /// Goes one segment nearer to the clamp and gives the answer q of its row. drag: r_j, and arm
  /// that of the drag; slope and moment: of the terms' loads.
  Plane pass(const Frame& frame, double l, double inverse, const Plane& c, double drag, double arm,
             const double (&slope)[2][2], const Plane& loads) {
    const Plane across = frame.n, beyond = transposed_times(rows, across);
    const double own = arm * drag;
    const Plane q{-(l * beyond.x + own * across.x - loads.x) * inverse,
                  -(l * beyond.y + own * across.y - loads.y) * inverse};
    rows[0][0] += drag * across.x * across.x + c.x * q.x - slope[0][0];
    rows[0][1] += drag * across.x * across.y + c.x * q.y - slope[0][1];
    rows[1][0] += drag * across.y * across.x + c.y * q.x - slope[1][0];
    rows[1][1] += drag * across.y * across.y + c.y * q.y - slope[1][1];
    return q;
  }
};

/// A state about which the motion is linearised, and what its derivatives are made of.
struct Linearised {
  const MotionModel& model;
  const double *rates, *slopes;  // the second of further moments
  double u, push;                // the second: sqrt(beta) U'
  Sweep<double> sweep;
  double *sine, *cosine;  // of each segment's angle
  Kept* kept;
  LoadMoments* loads;  // where there are any

  Linearised(const MotionModel& of, const Batch& one, Layout& layout)
      : model(of),
        rates(one.y + of.size),
        slopes(one.slopes),
        u(one.u[0]),
        push(0.0),
        sweep(of.size, layout),
        sine(layout.take(whole_packs(of.size))),
        cosine(layout.take(whole_packs(of.size))),
        kept(layout.take<Kept>(of.size)),
        loads(layout.take<LoadMoments>(loaded() ? of.size : 0)) {}

  /// Computes what the arrays hold.
  void linearise(const Batch& one) {
    const Count n = model.size;
    const Members<double> member{one, 0, 1};
    const Driven<double> driven = member.drive();
    push = model.coriolis * driven.rate;
    accelerations_of<true>(model, member, sweep, nullptr, false, kept);
    double* const angles = sweep.array(sweep.turn);
    for (Count j = 0; j < n; ++j) angles[j] = one.y[j];
    sincos(angles, n, sine, cosine);
    if (loaded()) load_moments(model, sine, cosine, rates, driven, loads);
  }
  bool loaded() const { return model.load_count > 0; }
  Frame frame(Count k) const { return Frame(sine[k], cosine[k]); }
  /// Change of the loads' moment on a segment by the velocity of its joint, or by its position.
  Plane moment_by_velocity(Count k) const {
    const Slopes<double>(&of)[3] = loads[k].slopes;
    return plus(transposed_times(of[1].by_velocity, frame(k).n), plane(of[0].couple_by_velocity));
  }
  Plane moment_by_position(Count k) const {
    return transposed_times(loads[k].slopes[1].by_position, frame(k).n);
  }
  double drag_slope(Count k) const {
    return model.drag ? 2.0 * model.links[k].drag * std::fabs(kept[k].v) : 0.0;
  }
  /// What changes with the angle or the rate of segment k.
  Source source(Count k, bool angle) const {
    Source found = angle ? angle_source(model, kept[k], k, rates[k], u)
                         : rate_source(model, kept[k], k, rates[k], u);
    if (loaded() && loads[k].any) {
      add_loads_to(found, model, model.links[k], kept[k], loads[k], frame(k), angle, rates[k]);
    }
    if (angle && slopes != nullptr) found.moment += slopes[k];
    if (angle) found.force_n += push * model.links[k].length;
    return found;
  }
};

/// Scratch: n columns for the angles, then n for the rates.
struct Columns {
  double *bx, *by;                  // force b
  double *ax, *ay;                  // change of the node's acceleration
  double *vx, *vy;                  // V
  double *jump_x, *jump_y;          // jump
  Plane *answer, *position_answer;  // q of each segment, where forces answer its motion

  Columns(const MotionModel& model, Layout& layout) {
    double** const all[] = {&bx, &by, &ax, &ay, &vx, &vy, &jump_x, &jump_y};
    for (double** const of : all) *of = layout.take(2 * model.size);
    answer = layout.take<Plane>(model.resists() ? model.size : 0);
    position_answer = layout.take<Plane>(model.load_count > 0 ? model.size : 0);
  }
};

/// Starts the column of a source in segment k; b: what the segments beyond need of k.
void start_column(const Linearised& about, const Columns& columns, Count k, Count column,
                  const Source& source, Plane b, Plane c, double* row) {
  const Link& link = about.model.links[k];
  const Kept& here = about.kept[k];
  const Frame frame = about.frame(k);
  const double pull_t = here.tt * source.jump_t + here.tn * source.jump_n;
  const double pull_n = here.tn * source.jump_t + here.nn * source.jump_n;
  const double g = (source.moment - link.length * (pull_n + dot(frame.n, b))) * here.inverse;
  const double lever = link.first_moment / link.length;  // m chi
  const Plane force = frame.plane(pull_t + lever * source.jump_t + source.force_t,
                                  pull_n + lever * source.jump_n + source.force_n);
  const Plane v = frame.plane(source.v_t, source.v_n);
  const Plane jump = frame.plane(source.jump_t, source.jump_n);
  row[column] = g;
  columns.bx[column] = b.x + force.x + c.x * g;
  columns.by[column] = b.y + force.y + c.y * g;
  columns.vx[column] = v.x;
  columns.vy[column] = v.y;
  columns.jump_x[column] = jump.x;
  columns.jump_y[column] = jump.y;
}

/// From the tip to the clamp: leaves g_k of the columns m >= k in row n + k of out.
void columns_inward(const Linearised& about, const Columns& columns, double* out) {
  const MotionModel& model = about.model;
  const Count n = model.size;
  const bool loaded = about.loaded();
  const LoadMoments none{};
  Response by_velocity, by_position;
  by_velocity.rows[0][0] = by_velocity.rows[1][1] = -model.entry * about.u;
  Plane e_beyond{0.0, 0.0};  // e of the segment beyond
  for (Count k = n - 1; k >= 0; --k) {
    const Link& link = model.links[k];
    const Kept& here = about.kept[k];
    const Frame frame = about.frame(k);
    const double l = link.length, inverse = here.inverse;
    const Plane c = frame.plane(l * here.tn, l * here.nn + link.first_moment);
    const Plane moment{-l * inverse * frame.n.x, -l * inverse * frame.n.y};
    double* const row = out + (n + k) * 2 * n;
    for (Count block = 0; block <= n; block += n) {
      const bool angle = block == 0;
      const double spring = joint(model, k + 1, angle);
      const Count next = block + k + 1;
      row_inward(n - k - 1, moment, c, columns.bx + next, columns.by + next, row + next);
      if (k + 1 < n) {
        const double g = spring * inverse;
        row[next] += g;
        columns.bx[next] += c.x * g;
        columns.by[next] += c.y * g;
      }
      Source source = about.source(k, angle);
      source.moment -= joint(model, k, angle) + spring;
      const Plane v = frame.plane(source.v_t, source.v_n);
      const Plane moved = times(by_velocity.rows, v);
      Plane b{moved.x + e_beyond.x * spring, moved.y + e_beyond.y * spring};
      if (k + 1 == n) b = plus(b, frame.plane(source.end_t, source.end_n));
      if (loaded && angle) b = plus(b, times(by_position.rows, {l * frame.n.x, l * frame.n.y}));
      start_column(about, columns, k, block + k, source, b, c, row);
    }
    e_beyond = {c.x * inverse, c.y * inverse};
    if (!model.resists()) continue;
    const LoadMoments& sums = loaded ? about.loads[k] : none;
    columns.answer[k] = by_velocity.pass(frame, l, inverse, c, about.drag_slope(k), link.drag_arm,
                                         sums.slopes[0].by_velocity,
                                         loaded ? about.moment_by_velocity(k) : Plane{0.0, 0.0});
    if (!loaded) continue;
    columns.position_answer[k] = by_position.pass(
        frame, l, inverse, c, 0.0, 0.0, sums.slopes[0].by_position, about.moment_by_position(k));
  }
}

/// From the clamp to the tip: turns the g of every column into the change of theta''.
void columns_outward(const Linearised& about, const Columns& columns, double* out) {
  const MotionModel& model = about.model;
  const Count n = model.size;
  const bool loaded = about.loaded();
  for (Count m = 0; m < 2 * n; ++m) columns.ax[m] = columns.ay[m] = 0.0;
  for (Count k = 0; k < n; ++k) {
    const Link& link = model.links[k];
    const Kept& here = about.kept[k];
    const Frame frame = about.frame(k);
    const double l = link.length, inverse = here.inverse;
    const Plane e = frame.plane(l * here.tn * inverse, (l * here.nn + link.first_moment) * inverse);
    double* const row = out + (n + k) * 2 * n;
    for (Count block = 0; block <= n; block += n) {
      if (model.resists()) {
        add_row_of_motion(k, columns.answer[k], columns.vx + block, columns.vy + block,
                          row + block);
      }
      if (loaded && block == 0) {  // positions change by an angle as velocities do by its rate
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

void jacobian(const MotionModel& model, const Batch& one, double* out) {
  const Count n = model.size;
  struct Scratch {
    Linearised about;
    Columns columns;
  };
  auto [about, columns] = laid_out([&](Layout& layout) {
    return Scratch{Linearised(model, one, layout), Columns(model, layout)};
  });
  about.linearise(one);
  std::memset(out, 0, static_cast<std::size_t>(4 * n * n) * sizeof(double));
  for (Count j = 0; j < n; ++j) out[j * 2 * n + n + j] = 1.0;
  columns_inward(about, columns, out);
  columns_outward(about, columns, out);
}

}  // namespace
