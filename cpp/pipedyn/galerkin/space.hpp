// SPDX-License-Identifier: MIT
//
// The reduced model in three dimensions, with the tangents of chain/space.hpp and rotation vectors
//
//   a(s) = sum_i q_i Theta_i(s),   q_i = (q_ix, q_iz),
//
// so that a plane motion is that of galerkin/galerkin.hpp. With N = (n_x, n_z) and R = I - E a~
// a~^T a change of q_ic changes the tangent by N R e_c Theta_i and the position by
//
//   J_ic(s) = int_0^s N R e_c Theta_i,
//
// and all loads f and couples x across the tangent do the virtual work int J_ic . f + Theta_i e_c .
// R x, as in the plane. With k = N^T t' = R a', a' the derivative by s, and mu = a~ . a', the
// energy of bending is
//
//   1/2 int e |k|^2 = 1/2 int e (|a'|^2 - h mu^2),   h = E (1 + S).
//
// Kelvin-Voigt damping acts on the rate at which k changes for material that does not twist, whose
// spin relative to N is w3 + C m:
//
//   d = k' + (w3 - C m) k~,   w3(s) = w3(0) + int_0^s (k_x w_z - k_z w_x),
//
// where w3(0) is C m at the root, 0 at a clamp: a hinge lets the pipe turn with N alone, like a
// universal joint with constant velocity. k' is the rate of k, and the power is -delta int e |d|^2.
// Its generalised forces are
//
//   -delta int e (Theta_i' e_c . R d + Theta_i A_c) + delta int Theta_i n3 e_c . R k~,
//   A = -E2 mu (d . a~) a + E (d . a~) a'~ + E mu d~ - C (d . k~) a~,   n3(s) = -int_s^1 e d . k~,
//
// where n3 delta is the couple that keeps the pipe from twisting: its torsional stiffness is taken
// as infinite.
//
// Supports hold x and z by forces as in galerkin/galerkin.hpp.
//
// Local to each translation unit, like vector/pack.hpp.
#pragma once

#include "pipedyn/chain/space.hpp"
#include "pipedyn/galerkin/integrals.hpp"
#include "pipedyn/galerkin/kernel.hpp"

namespace {

using pipedyn::MotionEffects, pipedyn::PanelTerm;

/// A point of the pipe in space, as a direction with what bends and loads it.
template <class Number>
struct SpatialPoint : Direction<Number> {
  Across<Number> curved, bend, damped;  // a', k, d
  Number mu, stiffening, by_square;     // mu, h, dh / drho^2
  Space<Number> force;
  Across<Number> couple, curving;  // factors of Theta_i e_c and of Theta_i' e_c in the virtual work
};

/// A state, or one with derivatives by some of its rows side by side.
template <class Number, class Rows>
struct SpatialBlock {
  using Traits = NumberTraits<Number>;
  static constexpr Count size = static_cast<Count>(sizeof(Number) / sizeof(double));
  const GridTables& grid;
  const MotionEffects& effects;
  const Rows& rows;
  const Count m = grid.functions, padded = grid.padded, points = grid.points;
  const Count block = grid.nodes + 1, last = points - 1;
  // Columns that are integrated: the derivatives of the position by q_x and q_z, three components
  // each; then acceleration at q'' = 0, velocity and position.
  const Count bias = 6 * m, speed = bias + 3, place = bias + 6, columns = bias + 9;
  const Count row = whole_packs(columns * size);
  SpatialDrive<Number> drive{rows};
  double *integrands, *integrals, *sums;  // sums: integrals of one number a point
  SpatialPoint<Number>* at;
  Number *mass, *force;
  Across<Number> root_couple{};  // factor of the rotation of the root in the virtual work
  // Of supports, a row for x and one for z of each: G, derivatives of displacements there; M^-1
  // G^T; G M^-1 G^T and then its factor; forces.
  const Count holds = 2 * effects.held_count;
  Number *by_support, *response, *products, *reaction;

  SpatialBlock(const GridTables& tables, const MotionEffects& present, const Rows& of)
      : grid(tables), effects(present), rows(of) {}

