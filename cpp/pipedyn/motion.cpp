// SPDX-License-Identifier: MIT
//
// The chain's motion in O(n) a state, in the frames of the segments: t_j along segment j, n_j
// across it, phi_j = theta_j - theta_{j-1} from one to the next. Whatever turns with no bend in the
// chain takes the sine of a small angle, not a difference of large ones.
//
// With w_j = theta_j' and the acceleration a_j of node j, gravity as an acceleration of the clamp,
//   a_j = a_{j-1} + l_j (theta_j'' n_j - w_j^2 t_j),   a_0 = -gamma (0, 1).
// All beyond node j answers a_j with the force A_j a_j + b_j, A_j symmetric (2, 2), A_n = 0,
// b_n = a U^2 t_n (follower force). The moments about the joint of segment j give
//   theta_j'' = g_j - e_j . a_{j-1},   e_j = c_j / H_j,   c_j = l_j A_j n_j + m_j chi_j l_j n_j,
//   H_j = l_j^2 n_j . A_j n_j + m_j (chi_j^2 l_j^2 + eta_j^2),
//   g_j = (tau_j - l_j n_j . (b_j - l_j w_j^2 A_j t_j)) / H_j,
//   tau_j = K_{j+1} - K_j - sqrt(beta) U l_j^2 w_j - xi_j l_j d_j,   K_j = k_j (phi_j + delta
//   phi_j'),
// with the drag d_j = kappa l_j |v_j| v_j, and one segment nearer to the clamp
//   A_{j-1} = A_j + m_j - c_j e_j^T,
//   b_{j-1} = b_j - w_j^2 (l_j A_j + m_j chi_j l_j) t_j + c_j g_j + (2 sqrt(beta) U l_j w_j + d_j)
//   n_j.
// These are eqs. (1)-(11) of Orsino and Di Giulio, solved by one sweep to the tip (velocities), one
// back and one out. Across the segment A_{j-1} and b_{j-1} are written as sums without
// cancellation.
//
// The source is compiled once for each vector level, with PIPEDYN_LEVEL and PIPEDYN_WIDTH set. A
// batch goes through in blocks of one pack of members; a single state takes its sines by packs of
// segments.
#include "pipedyn/motion.hpp"

#include "pipedyn/pack.hpp"

namespace {

using pipedyn::Batch, pipedyn::Link, pipedyn::MotionModel, pipedyn::PowerParts;

Count whole_packs(Count count) { return (count + width - 1) / width * width; }

/// Some members of a batch, as many as a Real holds or, in a narrow batch, fewer.
template <class Real>
struct Members {
  const Batch& batch;
  Count first, used;

  Real read(const double* from) const {
    if (used == lanes<Real>) return load<Real>(from);
    double each[lanes<Real>];
    for (Count i = 0; i < lanes<Real>; ++i) each[i] = from[i < used ? i : used - 1];
    return load<Real>(each);
  }
  void write(double* to, const Real& x) const {
    if (used == lanes<Real>) {
      store(to, x);
      return;
    }
    double each[lanes<Real>];
    store(each, x);
    for (Count i = 0; i < used; ++i) to[i] = each[i];
  }
  Real row(Count j) const { return read(batch.y + j * batch.members + first); }
  void set_row(double* out, Count j, const Real& x) const {
    write(out + j * batch.members + first, x);
  }
  Real speed() const { return batch.u_step == 0 ? all<Real>(batch.u[0]) : read(batch.u + first); }
};

/// Calls body for every block of members; the last one overlaps its neighbour to be whole.
template <class Real, class Body>
void for_each_block(const Batch& batch, const Body& body) {
  for (Count first = 0; first < batch.members; first += lanes<Real>) {
    const Count left = batch.members - first;
    if (left >= lanes<Real>) {
      body(Members<Real>{batch, first, lanes<Real>});
    } else if (first > 0) {
      body(Members<Real>{batch, batch.members - lanes<Real>, lanes<Real>});
    } else {
      body(Members<Real>{batch, 0, left});
    }
  }
}

/// Scratch of the sweeps, one Real a segment in each; two serve twice.
template <class Real>
struct Sweep {
  double *turn, *rate, *sine, *cosine, *drag, *free;

