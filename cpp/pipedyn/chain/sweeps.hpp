// SPDX-License-Identifier: MIT
//
// The chain's motion in O(n) a state, in the frames of the segments: t_j along segment j, n_j
// across it, and the angle phi_j = theta_j - theta_{j-1} from one frame to the next. If the chain
// as a whole turns far but bends little, all sines are then those of small angles, and no small
// number is a difference of large ones.
//
// With w_j = theta_j', the acceleration a_j of node j, and gravity as an acceleration of the clamp,
//   a_j = a_{j-1} + l_j (theta_j'' n_j - w_j^2 t_j),   a_0 = -gamma (sin iota, cos iota).
// The segments beyond node j need the force A_j a_j + b_j at node j, where A_j is symmetric (2, 2),
// A_n = 0, and b_n = a U^2 (cos psi t_n + sin psi n_n) - (1 - c) sqrt(beta) U r_n' is the follower
// force and the force of the entering flow; if the end is guided, the axis replaces segment n in
// the first of the two. The moments about the joint of segment j give
//   theta_j'' = g_j - e_j . a_{j-1},   e_j = c_j / H_j,   c_j = l_j A_j n_j + m_j chi_j l_j n_j,
//   H_j = l_j^2 n_j . A_j n_j + m_j (chi_j^2 l_j^2 + eta_j^2),
//   g_j = (tau_j - l_j n_j . (b_j - l_j w_j^2 A_j t_j)) / H_j,
//   tau_j = K_{j+1} - K_j - sqrt(beta) U l_j^2 w_j - xi_j l_j d_j,
// with the joint's moment K_j = k_j (phi_j - psi_j) + c_j phi_j' and the drag d_j = kappa l_j |v_j|
// v_j. One segment nearer to the clamp,
//   A_{j-1} = A_j + m_j - c_j e_j^T,
//   b_{j-1} = b_j - w_j^2 (l_j A_j + m_j chi_j l_j) t_j + c_j g_j
//             + (2 sqrt(beta) U l_j w_j + d_j) n_j.
// The joint of a guided end has the moment K_{n+1} = -k_{n+1} theta_n - c_{n+1} theta_n'.
// A load f at an arm a of segment j adds a n_j . f to tau_j and -f to b_{j-1}. Mass that has
// inertia only across a segment, as in AddedMass, adds to m_j, chi_j and eta_j except along t_j,
// where only Link::mass adds to A_{j-1}; the weight and the centripetal force that the equations so
// give to this mass are subtracted again as loads. If the flow speed changes, the fluid's
// acceleration is a load -sqrt(beta) U' l_j t_j in the middle of segment j. If the base moves, a_0
// includes its acceleration, and the velocity and position seen by drag and terms include those of
// the base; the other forces of the flow do not depend on them.
//
// 1 / H_j is multiplied last wherever possible, so that a segment waits only for the division of
// its neighbour. These are eqs. (1)-(11) of Orsino and Di Giulio, solved by one sweep to the tip
// for the velocities (only if forces depend on them), one to the clamp and one to the tip. Across
// the segment, differences of nearly equal numbers are avoided by formulas in which they cancel
// exactly: with I_j the inertia about the joint,
//   n . A_{j-1} n = m_j (n . A_j n ((1 - chi_j)^2 l_j^2 + eta_j^2) + m_j eta_j^2) / H_j,
//   t . A_{j-1} n = t . A_j n (I_j - m_j chi_j l_j^2) / H_j,   and n . b_{j-1} likewise,
//   1 - l_j n . e_j = (I_j - m_j chi_j l_j^2) / H_j.
//
// Local to each translation unit, like pack.hpp. A batch is computed in blocks of one pack of
// members. For a single state, sines are computed in packs of segments.
#pragma once

#include "pipedyn/chain/motion.hpp"
#include "pipedyn/chain/stations.hpp"
#include "pipedyn/vector/layout.hpp"

namespace {

using pipedyn::Batch, pipedyn::Link, pipedyn::ChainModel;

/// A block of members of a batch: one for each lane of a Real, or fewer in a batch of fewer
/// members. Loops take it by value: what is behind a reference is read again after each store.
template <class Real>
struct Members {
  const Batch& batch;
  Count first, used, apart = batch.members;