  void take(Layout& layout) {
    const Count narrow = whole_packs(size);
    integrands = layout.take(points * row);
    integrals = layout.take(points * row);
    sums = layout.take(points * narrow);
    at = layout.take<SpatialPoint<Number>>(points);
    mass = layout.take<Number>(4 * m * m);
    force = layout.take<Number>(2 * m);
    by_support = layout.take<Number>(holds * 2 * m);
    response = layout.take<Number>(holds * 2 * m);
    products = layout.take<Number>(holds * holds);
    reaction = layout.take<Number>(holds);
  }

  static Number get(const double* from, Count column) {
    Number found;
    std::memcpy(&found, from + column * size, sizeof found);
    return found;
  }
  static void put(double* to, Count column, const Number& x) {
    std::memcpy(to + column * size, &x, sizeof x);
  }
  static Space<Number> vector(const double* from, Count column) {
    return {get(from, column), get(from, column + 1), get(from, column + 2)};
  }
  static void put(double* to, Count column, const Space<Number>& x) {
    put(to, column, x.x);
    put(to, column + 1, x.y);
    put(to, column + 2, x.z);
  }
  /// Integral from the clamp to point p of vectors from this column on, plus a constant.
  Space<Number> integral(Count p, Count column) const {
    return vector(integrals + p * row, column);
  }

  /// Sets directions, motions and bending at all points.
  void set_points() {
    for (Count p = 0; p < points; ++p) {
      Across<Number> a{}, rate{}, curved{}, curving{};
      for (Count i = 0; i < m; ++i) {
        const double slope = grid.slope[p * padded + i], curve = grid.curvature[p * padded + i];
        const Across<Number> q{rows.row(i), rows.row(m + i)};
        const Across<Number> dq{rows.row(2 * m + i), rows.row(3 * m + i)};
        a = a + slope * q;
        rate = rate + slope * dq;
        curved = curved + curve * q;
        curving = curving + curve * dq;
      }
      SpatialPoint<Number>& here = at[p];
      here.set(a, rate);
      here.curved = curved;
      here.mu = dot(a.turned(), curved);
      here.bend = here.across_by(curved);
      here.stiffening = here.e * (1.0 + here.s);
      here.by_square =
          0.5 * here.e2 * (1.0 + here.s) - here.e * (here.e + 0.5 * dot(a, a) * here.e2);
      // The rate of k in the frame N; the spin of the material is added when it is known.
      const Across<Number> aside = a.turned();
      const Number m_rate = dot(aside, rate), along = dot(a, rate);
      const Number mu_rate = dot(rate.turned(), curved) + dot(aside, curving);
      here.damped = curving - (here.e2 * (along * here.mu) + here.e * mu_rate) * aside -
                    (here.e * here.mu) * rate.turned() - (here.c * m_rate) * here.bend.turned();
      here.force = Space<Number>{};
      here.couple = here.curving = Across<Number>{};
    }
  }

  void integrate_positions(bool derivatives) {
    for (Count p = 0; p < points; ++p) {
      const SpatialPoint<Number>& here = at[p];
      double* const to = integrands + p * row;
      if (derivatives) {
        const Space<Number> by[2] = {here.lifted(here.across_by({one(), Number{}})),
                                     here.lifted(here.across_by({Number{}, one()}))};
        for (Count c = 0; c < 2; ++c) {
          for (Count i = 0; i < m; ++i) {
            put(to, 3 * (c * m + i), grid.orthonormal[p * padded + i] * by[c]);
          }
        }
      }
      put(to, bias, here.lifted(here.bias) - here.square * here.t);
      put(to, speed, here.rate);
      put(to, place, here.t);
    }
    const Count from = derivatives ? 0 : bias * size / width * width;
    integrate(grid, row, columns * size - from, integrands + from, integrals + from);
  }
  static Number one() { return constant<Number>(1.0); }

  /// Velocity and position of a point on the ground.
  Space<Number> velocity(Count p) const { return integral(p, speed) + drive.velocity; }
  SpatialStation<Number> station(Count p) const {
    return at[p].station(integral(p, place) + drive.position, velocity(p), 0.0);
  }

