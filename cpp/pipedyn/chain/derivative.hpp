// SPDX-License-Identifier: MIT
//
// Derivative of the chain's motion about a state: the sweeps (sweeps.hpp) are differentiated with
// respect to the angles, the rates and the angular accelerations of the segments, which all change.
// One unknown x_j a segment is found from the moments on it, the other changes being known:
//   the Jacobian: the angular acceleration, for the change of one angle or of one rate,
//   implicit steps (shifted.hpp): the rate, from which angle and acceleration follow.
// With D for a change, let m_j = (D a_j, D v_j, D r_j) be the changes of acceleration, velocity and
// position of node j; the last two are left out unless drag, loads or the entering flow depend on
// them. If k is one of the angle, the rate and the acceleration of segment j, its change by 1 gives
//   m_j = m_{j-1} + S_kj:   S = (jump, V, P), with in the three cases
//   jump = -l_j (theta_j'' t_j + w_j^2 n_j), -2 l_j w_j t_j and l_j n_j,
//   V = -l_j w_j t_j, l_j n_j and 0,   P = l_j n_j, 0 and 0.
// The segments beyond node j need a force at node j, and joint j + 1 exerts a moment,
//   f_j = Z_j m_j + z_j x_j + f0_j,   k_j = K_j m_j + s_j x_j + k0_j.
// Z_n comes from the entering flow alone; the follower force and the joint of a guided end act on
// segment n by its own angle and rate. Besides by f and k, the change by 1 loads the segment with
//   F_kj = Z_j S_kj + m_j chi_j jump + (force on the segment),
//   M_kj = (moment on the segment) + K_j S_kj - l_j n_j . Z_j S_kj.
// If all three change in fixed ratios to x_j, S, F and M of x_j are sums of the three, and the
// moments on segment j about its joint give
//   x_j = X_j m_{j-1} + (c_j / D_j) x_{j-1} + x0_j,   D_j = c_j + R_j,
// where c_j is the moment of the segment's joint for x_j = 1, and R_j contains everything else. One
// segment nearer to the clamp,
//   k_{j-1} = c_j X_j m_{j-1} - (c_j R_j / D_j) x_{j-1} + ...,
// without a difference of nearly equal numbers however stiff joints are. For the Jacobian c = K =
// 0, D = H, the part of Z for accelerations is A, and these come from the sweeps, which compute
// them without cancellation; the springs are then part of the known moments. One sweep to the clamp
// computes S, F, M, X and D, which are the same for all right-hand sides; for each of these one
// sweep to the clamp and one back compute x. The columns of the Jacobian take O(n^2), either as
// vectors along the columns of one state, or with one state in each lane.
//
// Local to each translation unit, like pack.hpp.
#pragma once

#include "pipedyn/chain/sweeps.hpp"
#include "pipedyn/vector/complex.hpp"

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

/// Changes per change of a segment's angle, rate or angular acceleration; components along (t) and
/// across (n) the segment.
template <class Real>
struct Source {
  Real jump_t{}, jump_n{};    // difference in acceleration between the segment's ends
  Real force_t{}, force_n{};  // force on the segment
  Real moment{};              // moment on the segment, without the joint at its clamped side
  Real v_t{}, v_n{};          // velocity of all segments beyond
};

template <class Real>
Source<Real> angle_source(const ChainModel& model, const Kept<Real>& here, Count m, const Real& w,
                          const Real& u) {
  const Link& link = model.links[m];
  const double l = link.length;
  const Real square = w * w;
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
          .v_t = -l * w};
}