  bool whole() const { return lanes<Real> == 1 || used == lanes<Real>; }
  Real read(const double* from) const { return read_members<Real>(from, used); }
  void write(double* to, const Real& x) const {
    if (whole()) {
      store(to, x);
      return;
    }
    double each[lanes<Real>];
    store(each, x);
    for (Count i = 0; i < used; ++i) to[i] = each[i];
  }
  Real read_row(const double* rows, Count j) const { return read(rows + j * apart + first); }
  Real row(Count j) const { return read_row(batch.y, j); }
  void set_row(double* out, Count j, const Real& x) const { write(out + j * apart + first, x); }
  Real speed() const { return batch.u_step == 0 ? all<Real>(batch.u[0]) : read(batch.u + first); }
};

template <class Real>
Driven<Real> drive_of(Members<Real> members) {
  const Batch& batch = members.batch;
  auto found = Driven<Real>::of(batch, [&](Count k) { return members.read_row(batch.drive, k); });
  if (batch.drive != nullptr && batch.drive_rows > pipedyn::Drive::rows) {
    found.applied = batch.drive + pipedyn::Drive::rows * batch.members + members.first;
    found.apart = batch.members;
    found.used = members.used;
  }
  return found;
}

/// Scratch of the sweeps: arrays of one Real a segment, some of which are used for two quantities
/// one after the other. It consists of two numbers, so that it is passed to functions in registers.
template <class Real>
struct Sweep {
  static constexpr Count turn = 0, rate = 1, sine = 2, cosine = 3, drag = 4, free = 5, along = 6,
                         moment = 7, arrays = 8;
  double* first;
  Count stride;

  Sweep(Count n, Layout& layout) : stride(whole_packs(n * lanes<Real>)) {
    first = layout.take(arrays * stride);
    if (first == nullptr) return;
    for (Count i = n * lanes<Real>; i < stride; ++i) first[i] = 0.0;  // angles that fill up a pack
  }

  double* array(Count which) const { return first + which * stride; }
  Real at(Count which, Count j) const { return load<Real>(array(which) + j * lanes<Real>); }
  void set(Count which, Count j, const Real& x) const { store(array(which) + j * lanes<Real>, x); }
  /// Sine and cosine of the n turns.
  void take_sines(Count n) const {
    sincos(array(turn), n * lanes<Real>, array(sine), array(cosine));
  }
};

/// Calls body(members) for every block of members; the last block overlaps the one before, so that
/// it has as many members.
template <class Body>
void for_each_members(const Batch& batch, const Body& body) {
  const Count members = batch.members;
  for (Count first = 0; first < members; first += width) {
    const Count whole = first + width <= members ? first : members - width;
    body(Members<Pack>{batch, members < width ? 0 : whole, members < width ? members : width});
  }
}

/// Calls body(members, sweep) for a member alone or for every block of members.
template <class Body>
void for_each_block(const ChainModel& model, const Batch& batch, const Body& body) {
  const Count n = model.size;
  if (batch.members == 1) {
    body(Members<double>{batch, 0, 1},
         laid_out([n](Layout& layout) { return Sweep<double>(n, layout); }));
    return;
  }
  const auto sweep = laid_out([n](Layout& layout) { return Sweep<Pack>(n, layout); });
  for_each_members(batch, [&](const Members<Pack>& block) { body(block, sweep); });
}

/// Results of the sweeps in segment j that the derivative needs: A_j (tt, tn, nn), 1 / H_j,
/// b_j . t_j, a_{j-1} (at, an), the velocity vt of the joint along the segment, the velocity v of
/// the drag point across it, and theta_j''.
template <class Real>
struct Kept {
  Real tt, tn, nn, inverse, bt, at, an, vt, v, acceleration;
};

/// Force of the flow on the end along and across the last segment, with the opposite sign, that of
/// a resistance.
template <class Real>
struct Thrust {
  Real along, across;

  Thrust(const ChainModel& model, Members<Real> members) {
    const Real u = members.speed(), square = u * u;
    along = model.thrust[0] * square;
    across = model.thrust[1] * square;
    if (model.guided) turn(model, members);
  }

