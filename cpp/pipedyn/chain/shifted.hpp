// SPDX-License-Identifier: MIT
//
// Solution of (mu - J) x = b for a chain in O(n), with J = d(dy/dtau)/dy about any state and mu
// complex, the linear system of implicit integrators. Four mu are solved for at once, one in each
// lane of a vector.
//
// With b = [b1, b2] and x = [x1, x2] the angle of segment j changes by (x2_j + b1_j) / mu, its rate
// by x2_j and its angular acceleration by mu x2_j - b2_j. Let m_j be the changes of acceleration,
// velocity and position of node j; the last two are left out unless drag, loads or the entering
// flow depend on them. Across segment j
//   m_j = m_{j-1} + g_j x2_j + e_j,
// where e_j depends on b alone. The segments beyond node j need a force at node j, and joint j + 1
// exerts a moment,
//   f_j = Z_j m_j + z_j x2_j + f0_j,   k_j = K_j m_j + s_j x2_j + k0_j.
// f_n comes from the follower force and the entering flow alone, k_n from the joint of a guided end
// alone. The moments on segment j about its joint then give
//   x2_j = X_j m_{j-1} + (c_j / D_j) x2_{j-1} + x0_j,   c_j = spring_j / mu + damping_j,
//   D_j = c_j + R_j,
// where R_j contains everything but the segment's own joint. One segment nearer to the clamp,
//   k_{j-1} = c_j X_j m_{j-1} - (c_j R_j / D_j) x2_{j-1} + ...,
// without a difference of nearly equal numbers however stiff joints are. One sweep to the clamp
// computes the coefficients of f and k, and one sweep back computes x. The forces that a segment
// adds by its own angle and rate are the sources of these columns in derivative.hpp.
//
// Local to each translation unit, like pack.hpp.
#pragma once

#include "pipedyn/chain/derivative.hpp"
#include "pipedyn/vector/shifts.hpp"

namespace {

/// Numbers of segment j that the solves read. size: entries of m, 2, or 6 with velocities and
/// positions.
template <Count size>
struct ShiftedSegment {
  double l, lever, spring, inertia;             // lever: m chi
  Plane<double> normal, jump, velocity, force;  // the last three: derivatives by its angle
  double moment;                                // derivative by its angle
  Complex step[size];                           // g
  Complex force_by[2][size], moment_by[size];   // Z and K of node j
  Complex push[2];                              // derivative of the force at its joint by x2_j
  Complex by[size], inverse, joint, follow;     // X, 1 / D, c, c / D

  /// Computes e_j, which b alone adds to m across the segment. angle: b1 / mu, the change of its
  /// angle for x2 = 0; rate: b2; the acceleration is -b2 for x2 = 0.
  void passed(const Complex& angle, const Complex& rate, Complex (&e)[size]) const {
    e[0] = (-l * normal.x) * rate + jump.x * angle;
    e[1] = (-l * normal.y) * rate + jump.y * angle;
    if constexpr (size == 6) {
      e[2] = velocity.x * angle;
      e[3] = velocity.y * angle;
      e[4] = (l * normal.x) * angle;
      e[5] = (l * normal.y) * angle;
    }
  }
};

template <Count size>
inline Complex product(const Complex (&row)[size], const Complex (&column)[size]) {
  Complex sum = row[0] * column[0];
  for (Count i = 1; i < size; ++i) sum = sum + row[i] * column[i];
  return sum;
}

/// Pointers into the array of factors for the shifts of one pass: to mu and 1 / mu, and to the
/// segments.
template <Count size>
struct ShiftedFactors {
  using Segment = ShiftedSegment<size>;

  Complex *mu, *inverse;
  Segment* segments;