  template <class Body>
  void for_each_station(const Body& body) const {
    for (Count k = 0; k < effects.load_count; ++k) {
      const PanelTerm& placed = effects.loads[k];
      Laws::with(placed.term, [&]<class Law>(const Law& law) {
        if constexpr (!Law::moves) return;
        const auto visit = [&](Count p, double w) {
          with_station(law, station(p), drive.position, drive.velocity,
                       [&](const auto& seen) { body(law, seen, p, w); });
        };
        if (placed.panel >= 0) {
          visit(placed.panel * block + grid.nodes, 1.0);
          return;
        }
        for (Count p = 0; p < points; ++p) {
          if (grid.weight[p] != 0.0) visit(p, grid.weight[p]);
        }
      });
    }
  }

  /// Integrals of a number along the pipe, from the clamp to each point, to `to`. integrand(p): the
  /// number at a point. The room of the integrands is used.
  template <class Integrand>
  void integrate_number(double* to, const Integrand& integrand) {
    const Count narrow = whole_packs(size);
    for (Count p = 0; p < points; ++p) {
      for (Count k = 0; k < narrow; ++k) integrands[p * narrow + k] = 0.0;
      put(integrands + p * narrow, 0, integrand(p));
    }
    integrate(grid, narrow, size, integrands, to);
  }
  Number number(const double* from, Count p) const { return get(from + p * whole_packs(size), 0); }

  /// a_z at the root; 0 if its direction is held.
  Number root_aside() const {
    Number found{};
    for (Count i = 0; grid.root_slope != nullptr && i < m; ++i) {
      found = found + grid.root_slope[i] * rows.row(m + i);
    }
    return found;
  }

  /// Adds the forces of bending and of its damping, and returns the power of the latter.
  Number bend() {
    if (effects.root_across != 0.0) root_couple.z = -effects.root_across * root_aside();
    for (Count p = 0; p < points; ++p) {
      SpatialPoint<Number>& here = at[p];
      const double w = grid.bending[p];
      const Number stiffer = w * (here.stiffening * here.mu);
      here.couple = here.couple + (w * (here.by_square * (here.mu * here.mu))) * here.a -
                    stiffer * here.curved.turned();
      here.curving = here.curving + stiffer * here.a.turned();
    }
    Number power{};
    if (effects.damping == 0.0) return power;
    Across<Number> root{}, root_rate{};
    for (Count i = 0; grid.root_slope != nullptr && i < m; ++i) {
      const double slope = grid.root_slope[i];
      root = root + slope * Across<Number>{rows.row(i), rows.row(m + i)};
      root_rate = root_rate + slope * Across<Number>{rows.row(2 * m + i), rows.row(3 * m + i)};
    }
    const Across<Number> root_spin = Rotation<Number>(dot(root, root)).c * root.turned();
    const Number spin = dot(root_spin, root_rate);
    integrate_number(
        sums, [&](Count p) { return Number(at[p].bend.x * at[p].w.z - at[p].bend.z * at[p].w.x); });
    for (Count p = 0; p < points; ++p) {
      at[p].damped = at[p].damped + (spin + number(sums, p)) * at[p].bend.turned();
    }
    integrate_number(sums, [&](Count p) {
      const double w = grid.weight[p], stiffness = w != 0.0 ? grid.bending[p] / w : 0.0;
      return Number(stiffness * dot(at[p].damped, at[p].bend.turned()));
    });
    const Number whole = number(sums, last);
    root_couple = root_couple + (-effects.damping * whole) * root_spin;
    for (Count p = 0; p < points; ++p) {
      SpatialPoint<Number>& here = at[p];
      const Across<Number>& d = here.damped;
      const Across<Number> aside = here.a.turned(), turned = here.bend.turned();
      const double w = effects.damping * grid.bending[p];
      const Number beside = dot(d, aside);
      const Across<Number> by_rate =
          (here.e * beside) * here.curved.turned() + (here.e * here.mu) * d.turned() -
          (here.e2 * (here.mu * beside)) * here.a - (here.c * dot(d, turned)) * aside;
      const Number twist = (effects.damping * grid.weight[p]) * (number(sums, p) - whole);
      here.couple = here.couple - w * by_rate + twist * here.across_by(turned);
      here.curving = here.curving - w * here.across_by(d);
      power = power - w * dot(d, d);
    }
    return power;
  }