  Sweep(double* scratch, Count n) {
    const Count stride = whole_packs(n * lanes<Real>);
    turn = scratch;
    rate = turn + stride;
    sine = rate + stride;
    cosine = sine + stride;
    drag = cosine + stride;
    free = drag + stride;
    for (Count i = n * lanes<Real>; i < stride; ++i) turn[i] = 0.0;
  }
  static Count size(Count n) { return 6 * whole_packs(n * lanes<Real>); }

  static Real at(const double* array, Count j) { return load<Real>(array + j * lanes<Real>); }
  static void set(double* array, Count j, const Real& x) { store(array + j * lanes<Real>, x); }
};

/// What the derivative needs of the sweeps: A_j and b_j . t_j, a_{j-1} and the velocities.
struct Kept {
  double tt, tn, nn, inverse, bt, at, an, vt, v, acceleration;
};

template <class Real>
void read_state(const Members<Real>& members, Count n, const Sweep<Real>& sweep) {
  Real before{};
  for (Count j = 0; j < n; ++j) {
    const Real angle = members.row(j);
    sweep.set(sweep.turn, j, angle - before);
    sweep.set(sweep.rate, j, members.row(n + j));
    before = angle;
  }
  sincos(sweep.turn, n * lanes<Real>, sweep.sine, sweep.cosine);
}

/// Calls body(j, vt, vn, w) with the velocity of the clamped side of each segment in its frame,
/// from the clamp on; returns that of the free end through the last two arguments.
template <class Real, class Body>
void for_each_velocity(const MotionModel& model, const Sweep<Real>& sweep, const Body& body,
                       Real& vt, Real& vn) {
  vt = vn = Real{};
  for (Count j = 0; j < model.size; ++j) {
    const Real s = sweep.at(sweep.sine, j), c = sweep.at(sweep.cosine, j);
    const Real w = sweep.at(sweep.rate, j);
    const Real along = c * vt + s * vn;
    const Real across = c * vn - s * vt;
    body(j, along, across, w);
    vt = along;
    vn = across + model.links[j].length * w;
  }
}

template <class Real, bool drag, bool damped, bool flowing, bool keep>
void accelerations(const MotionModel& model, const Members<Real>& members, double* rates,
                   double* scratch, Kept* kept) {
  const Count n = model.size;
  const Sweep<Real> sweep(scratch, n);
  read_state(members, n, sweep);

  if constexpr (drag) {
    Real end_along, end_across;
    for_each_velocity(
        model, sweep,
        [&](Count j, const Real& along, const Real& across, const Real& w) {
          const Link& link = model.links[j];
          const Real v = across + link.drag_arm * w;
          sweep.set(sweep.drag, j, link.drag * (absolute(v) * v));
          if constexpr (keep) kept[j].vt = along, kept[j].v = v;
        },
        end_along, end_across);
  }

  Real tt{}, tn{}, nn{}, bt{}, bn{}, moment_beyond{}, coriolis{};
  if constexpr (flowing) {
    const Real u = members.speed();
    coriolis = model.coriolis * u;
    bt = model.centrifugal * (u * u);
  }
  for (Count j = n - 1; j >= 0; --j) {
    const Link& link = model.links[j];
    const double l = link.length;
    const Real w = sweep.at(sweep.rate, j);
    Real strain = sweep.at(sweep.turn, j);
    if constexpr (damped) {
      const Real before = j > 0 ? sweep.at(sweep.rate, j - 1) : Real{};
      strain += model.damping * (w - before);
    }
    const Real moment = link.spring * strain;
    Real tau = moment_beyond - moment;
    moment_beyond = moment;
    Real across{};  // force that acts across the segment at its clamped side
    if constexpr (flowing) {
      const Real momentum = coriolis * (l * w);
      tau -= l * momentum;
      across += 2.0 * momentum;
    }
    if constexpr (drag) {
      const Real force = sweep.at(sweep.drag, j);
      tau -= link.drag_arm * force;
      across += force;
    }
    const Real square = w * w;
    const Real centripetal = l * square;
    const Real b = bn - centripetal * tn;
    const Real inverse = 1.0 / (link.length_square * nn + link.inertia);
    const Real ct = l * tn;
    const Real cn = l * nn + link.first_moment;
    const Real et = ct * inverse;
    const Real g = (tau - l * b) * inverse;
    if constexpr (keep) {
      Kept& here = kept[j];
      here.tt = tt, here.tn = tn, here.nn = nn, here.inverse = inverse, here.bt = bt;
    }
    sweep.set(sweep.turn, j, et);
    sweep.set(sweep.drag, j, cn * inverse);
    sweep.set(sweep.free, j, g);

    const Real force_along = bt - centripetal * tt - link.first_moment * square + ct * g;
    const Real force_across = (link.exchange * b + cn * tau) * inverse + across;
    const Real along_along = (tt + link.mass) - ct * et;
    const Real along_across = (link.exchange * tn) * inverse;
    const Real across_across = (link.end_inertia * nn + link.own_inertia) * inverse;
    const Real s = sweep.at(sweep.sine, j), c = sweep.at(sweep.cosine, j);
    const Real ss = s * s, cc = c * c, sc = s * c;
    const Real twice = 2.0 * sc * along_across;
    tt = cc * along_along - twice + ss * across_across;
    nn = ss * along_along + twice + cc * across_across;
    tn = sc * (along_along - across_across) + (cc - ss) * along_across;
    bt = c * force_along - s * force_across;
    bn = s * force_along + c * force_across;
  }

  Real at = all<Real>(-model.gravity), an{};
  for (Count j = 0; j < n; ++j) {
    const double l = model.links[j].length;
    const Real s = sweep.at(sweep.sine, j), c = sweep.at(sweep.cosine, j);
    const Real w = sweep.at(sweep.rate, j);
    const Real along = c * at + s * an;
    const Real across = c * an - s * at;
    const Real acceleration = sweep.at(sweep.free, j) - sweep.at(sweep.turn, j) * along -
                              sweep.at(sweep.drag, j) * across;
    if constexpr (keep) {
      Kept& here = kept[j];
      here.at = along, here.an = across, here.acceleration = acceleration;
    } else {
      members.set_row(rates, j, w);
      members.set_row(rates, n + j, acceleration);
    }
    at = along - l * (w * w);
    an = across + l * acceleration;
  }
}

template <class Real, bool keep>
void accelerations_of(const MotionModel& model, const Members<Real>& members, double* rates,
                      double* scratch, Kept* kept) {
  using Function = void (*)(const MotionModel&, const Members<Real>&, double*, double*, Kept*);
  static constexpr Function table[8] = {
      accelerations<Real, false, false, false, keep>, accelerations<Real, true, false, false, keep>,
      accelerations<Real, false, true, false, keep>,  accelerations<Real, true, true, false, keep>,
      accelerations<Real, false, false, true, keep>,  accelerations<Real, true, false, true, keep>,
      accelerations<Real, false, true, true, keep>,   accelerations<Real, true, true, true, keep>};
  const Batch& batch = members.batch;
  bool flowing = batch.u[0] != 0.0;
  if (batch.u_step != 0) {
    for (Count i = 0; i < members.used; ++i) flowing |= batch.u[members.first + i] != 0.0;
  }
  const int which = (model.drag ? 1 : 0) + (model.damping != 0.0 ? 2 : 0) + (flowing ? 4 : 0);
  table[which](model, members, rates, scratch, kept);
}

template <class Real>
void energy_of(const MotionModel& model, const Members<Real>& members, double* out,
               double* scratch) {
  const Count n = model.size;
  const Sweep<Real> sweep(scratch, n);
  Real twice{};
  if (model.gravity != 0.0) {  // 1 - cos theta = 2 sin^2 (theta / 2)
    for (Count j = 0; j < n; ++j) sweep.set(sweep.turn, j, 0.5 * members.row(j));
    sincos(sweep.turn, n * lanes<Real>, sweep.sine, sweep.cosine);
    for (Count j = 0; j < n; ++j) {
      const Real s = sweep.at(sweep.sine, j);
      twice += 4.0 * model.links[j].weight * (s * s);
    }
  }
  read_state(members, n, sweep);
  Real end_along, end_across;
  for_each_velocity(
      model, sweep,
      [&](Count j, const Real& along, const Real& across, const Real& w) {
        const Link& link = model.links[j];
        const Real turn = sweep.at(sweep.turn, j);
        twice += link.mass * (along * along + across * across);
        twice += w * (2.0 * link.first_moment * across + link.inertia * w);
        twice += link.spring * (turn * turn);
      },
      end_along, end_across);
  members.write(out + members.first, 0.5 * twice);
}

template <class Real>
void power_of(const MotionModel& model, const Members<Real>& members, const PowerParts& out,
              double* scratch) {
  const Count n = model.size;
  const Sweep<Real> sweep(scratch, n);
  read_state(members, n, sweep);
  Real joints{}, drag{}, rate_before{}, vt, vn;
  for_each_velocity(
      model, sweep,
      [&](Count j, const Real&, const Real& across, const Real& w) {
        const Link& link = model.links[j];
        const Real turning = w - rate_before;
        const Real v = across + link.drag_arm * w;
        joints -= model.damping * link.spring * (turning * turning);
        drag -= link.drag * (absolute(v) * (v * v));
        rate_before = w;
      },
      vt, vn);
  const Real u = members.speed();
  const Real flow =
      -(model.coriolis * u) * (vt * vt + vn * vn) - (model.centrifugal * (u * u)) * vt;
  members.write(out.flow + members.first, flow);
  members.write(out.joints + members.first, joints);
  members.write(out.drag + members.first, drag);
}

// ---------------------------------------------------------------------------------- derivative

struct Plane {
  double x, y;
};

inline double dot(const Plane& a, const Plane& b) { return a.x * b.x + a.y * b.y; }

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

inline void row_of_motion(Count count, Plane answer, const double* __restrict vx,
                          const double* __restrict vy, double* __restrict row) {
  for (Count m = 0; m < count; ++m) row[m] = answer.x * vx[m] + answer.y * vy[m];
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
  double jump_t, jump_n;    // of the acceleration from one end to the other
  double force_t, force_n;  // on the segment
  double moment;            // in its own row
  double spring;            // in its neighbours' rows
  double v_t, v_n;          // change of velocity of all beyond
  double end;               // change of the follower force, across the last segment
};

Source angle_source(const MotionModel& model, const Kept& here, Count m, double w, double u) {
  const Link& link = model.links[m];
  const double l = link.length, square = w * w, thrust = model.centrifugal * u * u;
  const double force =
      here.tt * (here.at - l * square) + here.tn * (here.an + l * here.acceleration) + here.bt;
  const double speed = model.drag ? std::fabs(here.v) : 0.0;
  const double slope = model.drag ? -2.0 * link.drag * speed * here.vt : 0.0;
  const double pull = model.drag ? link.drag * speed * here.v : 0.0;
  const double beyond = m + 1 < model.size ? model.links[m + 1].spring : 0.0;
  Source source;
  source.jump_t = -l * here.acceleration;
  source.jump_n = -l * square;
  source.force_t = -(2.0 * model.coriolis * u * l * w + pull);
  source.force_n = slope;
  source.moment = l * force + link.first_moment * here.at - link.drag_arm * slope;
  source.moment -= link.spring + beyond;
  source.spring = 1.0;
  source.v_t = -l * w;
  source.v_n = 0.0;
  source.end = m + 1 < model.size ? 0.0 : thrust;
  return source;
}

Source rate_source(const MotionModel& model, const Kept& here, Count m, double w, double u) {
  const Link& link = model.links[m];
  const double l = link.length, coriolis = model.coriolis * u;
  const double slope = model.drag ? 2.0 * link.drag * std::fabs(here.v) * link.drag_arm : 0.0;
  const double beyond = m + 1 < model.size ? model.links[m + 1].spring : 0.0;
  Source source;
  source.jump_t = -2.0 * l * w;
  source.jump_n = 0.0;
  source.force_t = 0.0;
  source.force_n = 2.0 * coriolis * l + slope;
  source.moment = -coriolis * l * l - link.drag_arm * slope;
  source.moment -= model.damping * (link.spring + beyond);
  source.spring = model.damping;
  source.v_t = 0.0;
  source.v_n = l;
  source.end = 0.0;
  return source;
}

/// The derivative of the sweeps above with respect to angle and rate of segment m, column by column
/// in the frame of the clamp. Beyond m every segment only moves with the change of velocity V of
/// its clamped side, so the force that it passes on is D V with one (2, 2) matrix D a segment, due
/// to drag; before m every segment only passes the force b on. So a column costs O(n), all its
/// steps are the same for every column, and the columns go through as vectors.
void jacobian(const MotionModel& model, const double* y, double u, double* out, double* scratch) {
  const Count n = model.size, columns = 2 * n;
  const Count blocks[] = {0, n};  // angles, rates
  double* const sine = scratch;
  double* const cosine = sine + whole_packs(n);
  double* const bx = cosine + whole_packs(n);  // force passed on, a column each
  double* const by = bx + columns;
  double* const ax = by + columns;  // change of the node's acceleration
  double* const ay = ax + columns;
  double* const vx = ay + columns;  // change of the velocity beyond m
  double* const vy = vx + columns;
  double* const jump_x = vy + columns;
  double* const jump_y = jump_x + columns;
  Plane* const answer = reinterpret_cast<Plane*>(jump_y + columns);  // to V, a segment each
  Kept* const kept = reinterpret_cast<Kept*>(answer + n);
  double* const sweeps = reinterpret_cast<double*>(kept + n);

  const Batch one{y, &u, 1, 0};
  accelerations_of<double, true>(model, Members<double>{one, 0, 1}, nullptr, sweeps, kept);
  for (Count j = 0; j < n; ++j) sweeps[j] = y[j];
  for (Count j = n; j < whole_packs(n); ++j) sweeps[j] = 0.0;
  sincos(sweeps, n, sine, cosine);

  std::memset(out, 0, static_cast<std::size_t>(n * columns) * sizeof(double));
  for (Count j = 0; j < n; ++j) out[j * columns + n + j] = 1.0;

  double dxx = 0.0, dxy = 0.0, dyx = 0.0, dyy = 0.0;  // D
  Plane beyond{0.0, 0.0};                             // c / H of the segment beyond
  for (Count k = n - 1; k >= 0; --k) {
    const Link& link = model.links[k];
    const Kept& here = kept[k];
    const double l = link.length, inverse = here.inverse;
    const Plane t{sine[k], cosine[k]}, across{cosine[k], -sine[k]};
    const double ct = l * here.tn, cn = l * here.nn + link.first_moment;
    const Plane c{ct * t.x + cn * across.x, ct * t.y + cn * across.y};
    const Plane moment{-l * inverse * across.x, -l * inverse * across.y};
    double* const row = out + (n + k) * columns;
    for (const Count block : blocks) {
      const Count first = block + k + 1;
      row_inward(n - k - 1, moment, c, bx + first, by + first, row + first);
      const double factor = block == 0 ? 1.0 : model.damping;
      if (k + 1 < n) {  // the spring between segments k and k + 1
        const double g = factor * model.links[k + 1].spring * inverse;
        row[first] += g;
        bx[first] += c.x * g;
        by[first] += c.y * g;
      }
      const Count column = block + k;
      const double w = y[n + k];
      const Source source =
          block == 0 ? angle_source(model, here, k, w, u) : rate_source(model, here, k, w, u);
      const Plane v{source.v_t * t.x + source.v_n * across.x,
                    source.v_t * t.y + source.v_n * across.y};
      const Plane jump{source.jump_t * t.x + source.jump_n * across.x,
                       source.jump_t * t.y + source.jump_n * across.y};
      const double stiff = k + 1 < n ? source.spring * model.links[k + 1].spring : 0.0;
      Plane b{dxx * v.x + dxy * v.y + beyond.x * stiff + source.end * across.x,
              dyx * v.x + dyy * v.y + beyond.y * stiff + source.end * across.y};
      const double pull_t = here.tt * source.jump_t + here.tn * source.jump_n;
      const double pull_n = here.tn * source.jump_t + here.nn * source.jump_n;
      const double g = (source.moment - l * (pull_n + dot(across, b))) * inverse;
      const double arm = link.first_moment / l;  // m chi
      const double force_t = pull_t + arm * source.jump_t + source.force_t;
      const double force_n = pull_n + arm * source.jump_n + source.force_n;
      row[column] = g;
      bx[column] = b.x + force_t * t.x + force_n * across.x + c.x * g;
      by[column] = b.y + force_t * t.y + force_n * across.y + c.y * g;
      vx[column] = v.x;
      vy[column] = v.y;
      jump_x[column] = jump.x;
      jump_y[column] = jump.y;
    }
    beyond = {c.x * inverse, c.y * inverse};
    if (model.drag) {
      const double slope = 2.0 * link.drag * std::fabs(here.v);
      const double own = link.drag_arm * slope;
      const Plane q{-(l * (across.x * dxx + across.y * dyx) + own * across.x) * inverse,
                    -(l * (across.x * dxy + across.y * dyy) + own * across.y) * inverse};
      dxx += slope * across.x * across.x + c.x * q.x;
      dxy += slope * across.x * across.y + c.x * q.y;
      dyx += slope * across.y * across.x + c.y * q.x;
      dyy += slope * across.y * across.y + c.y * q.y;
      answer[k] = q;
    }
  }

  for (Count m = 0; m < columns; ++m) ax[m] = ay[m] = 0.0;
  for (Count k = 0; k < n; ++k) {
    const Link& link = model.links[k];
    const Kept& here = kept[k];
    const double l = link.length, inverse = here.inverse;
    const Plane t{sine[k], cosine[k]}, across{cosine[k], -sine[k]};
    const double et = l * here.tn * inverse, en = (l * here.nn + link.first_moment) * inverse;
    const Plane e{et * t.x + en * across.x, et * t.y + en * across.y};
    double* const row = out + (n + k) * columns;
    for (const Count block : blocks) {
      if (model.drag) {
        row_of_motion(k, answer[k], vx + block, vy + block, row + block);
      } else {
        std::memset(row + block, 0, static_cast<std::size_t>(k) * sizeof(double));
      }
      const double factor = block == 0 ? 1.0 : model.damping;
      if (k > 0) row[block + k - 1] += factor * link.spring * inverse;
    }
    row_outward(columns, e, {l * across.x, l * across.y}, ax, ay, row);
    for (const Count block : blocks) {
      ax[block + k] += jump_x[block + k];
      ay[block + k] += jump_y[block + k];
    }
  }
}

Count jacobian_scratch_size(Count n) {
  return 2 * whole_packs(n) + 16 * n + 2 * n + 10 * n + Sweep<double>::size(n);
}

// ---------------------------------------------------------------------------------------- entry

Count scratch_size(Count n, Count members) {
  return members == 1 ? Sweep<double>::size(n) : Sweep<Pack>::size(n);
}

void rhs(const MotionModel& model, const Batch& batch, double* rates, double* scratch) {
  if (batch.members == 1) {
    accelerations_of<double, false>(model, Members<double>{batch, 0, 1}, rates, scratch, nullptr);
    return;
  }
  for_each_block<Pack>(batch, [&](const Members<Pack>& members) {
    accelerations_of<Pack, false>(model, members, rates, scratch, nullptr);
  });
}

void energy(const MotionModel& model, const Batch& batch, double* out, double* scratch) {
  if (batch.members == 1) {
    energy_of(model, Members<double>{batch, 0, 1}, out, scratch);
    return;
  }
  for_each_block<Pack>(
      batch, [&](const Members<Pack>& members) { energy_of(model, members, out, scratch); });
}

void power(const MotionModel& model, const Batch& batch, const PowerParts& out, double* scratch) {
  if (batch.members == 1) {
    power_of(model, Members<double>{batch, 0, 1}, out, scratch);
    return;
  }
  for_each_block<Pack>(
      batch, [&](const Members<Pack>& members) { power_of(model, members, out, scratch); });
}

bool all_finite(const double* x, Count count) {
  Pack sum{};
  Count i = 0;
  for (; i + width <= count; i += width) sum += 0.0 * load<Pack>(x + i);
  double each[width], rest = 0.0;
  store(each, sum);
  for (const double lane : each) rest += lane;
  for (; i < count; ++i) rest += 0.0 * x[i];
  return rest == 0.0;
}

void sincos_of(const double* x, Count count, double* sine, double* cosine, double* scratch) {
  double* const s = scratch + width;
  double* const c = s + width;
  for (Count i = 0; i < count; i += width) {
    for (Count lane = 0; lane < width; ++lane) scratch[lane] = i + lane < count ? x[i + lane] : 0.0;
    sincos(scratch, width, s, c);
    for (Count lane = 0; lane < width && i + lane < count; ++lane) {
      sine[i + lane] = s[lane];
      cosine[i + lane] = c[lane];
    }
  }
}

}  // namespace

#define PIPEDYN_JOINED(a, b) a##b
#define PIPEDYN_NAMED(level) PIPEDYN_JOINED(motion_, level)
#define PIPEDYN_QUOTED(level) #level
#define PIPEDYN_TEXT(level) PIPEDYN_QUOTED(level)

namespace pipedyn {

const MotionKernel PIPEDYN_NAMED(PIPEDYN_LEVEL) = {
    .name = PIPEDYN_TEXT(PIPEDYN_LEVEL),
    .width = width,
    .scratch_size = ::scratch_size,
    .jacobian_scratch_size = ::jacobian_scratch_size,
    .rhs = ::rhs,
    .jacobian = ::jacobian,
    .energy = ::energy,
    .power = ::power,
    .finite = ::all_finite,
    .sincos = ::sincos_of,
};

}  // namespace pipedyn