template <class Real>
Source<Real> rate_source(const ChainModel& model, const Kept<Real>& here, Count m, const Real& w,
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
void add_loads_to(Source<Real>& source, const ChainModel& model, const Link& link,
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
    const Plane<Real> weight{all<Real>(model.gravity * model.down[0]),
                             all<Real>(model.gravity * model.down[1])};
    const Real at = here.at + dot(weight, frame.t), an = here.an + dot(weight, frame.n);
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

/// A state, or a block of states, about which the motion is linearised, and the quantities from
/// which its derivatives are computed.
template <class Real>
struct Linearised {
  const ChainModel& model;
  Members<Real> members;
  Real u, push;  // u and sqrt(beta) U'
  Sweep<Real> sweep;
  double *sine, *cosine;  // of each segment's angle
  Kept<Real>* kept;
  LoadMoments<Real>* loads;  // filled if the model has loads

  Linearised(const ChainModel& of, const Members<Real>& about, Layout& layout)
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
    const Driven<Real> driven = drive_of(members);
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
  /// Source for the angle of segment k, or for its rate.
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
    if (k + 1 < model.size) return found;
    found.moment -= angle ? model.end_spring : model.end_damping;
    if (angle && !model.guided) {  // the follower force
      const Real along = u * u * model.thrust[0];
      found.force_t -= u * u * model.thrust[1];
      found.force_n += along;
      found.moment -= model.links[k].length * along;
    }
    return found;
  }
};

/// The changes of a segment: of its angle, its rate and its angular acceleration.
constexpr Count own_angle = 0, own_rate = 1, own_acceleration = 2;

/// Numbers of segment j from which its unknown follows. size: entries of m, 2, or 4 with
/// velocities, or 6 with positions as well. Number: that of the coefficients; they are complex for
/// implicit steps, and of the type Real of the state for the Jacobian.
template <class Real, class Number, Count size>
struct Eliminated {
  static constexpr bool is_jacobian = std::is_same_v<Real, Number>;
  static constexpr Count entries = size, moved = is_jacobian ? 2 : size;  // of m; that x changes

  Plane<Real> arm;                // l n
  Number inverse, joint, follow;  // 1 / D, c, c / D
  Number push[2], by[size];       // derivative of the force at its joint by x; X
  Number step[size];              // S of the unknown
  Real change[3][size];           // S, F and M of its own changes
  Number force[3][2], moment[3];
  double resistance[2];  // stiffness and damping of its joint
};

template <class Row, class Column, Count size>
inline auto product(const Row (&row)[size], const Column (&column)[size]) {
  auto sum = row[0] * column[0];
  for (Count i = 1; i < size; ++i) sum = sum + row[i] * column[i];
  return sum;
}

/// Fills the numbers of all segments. ratios: changes of angle, rate and acceleration for x = 1.
template <class Real, class Number, Count size>
void eliminate(const Linearised<Real>& about, const Number (&ratios)[3],
               Eliminated<Real, Number, size>* out) {
  constexpr bool is_jacobian = Eliminated<Real, Number, size>::is_jacobian;
  const ChainModel& model = about.model;
  const Number zero{};
  // Z, K, z and s of node j.
  Number force[2][size] = {}, moment[size] = {}, turned[2] = {}, turned_moment{};
  if constexpr (size > 2) force[0][2] = force[1][3] = zero + (-model.entry * about.u);
  for (Count j = model.size - 1; j >= 0; --j) {
    const Link& link = model.links[j];
    const double l = link.length, lever = link.first_moment / l;  // lever: m chi
    const Frame<Real> frame = about.frame(j);
    const Plane<Real> n = frame.n, arm = scaled(l, n);
    const Source<Real> sources[] = {
        about.source(j, true),
        about.source(j, false),
        {.jump_n = all<Real>(l), .moment = all<Real>(-link.inertia)},
    };
    Eliminated<Real, Number, size>& here = out[j];
    here.arm = arm;
    here.resistance[own_angle] = link.spring;
    here.resistance[own_rate] = link.damping;
    const Kept<Real>& kept = about.kept[j];
    if constexpr (is_jacobian) {  // A
      const Plane<Real> x = frame.plane(kept.tt * frame.t.x + kept.tn * n.x,
                                        kept.tn * frame.t.x + kept.nn * n.x),
                        y = frame.plane(kept.tt * frame.t.y + kept.tn * n.y,
                                        kept.tn * frame.t.y + kept.nn * n.y);
      force[0][0] = x.x;
      force[0][1] = force[1][0] = x.y;
      force[1][1] = y.y;
    }
    for (Count k = own_angle; k <= own_acceleration; ++k) {
      const Source<Real>& source = sources[k];
      const Plane<Real> jump = frame.plane(source.jump_t, source.jump_n),
                        v = frame.plane(source.v_t, source.v_n),
                        own = frame.plane(source.force_t, source.force_n);
      Real(&change)[size] = here.change[k];
      change[0] = jump.x;
      change[1] = jump.y;
      if constexpr (size > 2) {
        change[2] = v.x;
        change[3] = v.y;
      }
      if constexpr (size == 6) {
        change[4] = k == own_angle ? arm.x : Real{};
        change[5] = k == own_angle ? arm.y : Real{};
      }
      const Number fx = product(change, force[0]), fy = product(change, force[1]);
      here.force[k][0] = fx + (lever * jump.x + own.x);
      here.force[k][1] = fy + (lever * jump.y + own.y);
      here.moment[k] = product(change, moment) - (arm.x * fx + arm.y * fy) + source.moment;
    }
    if constexpr (is_jacobian) {
      const Plane<Real> c = frame.plane(l * kept.tn, l * kept.nn + link.first_moment);
      here.force[own_acceleration][0] = c.x;
      here.force[own_acceleration][1] = c.y;
    }
    for (Count i = 0; i < size; ++i) here.step[i] = zero;
    Number rest = arm.x * turned[0] + arm.y * turned[1] - turned_moment;
    for (Count k = own_angle; k <= own_acceleration; ++k) {
      for (Count i = 0; i < size; ++i) {
        here.step[i] = here.step[i] + here.change[k][i] * ratios[k];
      }
      for (Count i = 0; i < 2; ++i) turned[i] = turned[i] + ratios[k] * here.force[k][i];
      rest = rest - ratios[k] * here.moment[k];
    }
    here.push[0] = turned[0];
    here.push[1] = turned[1];
    if constexpr (is_jacobian) {
      here.joint = zero;
      here.inverse = kept.inverse;
    } else {
      here.joint = link.spring * ratios[own_angle] + link.damping * ratios[own_rate];
      here.inverse = inverse(here.joint + rest);
    }
    here.follow = here.joint * here.inverse;

    // Mass that has inertia only across the segment.
    const Plane<Real> added = scaled(link.added, n);
    Real force_own[2][size] = {{link.mass + added.x * n.x, added.x * n.y},
                               {added.y * n.x, link.mass + added.y * n.y}};
    Real moment_own[size] = {lever * arm.x, lever * arm.y};
    if constexpr (size > 2) {
      const Real drag = about.drag_slope(j), across[2] = {n.x, n.y};
      for (int i = 0; i < 2; ++i) {
        for (int k = 0; k < 2; ++k) force_own[i][2 + k] = drag * across[i] * across[k];
        moment_own[2 + i] = link.drag_arm * drag * across[i];
      }
    }
    if constexpr (size == 6) {
      const Slopes<Real>& slopes = about.loads[j].slopes[0];
      const Plane<Real> moved = about.moment_by(by_velocity, j),
                        placed = about.moment_by(by_position, j);
      for (int i = 0; i < 2; ++i) {
        for (int k = 0; k < 2; ++k) {
          force_own[i][2 + k] -= slopes.by[i][by_velocity + k];
          force_own[i][4 + k] = -slopes.by[i][by_position + k];
        }
      }
      moment_own[2] -= moved.x;
      moment_own[3] -= moved.y;
      moment_own[4] = -placed.x;
      moment_own[5] = -placed.y;
    }
    for (Count i = 0; i < size; ++i) {
      Number row = arm.x * force[0][i] + arm.y * force[1][i] - moment[i] + moment_own[i];
      if (is_jacobian && i < 2) row = here.force[own_acceleration][i];
      const Number by = zero - row * here.inverse;
      here.by[i] = by;
      force[0][i] = force[0][i] + here.push[0] * by + force_own[0][i];
      force[1][i] = force[1][i] + here.push[1] * by + force_own[1][i];
      moment[i] = here.joint * by;
    }
    turned[0] = here.push[0] * here.follow;
    turned[1] = here.push[1] * here.follow;
    turned_moment = zero - rest * here.follow;
  }
}

/// Computes the unknowns x of all n segments for one right-hand side, whose numbers have the type
/// Right::Number, and calls write(j, x) for each. A right-hand side has
///   known, kinds   the kinds of the changes that are known,
///   change(i, j)   the change of kind kinds[i] of segment j; it is 0 for j = -1,
///   last, any(j)   the last segment with a known change or a bent joint; whether j has one.
/// alone: scratch for n numbers.
template <class Segment, class Right, class Write>
void solve_segments(const Segment* segments, Count n, const Right& right,
                    typename Right::Number* alone, const Write& write) {
  using Number = typename Right::Number;
  const Count last = right.last();
  Number fx{}, fy{}, moment{};
  for (Count j = last; j >= 0; --j) {
    const Segment& here = segments[j];
    Number sum = moment - (here.arm.x * fx + here.arm.y * fy);
    moment = Number{};
    for (Count i = 0; i < Right::known && right.any(j); ++i) {
      const Count k = Right::kinds[i];
      const Number change = right.change(i, j);
      sum = sum + here.moment[k] * change;
      fx = fx + here.force[k][0] * change;
      fy = fy + here.force[k][1] * change;
      if (k == own_acceleration) continue;
      const Number bend = here.resistance[k] * (change - right.change(i, j - 1));
      sum = sum - bend;
      moment = moment + bend;
    }
    const Number found = here.inverse * sum;
    alone[j] = found;
    fx = fx + here.push[0] * found;
    fy = fy + here.push[1] * found;
    if (!Segment::is_jacobian) moment = moment + here.joint * found;
  }
  Number m[Segment::entries] = {}, found{};
  for (Count j = 0; j < n; ++j) {
    const Segment& here = segments[j];
    Number sum = j <= last ? alone[j] : Number{};
    if (!Segment::is_jacobian) sum = sum + here.follow * found;
    // Accelerations come last: where drag alone acts they are the only entries that still change.
    for (Count i = Segment::entries - 1; i >= 0; --i) sum = sum + here.by[i] * m[i];
    found = sum;
    for (Count i = 0; i < Segment::moved; ++i) m[i] = m[i] + here.step[i] * found;
    for (Count k = 0; k < Right::known && right.any(j); ++k) {
      const Number change = right.change(k, j);
      for (Count i = 0; i < Segment::entries; ++i) {
        m[i] = m[i] + here.change[Right::kinds[k]][i] * change;
      }
    }
    write(j, found);
  }
}

/// Calls body.operator()<size>() with the size of m that the model needs.
template <class Body>
auto with_carried(const ChainModel& model, const Body& body) {
  if (model.load_count > 0) return body.template operator()<6>();
  return model.resists() ? body.template operator()<4>() : body.template operator()<2>();
}

/// Right-hand sides of the Jacobian: changes by 1 of the angle of segment `first`, in the real
/// parts, and of its rate, in the imaginary parts. The lanes of a pack hold these segments: `first`
/// and those after it if `apart` is 1; `first` alone if it is 0.
struct Columns {
  using Number = ComplexLanes<Pack>;
  static constexpr Count known = 2, kinds[] = {own_angle, own_rate};
  Count first, apart, segments;

  Count end() const { return first + apart * (width - 1); }  // the last segment that changes
  Count last() const { return end() + 1 < segments ? end() + 1 : segments - 1; }
  bool any(Count j) const { return j >= first && j <= end() + 1; }
  Number change(Count i, Count j) const {
    double each[width];
    for (Count lane = 0; lane < width; ++lane) each[lane] = j == first + lane * apart ? 1.0 : 0.0;
    const Pack found = load<Pack>(each);
    return i == 0 ? Number{found, {}} : Number{{}, found};
  }
};

/// Writes the Jacobian (2 n, 2 n) of a state, or of each state of a block: n rows of derivatives of
/// theta', which are 0 and 1, then n rows of derivatives of theta''.
template <class Real, Count size>
void jacobian_of(const ChainModel& model, const Members<Real>& members, double* out) {
  using Segment = Eliminated<Real, Real, size>;
  const Count n = model.size, rows = 2 * n;
  struct Scratch {
    Linearised<Real> about;
    Segment* segments;
    Columns::Number* alone;
  };
  auto [about, segments, alone] = laid_out([&](Layout& layout) {
    return Scratch{Linearised<Real>(model, members, layout), layout.take<Segment>(n),
                   layout.take<Columns::Number>(n)};
  });
  double* const to = out + members.first * rows * rows;
  for (Count k = 0; k < members.used; ++k) {
    double* const own = to + k * rows * rows;
    for (Count i = 0; i < n * rows; ++i) own[i] = 0.0;
    for (Count j = 0; j < n; ++j) own[j * rows + n + j] = 1.0;
  }
  about.linearise();
  eliminate<Real, Real, size>(about, {Real{}, Real{}, all<Real>(1.0)}, segments);
  // The lanes of a pack hold columns of one state, or one column of several states.
  constexpr bool one = lanes<Real> == 1;
  constexpr Count together = one ? width : 1;
  const Count apart = one ? 1 : rows * rows;
  for (Count first = 0; first < n; first += together) {
    double* const corner = to + n * rows + first;
    const Count used = !one ? members.used : first + width <= n ? width : n - first;
    const auto put = [=](double* row, const Pack& found) {
      if (one && used == width) return store(row, found);
      double each[width];
      store(each, found);
      for (Count lane = 0; lane < used; ++lane) row[lane * apart] = each[lane];
    };
    solve_segments(segments, n, Columns{first, one ? 1 : 0, n}, alone,
                   [=](Count j, const Columns::Number& found) {
                     put(corner + j * rows, found.re);
                     put(corner + j * rows + n, found.im);
                   });
  }
}

/// Largest number of segments for which a batch is differentiated with one state in each lane of a
/// pack. Measured with 2, 4 and 8 lanes: this is three times as fast for few segments, and no
/// faster from 50 on, where the columns of one state fill packs as well and take less memory.
constexpr Count side_by_side = 40;

void jacobian(const ChainModel& model, const Batch& batch, double* out) {
  with_carried(model, [&]<Count size>() {
    if (model.size > side_by_side || batch.members == 1) {
      for (Count k = 0; k < batch.members; ++k) {
        jacobian_of<double, size>(model, {batch, k, 1}, out);
      }
      return;
    }
    for_each_members(
        batch, [&](const Members<Pack>& block) { jacobian_of<Pack, size>(model, block, out); });
  });
}

}  // namespace