  /// Direction of the jet, times the end coefficient: its angle is taken from the tangent towards
  /// the axis that n_x is for material that does not twist, whose spin along the pipe differs from
  /// that of N by C mu. The sums are overwritten.
  Space<Number> jet_direction() {
    const SpatialPoint<Number>& end = at[last];
    const Space<Number> along = effects.thrust[0] * end.t;
    if (effects.thrust[1] == 0.0) return along;
    integrate_number(sums, [&](Count p) { return Number(at[p].c * at[p].mu); });
    const auto [sine, cosine] = sincos_of(number(sums, last));
    return along + effects.thrust[1] * end.lifted({cosine, sine});
  }

  /// Sets loads on the points and returns the powers of the motion.
  PowerParts<Number> load() {
    const Number u = rows.speed(), push = (0.5 * effects.coriolis) * drive.rate;
    PowerParts<Number> power{};
    const auto act = [&](Count p, const Space<Number>& load) {
      at[p].force += load;
      return dot(load, drive.velocity);
    };
    for (Count p = 0; p < points; ++p) {
      SpatialPoint<Number>& here = at[p];
      const Space<Number> own = integral(p, speed);
      const double w = grid.weight[p];
      here.force += (-w * effects.coriolis * u) * here.rate - (w * push) * here.t;
      here.force += (grid.mass[p] * effects.gamma) * in_plane<Number>(effects.down);
      const Space<Number> acceleration = integral(p, bias) + drive.acceleration;
      here.force += -grid.mass[p] * acceleration;
      power.flow = power.flow - (w * push) * dot(here.t, own);
      power.base = power.base - grid.mass[p] * dot(own, drive.acceleration);
      if (const double pushed = w * effects.normal_mass; pushed != 0.0) {
        here.force += -pushed * here.normal(acceleration);
        power.base = power.base - pushed * dot(here.normal(own), drive.acceleration);
      }
      if (effects.drag == 0.0 || w == 0.0) continue;
      const Space<Number> moving = velocity(p);
      const Space<Number> normal = here.normal(moving);
      const Space<Number> drag = (-w * effects.drag * root_of(dot(normal, normal))) * normal;
      power.base = power.base - act(p, drag);
      power.drag = power.drag + dot(drag, moving);
    }
    for_each_station([&](const auto& of, const SpatialStation<Number>& seen, Count p, double w) {
      const auto law = acting_in_space<Number>(of, grid.place[p], rows);
      const SpatialLoad<Number> load = law.load_in_space(seen);
      act(p, w * load.force);
      power.base = power.base - w * base_loss(law, seen, load, drive.velocity);
      at[p].couple = at[p].couple + at[p].across_by(w * load.couple);
      power.terms = power.terms + w * power_of(law, seen, load);
    });
    for (Count k = 0; k < grid.turning; ++k) {
      SpatialPoint<Number>& here = at[grid.turning_at[k]];
      here.couple = here.couple - grid.inertia[k] * here.across_by(here.bias);
    }
    const Space<Number> end = integral(last, speed), jet = (u * u) * jet_direction();
    const Space<Number> entering = (effects.entry * u) * velocity(last);
    at[last].force += entering - jet;
    power.flow = power.flow - dot((0.5 * effects.coriolis * u) * end - entering + jet, end);
    return power;
  }

  /// Whether a tangent has turned by more than half a turn, where the coordinates end.
  auto largest_square() const {
    typename Traits::Plain most{};
    for (Count p = 0; p < points; ++p) {
      const auto square = Traits::value(dot(at[p].a, at[p].a));
      most = square > most ? square : most;
    }
    return most;
  }