 private:
  /// Turns the force from the axis to the frame of the last segment. Not inlined: it would take
  /// registers from the sweeps.
  PIPEDYN_NOINLINE void turn(const ChainModel& model, Members<Real> members) {
    double angle[width] = {}, sine[width], cosine[width];
    store(angle, members.row(model.size - 1));
    sincos(angle, lanes<Real>, sine, cosine);
    const Real s = load<Real>(sine), c = load<Real>(cosine), forward = along;
    along = c * forward + s * across;
    across = c * across - s * forward;
  }
};

template <class Real>
void read_state(Members<Real> members, Count n, Sweep<Real> sweep) {
  Real before{};
  for (Count j = 0; j < n; ++j) {
    const Real angle = members.row(j);
    sweep.set(sweep.turn, j, angle - before);
    sweep.set(sweep.rate, j, members.row(n + j));
    before = angle;
  }
  sweep.take_sines(n);
}

/// Calls body(j, vt, vn, w) for each segment j with the velocity of its joint, along and across it,
/// and its rate w. vt, vn: the velocity of the clamp on entry, that of the free end on return.
template <class Real, class Body>
void for_each_velocity(const ChainModel& model, Sweep<Real> sweep, const Body& body, Real& vt,
                       Real& vn) {
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

/// Powers of the terms, of a change of the flow speed (flow) and of the base's motion (base); and
/// the base's velocity in the frame of the last segment.
template <class Real>
struct LoadPower {
  Real terms{}, flow{}, base{}, base_along{}, base_across{};
};

/// Implements `add_loads`. drives: whether the batch has a drive.
template <bool drives, class Real>
PIPEDYN_NOINLINE LoadPower<Real> add_all_loads(const ChainModel& model, Members<Real> members,
                                               Sweep<Real> sweep) {
  LoadPower<Real> power;
  const double* const moments = members.batch.moments;
  const Driven<Real> driven = drive_of(members);
  const Real push = model.coriolis * driven.rate;  // sqrt(beta) U'
  Walk<Real> walk(model, driven);
  for (Count j = 0; j < model.size; ++j) {
    const Link& link = model.links[j];
    const Real drag = sweep.at(sweep.drag, j), rate = sweep.at(sweep.rate, j);
    Real along{}, across = drag, moment = link.drag_arm * drag;
    moment -= link.rest_moment - (j + 1 < model.size ? model.links[j + 1].rest_moment : 0.0);
    if (moments != nullptr) moment -= members.read_row(moments, j);
    walk.turn(sweep.at(sweep.sine, j), sweep.at(sweep.cosine, j));
    const auto visit = [&](const auto& law, const SegmentTerm& place, const Station<Real>& at) {
      const Acting<Real> load(law.load(at));
      const Real normal = place.weight * (at.cosine * load.x - at.sine * load.y);
      along -= place.weight * (at.sine * load.x + at.cosine * load.y);
      across -= normal;
      moment -= place.arm * normal;
      if (turns<std::remove_cvref_t<decltype(law)>>) moment -= place.weight * load.couple;
      power.terms += place.weight * power_of(law, at, load);
      if (drives) power.base += place.weight * base_power(law, at, load, driven.vx, driven.vy);
    };
    Real vx{}, vy{};  // velocity of the joint relative to the base
    if (drives) {
      vx = walk.vx - driven.vx;
      vy = walk.vy - driven.vy;
    }
    walk.pass(j, link.length, members.row(j), rate, visit);
    if (link.added != 0.0) {  // this mass has no weight, and no inertia along the segment
      const double arm = 0.5 * link.length;
      const Real lift =
          (model.gravity * link.added) * (model.down[1] * walk.sine - model.down[0] * walk.cosine);
      along += (arm * link.added) * (rate * rate);
      across -= lift;
      moment -= arm * lift;
    }
    if (drives) {
      const Real s = walk.sine, c = walk.cosine;
      const Real length_push = link.length * push, alone = link.added * (c * vx - s * vy);
      const Real swing = link.first_moment * rate + alone;
      along += length_push;
      power.flow -= length_push * (s * vx + c * vy);
      power.base += drag * (c * driven.vx - s * driven.vy);
      power.base -= link.mass * (driven.ax * vx + driven.ay * vy);
      power.base -= swing * (c * driven.ax - s * driven.ay);
    }
    sweep.set(sweep.drag, j, across);
    sweep.set(sweep.along, j, along);
    sweep.set(sweep.moment, j, moment);
  }
  if (!drives) return power;
  power.base_along = walk.sine * driven.vx + walk.cosine * driven.vy;
  power.base_across = walk.cosine * driven.vx - walk.sine * driven.vy;
  return power;
}

/// Adds to the drag on each segment the terms' loads, the moments of joints that are bent at rest,
/// the batch's moments and the forces of its drive. The sweep's arrays drag, along and moment then
/// hold the force across the segment, the force along it and the moment about its joint, with the
/// signs of a resistance. Returns the powers.
template <class Real>
LoadPower<Real> add_loads(const ChainModel& model, Members<Real> members, Sweep<Real> sweep) {
  return members.batch.drive != nullptr ? add_all_loads<true>(model, members, sweep)
                                        : add_all_loads<false>(model, members, sweep);
}

/// Forces on the segments besides inertia, steady flow and joints. nothing: none; drag: drag, or at
/// the free end the force of the entering flow; loads: these and the loads of add_loads.
enum class Outer { nothing, drag, loads };

/// Powers of the flow, joints, drag, terms and the motion of the base.
template <class Real>
struct PowerParts {
  Real flow, joints, drag, terms, base;

  Real total() const { return flow + joints + drag + terms + base; }
  /// Calls put(k, power) for the five powers in this order.
  template <class Put>
  void each(const Put& put) const {
    const Real parts[] = {flow, joints, drag, terms, base};
    for (Count k = 0; k < 5; ++k) put(k, parts[k]);
  }
};

/// Computes theta'' in the last n rows of rates (2 n, members) unless they are null, and returns
/// the powers. keep: fills kept instead. Not inlined: each instance would have fewer registers next
/// to the others.
template <class Real, Outer outer, bool keep>
PIPEDYN_NOINLINE PowerParts<Real> accelerations(const ChainModel& model, Members<Real> members,
                                                Sweep<Real> sweep, double* rates,
                                                Kept<Real>* kept) {
  const Count n = model.size;
  read_state(members, n, sweep);

  Real drag{}, joints{}, end_along{}, end_across{};
  // The acceleration of the clamp, which represents gravity.
  Real at = all<Real>(-model.gravity * model.down[1]);
  Real an = all<Real>(-model.gravity * model.down[0]);
  if constexpr (outer == Outer::loads) {
    const Driven<Real> driven = drive_of(members);
    end_along = driven.vy;
    end_across = driven.vx;
    at += driven.ay;
    an += driven.ax;
  }
  if constexpr (outer != Outer::nothing) {
    for_each_velocity(
        model, sweep,
        [&](Count j, const Real& along, const Real& across, const Real& w) {
          const Link& link = model.links[j];
          const Real v = across + link.drag_arm * w;
          const Real force = link.drag * (absolute(v) * v);
          sweep.set(sweep.drag, j, force);
          drag -= force * v;
          if constexpr (keep) {
            kept[j].vt = along;
            kept[j].v = v;
          }
        },
        end_along, end_across);
  }
  LoadPower<Real> parts;
  if constexpr (outer == Outer::loads) parts = add_loads(model, members, sweep);

  const Real u = members.speed(), coriolis = model.coriolis * u;
  const Real entry = model.entry * u;
  const Thrust<Real> thrust(model, members);
  const Real end_rate = sweep.at(sweep.rate, n - 1);
  const Real end_resistance = model.end_damping * end_rate;
  joints -= end_resistance * end_rate;
  Real moment_beyond = -(model.end_spring * members.row(n - 1) + end_resistance);
  Real tt{}, tn{}, nn{}, bt = thrust.along, bn = thrust.across;
  if constexpr (outer != Outer::nothing) {
    bt -= entry * end_along;
    bn -= entry * end_across;
  }
  for (Count j = n - 1; j >= 0; --j) {
    const Link& link = model.links[j];
    const double l = link.length;
    const Real inverse = 1.0 / (link.length_square * nn + link.inertia);
    const Real w = sweep.at(sweep.rate, j);
    const Real turning = j > 0 ? w - sweep.at(sweep.rate, j - 1) : w;
    const Real resistance = link.damping * turning;
    joints -= resistance * turning;
    const Real moment = link.spring * sweep.at(sweep.turn, j) + resistance;
    Real tau = moment_beyond - moment;
    moment_beyond = moment;
    const Real momentum = coriolis * (l * w);
    tau -= l * momentum;
    Real across = 2.0 * momentum;  // force that acts across the segment at its clamped side
    if constexpr (outer != Outer::nothing) {
      const Real force = sweep.at(sweep.drag, j);
      if constexpr (outer == Outer::loads) {
        tau -= sweep.at(sweep.moment, j);
      } else {
        tau -= link.drag_arm * force;
      }
      across += force;
    }
    const Real square = w * w;
    const Real centripetal = l * square;
    const Real ct = l * tn;
    const Real cn = l * nn + link.first_moment;
    const Real exchange = link.exchange * inverse;
    const Real b = bn - centripetal * tn;
    const Real g = tau * inverse - (l * inverse) * b;
    if constexpr (keep) {
      Kept<Real>& here = kept[j];
      here.tt = tt;
      here.tn = tn;
      here.nn = nn;
      here.inverse = inverse;
      here.bt = bt;
    }
    sweep.set(sweep.turn, j, ct * inverse);
    sweep.set(sweep.drag, j, cn * inverse);
    sweep.set(sweep.free, j, g);
    sweep.set(sweep.moment, j, exchange);

    Real force_along = bt - centripetal * tt - link.first_moment * square;
    if constexpr (outer == Outer::loads) force_along += sweep.at(sweep.along, j);
    force_along += ct * g;
    const Real force_across = (cn * (tau * inverse) + across) + exchange * b;
    const Real s = sweep.at(sweep.sine, j), c = sweep.at(sweep.cosine, j);
    const Real ss = s * s, cc = c * c, sc = s * c;
    // In the frame of segment j, A_{j-1} = mass t t^T + inverse (across_across n n^T
    // + along_across (t n^T + n t^T) - along_along t t^T); it is turned to the frame before.
    const Real mass = tt + link.mass;
    const Real along_along = ct * ct;
    const Real along_across = link.exchange * tn;
    const Real across_across = link.end_inertia * nn + link.own_inertia;
    const Real twice = 2.0 * sc * along_across;
    tt = cc * mass + inverse * (ss * across_across - cc * along_along - twice);
    nn = ss * mass + inverse * (cc * across_across - ss * along_along + twice);
    tn = sc * mass + inverse * ((cc - ss) * along_across - sc * (along_along + across_across));
    bt = c * force_along - s * force_across;
    bn = s * force_along + c * force_across;
  }

  for (Count j = 0; j < n; ++j) {
    const double l = model.links[j].length;
    const Real s = sweep.at(sweep.sine, j), c = sweep.at(sweep.cosine, j);
    const Real w = sweep.at(sweep.rate, j);
    const Real along = c * at + s * an;
    const Real across = c * an - s * at;
    const Real et = sweep.at(sweep.turn, j), g = sweep.at(sweep.free, j);
    const Real acceleration = g - et * along - sweep.at(sweep.drag, j) * across;
    if constexpr (keep) {
      Kept<Real>& here = kept[j];
      here.at = along;
      here.an = across;
      here.acceleration = acceleration;
    } else if (rates != nullptr) {
      members.set_row(rates, j, w);
      members.set_row(rates, n + j, acceleration);
    }
    if constexpr (outer == Outer::nothing) {
      const Real before = end_along;
      end_along = c * before + s * end_across;
      end_across = c * end_across + (l * w - s * before);
    }
    // The next `an` is across + l acceleration, without a difference of nearly equal numbers.
    const Real exchange = sweep.at(sweep.moment, j), lever = l * et;
    const Real beside = exchange * s + lever * c;
    an = (exchange * c - lever * s) * an + (l * g - beside * at);
    at = along - l * (w * w);
  }
  // Velocity of the end relative to the base.
  const Real along = end_along - parts.base_along, across = end_across - parts.base_across;
  const Real own = (model.entry - model.coriolis) * u;
  const Real flow = (own * along + entry * parts.base_along - thrust.along) * along +
                    (own * across + entry * parts.base_across - thrust.across) * across;
  return {flow + parts.flow, joints, drag, parts.terms, parts.base};
}

Outer outer_of(const ChainModel& model, const Batch& batch) {
  if (model.load_count > 0 || model.bent || batch.moments != nullptr || batch.drive != nullptr) {
    return Outer::loads;
  }
  return model.drag || model.entry != 0.0 ? Outer::drag : Outer::nothing;
}

template <bool keep, class Real>
PowerParts<Real> accelerations_of(const ChainModel& model, Members<Real> members, Sweep<Real> sweep,
                                  double* rates, Kept<Real>* kept = nullptr) {
  switch (outer_of(model, members.batch)) {
    case Outer::loads:
      return accelerations<Real, Outer::loads, keep>(model, members, sweep, rates, kept);
    case Outer::drag:
      return accelerations<Real, Outer::drag, keep>(model, members, sweep, rates, kept);
    default:
      return accelerations<Real, Outer::nothing, keep>(model, members, sweep, rates, kept);
  }
}

/// The powers alone, which without other forces follow from the velocities.
template <class Real>
PowerParts<Real> powers_of(const ChainModel& model, const Members<Real>& members,
                           Sweep<Real> sweep) {
  if (outer_of(model, members.batch) != Outer::nothing) {
    return accelerations_of<false>(model, members, sweep, nullptr);
  }
  read_state(members, model.size, sweep);
  Real joints{}, along{}, across{}, before{};
  for_each_velocity(
      model, sweep,
      [&](Count j, const Real&, const Real&, const Real& w) {
        const Real turning = w - before;
        joints -= model.links[j].damping * (turning * turning);
        before = w;
      },
      along, across);
  joints -= model.end_damping * (before * before);
  const Real coriolis = model.coriolis * members.speed();
  const Thrust<Real> thrust(model, members);
  const Real flow =
      -(coriolis * along + thrust.along) * along - (coriolis * across + thrust.across) * across;
  return {flow, joints, Real{}, Real{}, Real{}};
}

}  // namespace
