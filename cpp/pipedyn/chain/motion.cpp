// SPDX-License-Identifier: MIT
//
// The functions of one vector level. This source is compiled once for each level, with
// PIPEDYN_LEVEL and PIPEDYN_WIDTH set.
//
// Energy: kinetic energy + sum k_j phi_j (phi_j / 2 - psi_j)
//   + gamma sum p_j ((1 - cos theta_j) cos iota - sin theta_j sin iota).
// Powers, with the velocity v of the end and v_j of the drag points: flow -c sqrt(beta) U |v|^2 -
// a U^2 (cos psi t_n + sin psi n_n) . v, joints -sum c_j phi_j'^2, drag -kappa sum l_j |v_j|^3. If
// the end is guided, its joint with phi_{n+1} = -theta_n is included, and the axis replaces segment
// n in the direction of the jet. The terms add their energies and powers, given by their laws. A
// change of speed adds -sqrt(beta) U' sum l_j t_j . r_j', with r_j' the velocity in the middle of
// segment j, to the power of the flow.
//
// If the base moves, the energy is that in the frame of the base, except for the terms' energy,
// which is that on the ground; v and r_j' are relative to the base, but the part -(1 - c) of the
// flow's force contains the whole velocity. Let P be the momentum relative to the base, and R the
// force of drag and terms, whose own power is that on the ground. The base adds the power -(X'',
// Y'') . P - (X', Y') . R.
#include "pipedyn/chain/motion.hpp"

#include "pipedyn/chain/derivative.hpp"
#include "pipedyn/chain/dynamic_stiffness.hpp"
#include "pipedyn/chain/shifted.hpp"
#include "pipedyn/chain/space.hpp"
#include "pipedyn/chain/sweeps.hpp"
#include "pipedyn/galerkin/elimination.hpp"
#include "pipedyn/galerkin/kernel.hpp"
#include "pipedyn/motion/dense.hpp"
#include "pipedyn/motion/interval_stages.hpp"
#include "pipedyn/motion/magnus.hpp"
#include "pipedyn/motion/orbit_states.hpp"
#include "pipedyn/motion/stages.hpp"
#include "pipedyn/vector/pack.hpp"