  /// Generalised forces by orthonormal coordinates, and the mass matrix.
  void gather() {
    for (Count c = 0; c < 2; ++c) {
      for (Count i = 0; i < m; ++i) {
        Number sum{};
        for (Count p = 0; p < points; ++p) {
          const SpatialPoint<Number>& here = at[p];
          sum = sum + dot(integral(p, 3 * (c * m + i)), here.force);
          sum = sum + grid.orthonormal[p * padded + i] * (c == 0 ? here.couple.x : here.couple.z);
          sum = sum + grid.orthonormal_curvature[p * padded + i] *
                          (c == 0 ? here.curving.x : here.curving.z);
        }
        if (grid.root_slope != nullptr) {
          sum = sum + grid.root_slope[m + i] * (c == 0 ? root_couple.x : root_couple.z);
        }
        for (Count k = 0; k < m; ++k) {
          sum = sum - grid.elastic_forces[k * m + i] * rows.row(c * m + k);
        }
        force[c * m + i] = sum;
      }
    }
    for (Count i = 0; i < 2 * m; ++i) {
      for (Count j = 0; j <= i; ++j) {
        Number sum{};
        for (Count p = 0; p < points; ++p) {
          if (grid.mass[p] == 0.0) continue;
          sum = sum + grid.mass[p] * dot(integral(p, 3 * i), integral(p, 3 * j));
        }
        for (Count k = 0; k < grid.turning; ++k) {
          const Count p = grid.turning_at[k];
          const SpatialPoint<Number>& here = at[p];
          const auto turned = [&](Count of) {
            const Number slope = constant<Number>(grid.orthonormal[p * padded + of % m]);
            return of < m ? here.across_by({slope, Number{}}) : here.across_by({Number{}, slope});
          };
          sum = sum + grid.inertia[k] * dot(turned(i), turned(j));
        }
        mass[i * 2 * m + j] = sum;
      }
    }
    for (Count p = 0; effects.normal_mass != 0.0 && p < points; ++p) {
      const double pushed = grid.weight[p] * effects.normal_mass;
      for (Count i = 0; i < 2 * m; ++i) {
        const Space<Number> across = pushed * at[p].normal(integral(p, 3 * i));
        for (Count j = 0; j <= i; ++j) {
          mass[i * 2 * m + j] = mass[i * 2 * m + j] + dot(across, integral(p, 3 * j));
        }
      }
    }
  }

  /// Replaces the forces by accelerations of the orthonormal coordinates.
  void solve() {
    factorise_symmetric(mass, 2 * m);
    solve_symmetric(mass, 2 * m, force);
  }

  /// Adds to the accelerations those by the forces that hold the pipe at its supports.
  void hold() {
    const Count n = 2 * m;
    const double k = effects.return_rate;
    for (Count row = 0; row < holds; ++row) {
      constexpr Number Space<Number>::* across[] = {&Space<Number>::x, &Space<Number>::z};
      const auto of = across[row % 2];
      const Count p = effects.held[row / 2] * block + grid.nodes;
      const Space<Number> missed =
          integral(p, bias) + k * (2.0 * integral(p, speed) + k * integral(p, place));
      Number* const own = response + row * n;
      Number lacking = -(missed.*of);
      for (Count i = 0; i < n; ++i) {
        own[i] = by_support[row * n + i] = integral(p, 3 * i).*of;
        lacking = lacking - own[i] * force[i];
      }
      reaction[row] = lacking;
      solve_symmetric(mass, n, own);
      for (Count other = 0; other <= row; ++other) {
        Number sum{};
        for (Count i = 0; i < n; ++i) sum = sum + by_support[other * n + i] * own[i];
        products[row * holds + other] = sum;
      }
    }
    factorise_symmetric(products, holds);
    solve_symmetric(products, holds, reaction);
    for (Count row = 0; row < holds; ++row) {
      for (Count i = 0; i < n; ++i) force[i] = force[i] + reaction[row] * response[row * n + i];
    }
  }

  /// Calls put(i, q_i'') for the 2 m coordinates.
  template <class Put>
  void accelerations(const Put& put) {
    set_points();
    integrate_positions(true);
    load();
    bend();
    gather();
    solve();
    hold();
    const auto farthest = largest_square();
    constexpr double half_turn = 3.141592653589793 * 3.141592653589793;
    const auto lost = farthest > half_turn ? all<typename Traits::Plain>(__builtin_nan(""))
                                           : typename Traits::Plain{};
    for (Count c = 0; c < 2; ++c) {
      for (Count i = 0; i < m; ++i) {
        Number sum = Traits::of(lost);
        for (Count j = 0; j < m; ++j) sum = sum + grid.to_basis[i * m + j] * force[c * m + j];
        put(c * m + i, sum);
      }
    }
  }

  /// Calls put(k, power) for the five powers.
  template <class Put>
  void powers(const Put& put) {
    set_points();
    integrate_positions(false);
    PowerParts<Number> power = load();
    power.joints = bend();
    power.each(put);
  }