  ShiftedFactors(double* array, Count n, Count pass) {
    constexpr std::uintptr_t boundary = alignof(Segment);
    const std::uintptr_t start =
        (reinterpret_cast<std::uintptr_t>(array) + boundary - 1) / boundary;
    Complex* const shifts = reinterpret_cast<Complex*>(start * boundary);
    mu = shifts + 2 * pass;
    inverse = mu + 1;
    segments = reinterpret_cast<Segment*>(shifts + 2 * shift_passes) + pass * n;
  }
  static Count numbers(Count n) {
    const Count bytes = 2 * shift_passes * static_cast<Count>(sizeof(Complex)) +
                        shift_passes * n * static_cast<Count>(sizeof(Segment)) +
                        static_cast<Count>(alignof(Segment));
    return bytes / static_cast<Count>(sizeof(double));
  }
};

/// Derivative of the follower force by the angle of the last segment, with the normal n.
inline Plane<double> turned_thrust(const MotionModel& model, double u, const Plane<double>& n) {
  if (model.guided) return {0.0, 0.0};
  const Plane<double> along{n.y, -n.x};
  return plus(scaled(model.thrust[0] * u * u, n), scaled(model.thrust[1] * u * u, along));
}

template <Count size>
void factorise_shifted(const Linearised<double>& about, const ShiftedFactors<size>& out) {
  const MotionModel& model = about.model;
  const Count n = model.size;
  const Complex mu = *out.mu, inverse_mu = inverse(mu), zero = 0.0 * mu;
  *out.inverse = inverse_mu;
  const Plane<double> end = turned_thrust(model, about.u, about.frame(n - 1).n);
  // Z, K, z and s of node j.
  Complex force[2][size], moment[size], at_rate[2], moment_at_rate = zero;
  for (Count i = 0; i < size; ++i) force[0][i] = force[1][i] = moment[i] = zero;
  if constexpr (size == 6) {
    force[0][2] = force[1][3] = zero + (-model.entry * about.u);
  }
  at_rate[0] = end.x * inverse_mu;
  at_rate[1] = end.y * inverse_mu;
  moment_at_rate = zero - (model.end_spring * inverse_mu + model.end_damping);
  for (Count j = n - 1; j >= 0; --j) {
    const pipedyn::Link& link = model.links[j];
    const Frame<double> frame = about.frame(j);
    const Source<double> angle = about.source(j, true), rate = about.source(j, false);
    ShiftedSegment<size>& here = out.segments[j];
    here.l = link.length;
    here.lever = link.first_moment / link.length;
    here.spring = link.spring;
    here.inertia = link.inertia;
    here.normal = frame.n;
    here.jump = frame.plane(angle.jump_t, angle.jump_n);
    here.velocity = frame.plane(angle.v_t, angle.v_n);
    here.force = frame.plane(angle.force_t, angle.force_n);
    here.moment = angle.moment;
    const Plane<double> arm = scaled(link.length, frame.n);
    const Plane<double> jump = frame.plane(rate.jump_t, rate.jump_n),
                        push = frame.plane(rate.force_t, rate.force_n);
    Complex(&g)[size] = here.step;
    g[0] = arm.x * mu + here.jump.x * inverse_mu + jump.x;
    g[1] = arm.y * mu + here.jump.y * inverse_mu + jump.y;
    if constexpr (size == 6) {
      const Plane<double> velocity = frame.plane(rate.v_t, rate.v_n);
      g[2] = here.velocity.x * inverse_mu + velocity.x;
      g[3] = here.velocity.y * inverse_mu + velocity.y;
      g[4] = arm.x * inverse_mu;
      g[5] = arm.y * inverse_mu;
    }
    const Complex fx = product(force[0], g) + at_rate[0], fy = product(force[1], g) + at_rate[1];
    here.push[0] = fx + here.lever * g[0] + here.force.x * inverse_mu + push.x;
    here.push[1] = fy + here.lever * g[1] + here.force.y * inverse_mu + push.y;
    const Complex rest = arm.x * fx + arm.y * fy + link.inertia * mu - here.moment * inverse_mu +
                         (-rate.moment) - (product(moment, g) + moment_at_rate);
    here.joint = link.spring * inverse_mu + link.damping;
    here.inverse = ::inverse(here.joint + rest);
    here.follow = here.joint * here.inverse;

    // Mass that has inertia only across the segment.
    const Plane<double> added = scaled(link.added, frame.n);
    double force_own[2][size] = {{link.mass + added.x * frame.n.x, added.x * frame.n.y},
                                 {added.y * frame.n.x, link.mass + added.y * frame.n.y}};
    double moment_own[size] = {here.lever * arm.x, here.lever * arm.y};
    if constexpr (size == 6) {
      const double drag = about.drag_slope(j), n[2] = {frame.n.x, frame.n.y};
      const bool loaded = about.loaded();
      const LoadMoments<double> none{}, &loads = loaded ? about.loads[j] : none;
      const auto moment_by = [&](Variable variable) {
        return loaded ? about.moment_by(variable, j) : Plane<double>{0.0, 0.0};
      };
      const Plane<double> moved = moment_by(by_velocity), placed = moment_by(by_position);
      for (int i = 0; i < 2; ++i) {
        for (int k = 0; k < 2; ++k) {
          force_own[i][2 + k] = drag * n[i] * n[k] - loads.slopes[0].by[i][by_velocity + k];
          force_own[i][4 + k] = -loads.slopes[0].by[i][by_position + k];
        }
        moment_own[2 + i] += link.drag_arm * drag * n[i];
      }
      moment_own[2] -= moved.x;
      moment_own[3] -= moved.y;
      moment_own[4] -= placed.x;
      moment_own[5] -= placed.y;
    }
    for (Count i = 0; i < size; ++i) {
      here.force_by[0][i] = force[0][i];
      here.force_by[1][i] = force[1][i];
      here.moment_by[i] = moment[i];
      const Complex row = arm.x * force[0][i] + arm.y * force[1][i] - moment[i] + moment_own[i];
      const Complex by = zero - row * here.inverse;
      here.by[i] = by;
      force[0][i] = force[0][i] + here.push[0] * by + force_own[0][i];
      force[1][i] = force[1][i] + here.push[1] * by + force_own[1][i];
      moment[i] = here.joint * by;
    }
    at_rate[0] = here.push[0] * here.follow;
    at_rate[1] = here.push[1] * here.follow;
    moment_at_rate = zero - rest * here.follow;
  }
}

/// Replaces b in x by the solution. alone: scratch for n numbers of each shift.
template <Count size>
void solve_shifted(const MotionModel& model, double u, const ShiftedFactors<size>& factors,
                   Count pass, double* alone, double* x) {
  const Count n = model.size;
  const Complex inverse_mu = *factors.inverse, zero = 0.0 * inverse_mu;
  Complex e[size], angle = inverse_mu * read_shifted(x, n - 1, pass);
  const Plane<double> end = turned_thrust(model, u, factors.segments[n - 1].normal);
  Complex fx = end.x * angle, fy = end.y * angle, moment = (-model.end_spring) * angle;
  for (Count j = n - 1; j >= 0; --j) {
    const ShiftedSegment<size>& here = factors.segments[j];
    const Complex rate = read_shifted(x, n + j, pass);
    const Complex before = j > 0 ? inverse_mu * read_shifted(x, j - 1, pass) : zero;
    here.passed(angle, rate, e);
    const Complex gx = product(here.force_by[0], e) + fx, gy = product(here.force_by[1], e) + fy;
    const Complex bend = here.spring * (angle - before);
    const Complex sum = product(here.moment_by, e) + moment - bend + here.inertia * rate +
                        here.moment * angle - here.l * (here.normal.x * gx + here.normal.y * gy);
    const Complex found = sum * here.inverse;
    write_shifted(alone, j, pass, found);
    fx = gx + here.lever * e[0] + here.force.x * angle + here.push[0] * found;
    fy = gy + here.lever * e[1] + here.force.y * angle + here.push[1] * found;
    moment = here.joint * found + bend;
    angle = before;
  }
  Complex m[size], found = zero;
  for (Complex& of : m) of = zero;
  for (Count j = 0; j < n; ++j) {
    const ShiftedSegment<size>& here = factors.segments[j];
    angle = inverse_mu * read_shifted(x, j, pass);
    here.passed(angle, read_shifted(x, n + j, pass), e);
    found = product(here.by, m) + here.follow * found + read_shifted(alone, j, pass);
    for (Count i = 0; i < size; ++i) m[i] = m[i] + here.step[i] * found + e[i];
    write_shifted(x, j, pass, inverse_mu * found + angle);
    write_shifted(x, n + j, pass, found);
  }
}

/// Returns body.operator()<size>() with the size of m that the model needs.
template <class Body>
auto with_carried(const MotionModel& model, const Body& body) {
  return model.resists() ? body.template operator()<6>() : body.template operator()<2>();
}

/// Calls body(factors, pass) for each pass, which has as many shifts as a vector has lanes.
template <class Body>
void for_each_pass(const MotionModel& model, double* array, const Body& body) {
  with_carried(model, [&]<Count size>() {
    for (Count pass = 0; pass < shift_passes; ++pass) {
      body(ShiftedFactors<size>(array, model.size, pass), pass);
    }
  });
}

Count shifted_numbers(const MotionModel& model) {
  return with_carried(model,
                      [&]<Count size>() { return ShiftedFactors<size>::numbers(model.size); });
}

void factorise_shifted(const MotionModel& model, const Batch& one, const double* mu,
                       double* array) {
  auto about =
      laid_out([&](Layout& layout) { return Linearised<double>(model, {one, 0, 1}, layout); });
  about.linearise();
  for_each_pass(model, array, [&](const auto& factors, Count pass) {
    *factors.mu = read_shifted(mu, 0, pass);
    factorise_shifted(about, factors);
  });
}

void solve_shifted(const MotionModel& model, double u, double* array, double* x) {
  double* const alone =
      laid_out([&](Layout& layout) { return layout.take(2 * shift_count * model.size); });
  for_each_pass(model, array, [&](const auto& factors, Count pass) {
    solve_shifted(model, u, factors, pass, alone, x);
  });
}

}  // namespace