namespace {

template <class Real>
void energy_of(const ChainModel& model, const Members<Real>& members, Sweep<Real> sweep,
               double* out) {
  const Count n = model.size;
  Real twice{};
  if (model.gravity != 0.0) {  // 1 - cos theta = 2 sin^2 (theta / 2)
    for (Count j = 0; j < n; ++j) sweep.set(sweep.turn, j, 0.5 * members.row(j));
    sweep.take_sines(n);
    for (Count j = 0; j < n; ++j) {
      const Real s = sweep.at(sweep.sine, j), c = sweep.at(sweep.cosine, j);
      twice += 4.0 * model.links[j].weight * (s * (model.down[1] * s - model.down[0] * c));
    }
  }
  read_state(members, n, sweep);
  Real end_along{}, end_across{};
  for_each_velocity(
      model, sweep,
      [&](Count j, const Real& along, const Real& across, const Real& w) {
        const Link& link = model.links[j];
        const Real turn = sweep.at(sweep.turn, j);
        twice += link.mass * (along * along + across * across) + link.added * (across * across);
        twice += w * (2.0 * link.first_moment * across + link.inertia * w);
        twice += turn * (link.spring * turn - 2.0 * link.rest_moment);
      },
      end_along, end_across);
  const auto add = [&](const auto& law, const SegmentTerm& place, const auto& at) {
    twice += (2.0 * place.weight) * law.energy(at);
  };
  Walk<Real> walk(model, drive_of(members));
  for (Count j = 0; j < n && model.load_count > 0; ++j) {
    walk.turn(sweep.at(sweep.sine, j), sweep.at(sweep.cosine, j));
    walk.pass(j, model.links[j].length, members.row(j), sweep.at(sweep.rate, j), add);
  }
  const Real angle = members.row(n - 1);
  twice += model.end_spring * (angle * angle);
  members.set_row(out, 0, 0.5 * twice);
}

/// Implements MotionKernel::axial. With the acceleration A_j of joint j, the vector D_j from joint
/// j + 1 to the end and the integral along the pipe,
///   int t . r'' = sum_j l_j (t_j . A_j - l_j w_j^2 / 2),
/// whose derivatives are l_j (n_j . A_j - (w_j' t_j + w_j^2 n_j) . D_j) by the angle of segment j,
/// -l_j w_j (2 t_j . D_j + l_j) by its rate, and l_j n_j . D_j by its acceleration.
template <class Real>
void axial_of(const ChainModel& model, const Members<Real>& members, Sweep<Real> sweep,
              double* out) {
  const Count n = model.size;
  for (Count j = 0; j < n; ++j) sweep.set(sweep.turn, j, members.row(j));
  sweep.take_sines(n);
  const Driven<Real> driven = drive_of(members);
  const auto [down_x, down_y] = model.down;
  Real ax = driven.ax, ay = driven.ay, along = model.base * ay;
  Real depth = all<Real>(model.base * down_y);
  for (Count j = 0; j < n; ++j) {
    const double l = model.links[j].length;
    const Real s = sweep.at(sweep.sine, j), c = sweep.at(sweep.cosine, j);
    const Real w = members.row(n + j), turning = l * members.row(2 * n + j), inward = l * (w * w);
    sweep.set(sweep.free, j, c * ax - s * ay);
    along += l * (s * ax + c * ay - 0.5 * inward);
    ax += turning * c - inward * s;
    ay -= turning * s + inward * c;
    depth += l * (down_x * s + down_y * c);
  }
  members.set_row(out, 0, along);
  members.set_row(out, 1, depth);
  Real x{}, y{};  // components of D_j
  for (Count j = n - 1; j >= 0; --j) {
    const double l = model.links[j].length;
    const Real s = sweep.at(sweep.sine, j), c = sweep.at(sweep.cosine, j);
    const Real w = members.row(n + j), turning = members.row(2 * n + j);
    const Real beyond = s * x + c * y, across = c * x - s * y;
    const Real by_angle = sweep.at(sweep.free, j) - turning * beyond - w * w * across;
    members.set_row(out, 2 + j, l * by_angle);
    members.set_row(out, 2 + n + j, -l * w * (2.0 * beyond + l));
    members.set_row(out, 2 + 2 * n + j, l * across);
    members.set_row(out, 2 + 3 * n + j, l * (down_x * c - down_y * s));
    x += l * s;
    y += l * c;
  }
}

// ---------------------------------------------------------------------------------------- entry

template <bool with_power>
void rhs(const ChainModel& model, const Batch& batch, double* rates) {
  for_each_block(model, batch, [&](const auto& members, const auto& sweep) {
    const auto parts = accelerations_of<false>(model, members, sweep, rates);
    if (with_power) members.set_row(rates, 2 * model.size, parts.total());
  });
}

void energy(const ChainModel& model, const Batch& batch, double* out) {
  for_each_block(model, batch, [&](const auto& members, const auto& sweep) {
    energy_of(model, members, sweep, out);
  });
}

void power(const ChainModel& model, const Batch& batch, double* out) {
  for_each_block(model, batch, [&](const auto& members, const auto& sweep) {
    powers_of(model, members, sweep).each([&](Count k, const auto& power) {
      members.set_row(out, k, power);
    });
  });
}

void axial(const ChainModel& model, const Batch& batch, double* out) {
  for_each_block(model, batch, [&](const auto& members, const auto& sweep) {
    axial_of(model, members, sweep, out);
  });
}

void combine(const double* weights, const double* const* k, Count terms, const double* y,
             const double* h, double* out, Count size) {
  const auto add = [&]<class Real>(const Real&, Count i) {
    Real sum{};
    for (Count s = 0; s < terms; ++s) sum += weights[s] * load<Real>(k[s] + i);
    store(out + i, Real(load<Real>(y + i) + load<Real>(h + i) * sum));
  };
  Count i = 0;
  for (; i + width <= size; i += width) add(Pack{}, i);
  for (; i < size; ++i) add(0.0, i);
}

}  // namespace

#define PIPEDYN_QUOTED(level) #level
#define PIPEDYN_TEXT(level) PIPEDYN_QUOTED(level)

namespace pipedyn {

const MotionKernel PIPEDYN_NAMED(motion) = {
    .name = PIPEDYN_TEXT(PIPEDYN_LEVEL),
    .width = width,
    .rhs = ::rhs<false>,
    .rhs_and_power = ::rhs<true>,
    .jacobian = ::jacobian,
    .energy = ::energy,
    .power = ::power,
    .axial = ::axial,
    .combine = ::combine,
    .factor_numbers = ::shifted_numbers,
    .factorise = ::factorise_shifted,
    .solve = ::solve_shifted,
    .factorise_dense = ::factorise_dense,
    .solve_dense = ::solve_dense,
    .mix_stages = ::mix_stages,
    .correct_stages = ::correct_stages,
    .sincos = sincos,
    .multiply = multiply_rows,
    .solve_real = ::solve_real,
    .orbit_states = ::orbit_states,
    .eliminate_stages = ::eliminate_stages,
    .exponentials = ::exponentials,
    .interval_map = ::interval_map,
    .spatial = {.rhs = spatial_rhs<false>,
                .rhs_and_power = spatial_rhs<true>,
                .jacobian = spatial_jacobian<false>,
                .linearise = spatial_jacobian<true>,
                .energy = ::spatial_energy,
                .power = spatial_power},
    .galerkin = &PIPEDYN_NAMED(galerkin),
    .dynamic_stiffness = &PIPEDYN_NAMED(stiffness),
    .elimination = &PIPEDYN_NAMED(elimination),
};

}  // namespace pipedyn