  /// Calls put(k, number) for the position of the free end and its velocity.
  template <class Put>
  void tips(const Put& put) {
    set_points();
    integrate_positions(false);
    for (Count k = 0; k < 3; ++k) {
      put(k, get(integrals + last * row, place + k));
      put(3 + k, get(integrals + last * row, speed + k));
    }
  }

  Number energy() {
    set_points();
    integrate_positions(false);
    Number twice{};
    for (Count p = 0; p < points; ++p) {
      const SpatialPoint<Number>& here = at[p];
      const Space<Number> v = integral(p, speed);
      twice = twice + grid.mass[p] * dot(v, v);
      if (effects.normal_mass != 0.0) {
        twice = twice + (grid.weight[p] * effects.normal_mass) * dot(here.normal(v), v);
      }
      twice = twice - grid.bending[p] * (here.stiffening * (here.mu * here.mu));
      // 1 - cos rho along the pipe lifts the mass beyond.
      const Number rise = effects.down[1] * here.drop() - effects.down[0] * here.t.x;
      twice = twice + (2.0 * effects.gamma * grid.weight[p] * grid.beyond[p]) * rise;
    }
    for (Count k = 0; k < grid.turning; ++k) {
      const SpatialPoint<Number>& here = at[grid.turning_at[k]];
      twice = twice + grid.inertia[k] * here.square;
    }
    for (Count c = 0; c < 2; ++c) {
      for (Count i = 0; i < m; ++i) {
        for (Count j = 0; j < m; ++j) {
          twice = twice + grid.elastic[i * m + j] * (rows.row(c * m + i) * rows.row(c * m + j));
        }
      }
    }
    for_each_station([&](const auto& law, const SpatialStation<Number>& seen, Count, double w) {
      twice = twice + (2.0 * w) * law.energy_in_space(seen);
    });
    if (effects.root_across != 0.0) {
      const Number aside = root_aside();
      twice = twice + effects.root_across * (aside * aside);
    }
    return 0.5 * twice;
  }
};

// ---------------------------------------------------------------------------------------- entry

/// A block of the side-by-side layout of GalerkinKernel, as `States`.
template <class Real>
struct BlockStates {
  const Batch& batch;

  Real row(Count j) const { return at<Real>(batch.y, j); }
  Real speed() const { return load<Real>(batch.u); }
  Real driven(Count k) const { return drives(batch, k) ? at<Real>(batch.drive, k) : Real{}; }
};

template <class Number, class Rows, class Body>
void with_spatial_block(const GridTables& grid, const MotionEffects& effects, const Rows& rows,
                        const Body& body) {
  SpatialBlock<Number, Rows> block(grid, effects, rows);
  laid_out([&](Layout& layout) { block.take(layout); });
  body(block);
}

/// Calls body(block, set) for a batch of one member or of as many as a pack holds; set(i, x) writes
/// result i.
template <auto body>
void in_space(const GridTables& grid, const MotionEffects& effects, const Batch& batch,
              double* out) {
  const auto run = [&]<class Real>(const Real&) {
    with_spatial_block<Real>(grid, effects, BlockStates<Real>{batch}, [out](auto& block) {
      body(block, [out](Count i, const Real& x) { set(out, i, x); });
    });
  };
  if (batch.members == 1) {
    run(0.0);
  } else {
    run(Pack{});
  }
}

/// For one member the derivatives of q'' by the state, (2 m, 4 m), then q'' and its derivative by
/// the speed, (2 m) each.
void jacobian_in_space(const GridTables& grid, const MotionEffects& effects, const Batch& batch,
                       double* out) {
  using Number = Dual<Pack, 1u>;
  const Count n = 2 * grid.functions, rows = 2 * n;
  for (Count first = 0; first <= rows; first += width) {
    const Seeded<Pack> seeded{batch, 0, first, rows};
    with_spatial_block<Number>(grid, effects, seeded, [&](auto& block) {
      block.accelerations([&](Count i, const Number& x) {
        double* const value = out + n * rows + i;
        put_derivatives(x, first, rows, out + i * rows, value, value + n);
      });
    });
  }
}

}  // namespace
