// SPDX-License-Identifier: MIT
//
// The motion of a block of members of a batch, side by side (equations in galerkin/galerkin.hpp).
// For one member the vectors run along the pipe or over the functions; for several, each lane holds
// one member. Local to each translation unit, like vector/pack.hpp.
#pragma once

#include <type_traits>

#include "pipedyn/galerkin/integrals.hpp"
#include "pipedyn/galerkin/kernel.hpp"
#include "pipedyn/galerkin/signed_weights.hpp"
#include "pipedyn/terms/laws.hpp"
#include "pipedyn/vector/layout.hpp"

namespace {

using pipedyn::Batch, pipedyn::Drive, pipedyn::MotionEffects, pipedyn::PanelTerm;

/// As many members as a Real holds, side by side, with all that is computed for them.
template <class Real>
struct Block {
  static constexpr bool alone = lanes<Real> == 1;
  // What a vector holds in sums: for one member several entries along the pipe or of the functions;
  // for several members one entry of each.
  using Numbers = std::conditional_t<alone, Pack, double>;
  static constexpr Count step = lanes<Numbers>;  // number of points or functions in a vector
  static constexpr Count tile = alone ? 1 : 4;   // number of vectors at a time
  const GridTables& grid;
  const MotionEffects& effects;
  const Count m = grid.functions, padded = grid.padded, nodes = grid.nodes, points = grid.points;
  const Count block = nodes + 1;  // number of points of a panel
  const Count holds = effects.held_count;
  const bool drags = effects.drag != 0.0, loads = effects.load_count > 0 || holds > 0;
  const bool resists = drags || loads || effects.entry != 0.0;
  const bool across_alone = effects.normal_mass != 0.0;

  // The columns that are integrated: derivatives of the position by the orthonormal coordinates, x
  // then y (for several members without padding columns); the acceleration at q'' = 0; the
  // velocity, if drag, a term, a support or the entering flow reads it; the position, if a term or
  // a support reads it. Energy and power integrate the last two alone.
  const Count each = alone ? padded : m;
  const Count bias = 2 * each, integrated = bias + (loads ? 6 : resists ? 4 : 2);
  double *theta, *omega, *sine, *cosine;  // (points); for a single member (stride)
  double *integrands, *moments;           // in rows of columns; their integrals from the clamp
  double *mass, *force;
  double *velocity, *weighted, *load_x, *load_y, *couple, *rest;  // (points); rest: scratch, 3 Q
  // For supports, with the rows G of derivatives of x there: M^-1 G^T, one row a support
  // (`response`); G M^-1 G^T and then its factor (`products`); the forces of the supports
  // (`reaction`).
  double *response, *products, *reaction;

  static Count row_length(Count columns) { return whole_packs(columns * lanes<Real>); }
  /// Length of a row of the mass matrix and of the forces. For a single member it is a multiple of
  /// a pack, since single rows are written by whole packs.
  Count mass_stride() const { return alone ? whole_packs(padded) : padded; }

  Block(const GridTables& tables, const MotionEffects& present) : grid(tables), effects(present) {}

  /// Reserves the arrays, with rows of at least this number of columns.
  void take(Layout& layout, Count columns = 0) {
    const auto take = [&](Count reals) { return layout.take(reals * lanes<Real>); };
    const Count most = columns > bias + 6 ? columns : bias + 6;
    const Count rows = points * row_length(most) / lanes<Real> + 1;
    theta = take(grid.stride);
    omega = take(grid.stride);
    sine = take(grid.stride);
    cosine = take(grid.stride);
    integrands = take(rows);
    moments = take(rows);
    mass = take(padded * mass_stride());
    force = take(mass_stride());
    velocity = take(points);
    weighted = take(points);
    load_x = take(points);
    load_y = take(points);
    couple = take(points);
    rest = take(3 * nodes);
    response = take(holds * m);
    products = take(holds * holds);
    reaction = take(holds);
  }

  /// sum_i x_i Theta_i at the points of the pipe, for each vector x (m,) of amplitudes in the
  /// basis.
  template <int sums>
  void along(const double* const (&x)[sums], double* const (&to)[sums]) {
    const Count count = alone ? grid.stride : points;
    for (Count p = 0; p < count; p += tile * step) {
      Pack sum[sums][tile] = {};
      for (Count i = 0; i < m; ++i) {
        Real factor[sums];
        for (int n = 0; n < sums; ++n) factor[n] = at<Real>(x[n], i);
        for (Count k = 0; k < tile; ++k) {
          const auto slope = load<Numbers>(grid.slope_by_function + i * grid.stride + p + k * step);
          for (int n = 0; n < sums; ++n) sum[n][k] += slope * factor[n];
        }
      }
      for (int n = 0; n < sums; ++n) {
        for (Count k = 0; k < tile; ++k) store(to[n] + p * lanes<Real> + k * width, sum[n][k]);
      }
    }
  }

  void angles(const double* y) {
    along<2>({y, y + m * lanes<Real>}, {theta, omega});
    sincos(theta, (alone ? grid.stride : points) * lanes<Real>, sine, cosine);
  }

  /// Sets the integrands n Theta_i of the derivatives of the position.
  void set_slopes(Count row) {
    for (Count p = 0; p < points; ++p) {
      const Real c = at<Real>(cosine, p), s = at<Real>(sine, p);
      const double* __restrict const slope = grid.orthonormal + p * padded;
      double* __restrict const to = integrands + p * row;
      for (Count i = 0; i < each; ++i) {
        set(to, i, Real(slope[i] * c));
        set(to, each + i, Real(-slope[i] * s));
      }
    }
  }

  /// Sets, from this column on, the integrand n theta' of the velocity and, if a term reads it, the
  /// integrand t of the position.
  void set_velocity(Count row, Count column) {
    for (Count p = 0; p < points; ++p) {
      const Real c = at<Real>(cosine, p), s = at<Real>(sine, p), w = at<Real>(omega, p);
      double* const to = integrands + p * row + column * lanes<Real>;
      set(to, 0, Real(c * w));
      set(to, 1, Real(-s * w));
      if (!loads) continue;
      set(to, 2, s);
      set(to, 3, c);
    }
  }

  /// Sets the integrand -t theta'^2 of the acceleration at q'' = 0.
  void set_acceleration(Count row, Count column) {
    for (Count p = 0; p < points; ++p) {
      const Real w = at<Real>(omega, p), square = w * w;
      double* const to = integrands + p * row + column * lanes<Real>;
      set(to, 0, Real(-at<Real>(sine, p) * square));
      set(to, 1, Real(-at<Real>(cosine, p) * square));
    }
  }

  /// Computes v_n and the weights of the nodes with the sign of v_n.
  void drag(Count row, Count column) {
    for (Count p = 0; p < points; ++p) {
      const double* const v = moments + p * row + column * lanes<Real>;
      set(velocity, p,
          Real(at<Real>(cosine, p) * at<Real>(v, 0) - at<Real>(sine, p) * at<Real>(v, 1)));
    }
    signed_weights_of<Real>(grid, velocity, weighted, rest);
  }

  /// A row of the drive of a batch, 0 if nothing drives the base.
  Real driven(const Batch& batch, Count of) const {
    return batch.drive == nullptr ? Real{} : at<Real>(batch.drive, of);
  }

  /// Adds the motion of the base to the motion relative to it, from this column on: the
  /// acceleration, if `accelerates`, the velocity and the position.
  void add_base(const Batch& batch, Count row, Count column, bool accelerates) {
    if (batch.drive == nullptr) return;
    const Count skipped = accelerates ? 0 : 2, count = (loads ? 6 : resists ? 4 : 2) - skipped;
    constexpr Count rows[] = {Drive::acceleration, Drive::velocity, Drive::position};
    for (Count p = 0; p < points; ++p) {
      for (Count k = 0; k < count; ++k) {
        const Count of = k + skipped;
        add(moments + p * row, column + k, driven(batch, rows[of / 2] + of % 2));
      }
    }
  }

  /// The variables of a point that laws read; column: first column of the velocity.
  Station<Real> station(Count row, Count column, Count p) const {
    const double* const v = moments + p * row + column * lanes<Real>;
    const auto of = [&](bool integrated, Count k) { return integrated ? at<Real>(v, k) : Real{}; };
    return {of(loads, 2),        of(loads, 3),   at<Real>(theta, p), at<Real>(sine, p),
            at<Real>(cosine, p), of(resists, 0), of(resists, 1),     at<Real>(omega, p)};
  }

  /// Calls body(law, station, point, weight) at each place where a term acts; column: first column
  /// of the velocity.
  template <class Body>
  void for_each_station(const Batch& batch, Count row, Count column, const Body& body) const {
    for (Count k = 0; k < effects.load_count; ++k) {
      const PanelTerm& placed = effects.loads[k];
      Laws::with(placed.term, [&]<class Law>(const Law& law) {
        if constexpr (has_load<Law>) {
          const auto seen = [&](Count p) {
            if constexpr (!Law::on_base) return station(row, column, p);
            constexpr Count place = Drive::position, rate = Drive::velocity;
            return about(station(row, column, p), driven(batch, place), driven(batch, place + 1),
                         driven(batch, rate), driven(batch, rate + 1));
          };
          const auto at_point = [&](Count p, double weight) {
            if constexpr (!Law::applied) {
              body(law, seen(p), p, weight);
            } else if (batch.drive != nullptr && batch.drive_rows > Drive::rows) {
              const auto row = [&](Count k) { return driven(batch, Drive::rows + k); };
              body(AppliedNow<Real>(law, grid.place[p], row), seen(p), p, weight);
            }
          };
          if (placed.panel >= 0) {
            at_point(placed.panel * block + nodes, 1.0);
            return;
          }
          for (Count p = 0; p < points; ++p) {
            if (grid.weight[p] != 0.0) at_point(p, grid.weight[p]);
          }
        }
      });
    }
  }

  /// Force per length along the pipe by the acceleration of the flow, sqrt(beta) U'.
  Real unsteady(const Batch& batch) const {
    return (0.5 * effects.coriolis) * driven(batch, Drive::rate);
  }

  /// The law of what flow, drag and mass that moves across the pipe alone do at a point.
  struct PointLoad {
    Real along, across;             // force against the tangent and against the normal
    Real coriolis, entering, drag;  // factors of theta', of the velocity, and of v_n^2 across
    Real pushed_x, pushed_y;        // mass that moves across, times the acceleration

    auto load(const auto& at) const {
      const auto normal = at.cosine * at.vx - at.sine * at.vy;
      const auto inertia = at.cosine * pushed_x - at.sine * pushed_y;
      const auto sideways = inertia + coriolis * at.omega + drag * (normal * normal) + across;
      return Load{entering * at.vx - sideways * at.cosine - along * at.sine,
                  entering * at.vy + sideways * at.sine - along * at.cosine};
    }
  };

  /// The part of this law that is linear in the speed and its square; for the derivative by the
  /// speed these are replaced by theirs, 1 and 2 u.
  PointLoad flow_at(Count p, const Real& u, const Real& square) const {
    PointLoad found{};
    found.coriolis = (grid.weight[p] * effects.coriolis) * u;
    if (p + 1 < points) return found;
    found.entering = effects.entry * u;
    found.along = effects.thrust[0] * square;  // the follower force
    found.across = effects.thrust[1] * square;
    return found;
  }

  /// The whole law; ax, ay: the acceleration.
  PointLoad point_load(const Batch& batch, Count p, const Real& ax, const Real& ay) const {
    const Real u = load<Real>(batch.u);
    PointLoad found = flow_at(p, u, u * u);
    found.along += grid.weight[p] * unsteady(batch);
    if (drags) found.drag = effects.drag * at<Real>(weighted, p);
    const double pushed = grid.weight[p] * effects.normal_mass;
    found.pushed_x = pushed * ax;
    found.pushed_y = pushed * ay;
    return found;
  }

  /// All generalised forces except the part of inertia that is linear in q'', by orthonormal
  /// coordinates.
  void forces(const Batch& batch, Count row) {
    if (drags) drag(row, bias + 2);
    const double gx = effects.gamma * effects.down[0], gy = effects.gamma * effects.down[1];
    for (Count p = 0; p < points; ++p) {
      const double* const bent = moments + p * row + bias * lanes<Real>;
      const Real ax = at<Real>(bent, 0), ay = at<Real>(bent, 1);
      const Acting<Real> load(point_load(batch, p, ax, ay).load(station(row, bias + 2, p)));
      set(load_x, p, Real(load.x + grid.mass[p] * (gx - ax)));  // inertia and weight
      set(load_y, p, Real(load.y + grid.mass[p] * (gy - ay)));
      set(couple, p, Real{});
    }
    for_each_station(batch, row, bias + 2,
                     [&]<class Law>(const Law& law, const auto& station, Count p, double w) {
                       const Acting<Real> load(law.load(station));
                       add(load_x, p, Real(w * load.x));
                       add(load_y, p, Real(w * load.y));
                       if constexpr (turns<Law>) add(couple, p, Real(w * load.couple));
                     });
    gather(row);
    elastic(batch.y);
  }

  /// The generalised forces of the loads, by orthonormal coordinates.
  void gather(Count row) {
    for (Count i = 0; i < padded; i += tile * step) {
      Pack sum[tile] = {};
      for (Count p = 0; p < points; ++p) {
        const double* const x = moments + p * row + i * lanes<Real>;
        const double* const y_row = x + each * lanes<Real>;
        const double* const turned = grid.orthonormal + p * padded + i;
        const Real fx = at<Real>(load_x, p), fy = at<Real>(load_y, p);
        const Real turning = at<Real>(couple, p);
        for (Count k = 0; k < tile; ++k) {
          sum[k] += fx * load<Pack>(x + k * width) + fy * load<Pack>(y_row + k * width) +
                    turning * load<Numbers>(turned + k * step);
        }
      }
      for (Count k = 0; k < tile; ++k) store(force + i * lanes<Real> + k * width, sum[k]);
    }
  }

  /// Adds the forces of bending and of its damping.
  void elastic(const double* y) {
    for (Count i = 0; i < m; ++i) {
      const Real strain = at<Real>(y, i), rate = effects.damping * at<Real>(y, m + i);
      const double* const row = grid.elastic_forces + i * m;
      const double* const damped = grid.damped_forces + i * m;
      for (Count j = 0; j < m; ++j) add(force, j, Real(-row[j] * strain - damped[j] * rate));
    }
  }

  /// The sum of a_ij x_i x_j over all i and j.
  Real quadratic_form(const double* a, const double* x) const {
    Real sum{};
    for (Count i = 0; i < m; ++i) {
      Real row{};
      for (Count j = 0; j < m; ++j) row += a[i * m + j] * at<Real>(x, j);
      sum += at<Real>(x, i) * row;
    }
    return sum;
  }

  enum class Product { all, lower_half, added };

  /// Writes sum_k left(k, i) right(k, j) to (padded rows, stride), or adds it, in tiles that fit
  /// into registers; some rows from m on are written as well. left gives a Real, right the numbers
  /// of a vector from j on.
  template <class Left, class Right>
  void product_of(Count depth, const Left& left, const Right& right, double* to, Count stride,
                  Product kind) const {
    const auto tile = [&]<int rows, int columns>(Count i) {
      const Count end = kind == Product::lower_half ? i + rows : padded;
      for (Count j = 0; j < end; j += columns * step) {
        product_tile<rows, columns>(
            depth, [&](Count k, int r) { return left(k, i + r); },
            [&](Count k, int c) { return right(k, j + c * step); },
            [&](int r, int c, Pack sum) {
              double* const entry = to + ((i + r) * stride + j) * lanes<Real> + c * width;
              if (kind == Product::added) sum += load<Pack>(entry);
              store(entry, sum);
            });
      }
    };
    for (Count i = 0; i < m; i += 4) {
      if (i + 2 < m) {
        tile.template operator()<4, alone ? 1 : width == 8 ? 4 : 2>(i);
      } else {
        tile.template operator()<2, alone ? 1 : 4>(i);
      }
    }
  }

  /// Lower triangle of the mass matrix: the sum over points and components of w J_i J_j, and the
  /// parts of rotary inertia and of mass that moves across the pipe alone.
  void gram(Count row) {
    const auto displacements = [&](Count k) {  // rows of x and of y for each point
      return moments + (k >> 1) * row + (k & 1) * each * lanes<Real>;
    };
    product_of(
        2 * points, [&](Count k, Count i) { return at<Real>(displacements(k), i); },
        [&](Count k, Count j) {
          return grid.mass[k >> 1] * load<Pack>(displacements(k) + j * lanes<Real>);
        },
        mass, mass_stride(), Product::lower_half);
    if (grid.turning > 0) {
      const auto turning = [&](Count k) { return grid.orthonormal + grid.turning_at[k] * padded; };
      product_of(
          grid.turning,
          [&](Count k, Count i) { return all<Real>(grid.inertia[k] * turning(k)[i]); },
          [&](Count k, Count j) { return load<Numbers>(turning(k) + j); }, mass, mass_stride(),
          Product::added);
    }
    if (!across_alone) return;
    const auto normal = [&]<class Number>(Count p, Count i, const Number&) {
      const double* const x = moments + p * row + i * lanes<Real>;
      return Number(at<Real>(cosine, p) * load<Number>(x) -
                    at<Real>(sine, p) * load<Number>(x + each * lanes<Real>));
    };
    product_of(
        points, [&](Count p, Count i) { return normal(p, i, Real{}); },
        [&](Count p, Count j) {
          return Pack((grid.weight[p] * effects.normal_mass) * normal(p, j, Pack{}));
        },
        mass, mass_stride(), Product::added);
  }

  /// Replaces the lower triangle of a symmetric matrix (rows, stride) by its Cholesky factor, whose
  /// diagonal is inverted; a negative pivot leaves NaN.
  static void factorise(double* a, Count rows, Count stride) {
    for (Count i = 0; i < rows; ++i) {
      for (Count j = 0; j <= i; ++j) {
        Real sum = at<Real>(a, i * stride + j);
        for (Count k = 0; k < j; ++k) {
          sum -= at<Real>(a, i * stride + k) * at<Real>(a, j * stride + k);
        }
        set(a, i * stride + j,
            j < i ? Real(sum * at<Real>(a, j * stride + j)) : Real(1.0 / square_root(sum)));
      }
    }
  }

  /// Solves mass x = force; the Cholesky factor takes the place of the mass matrix.
  void solve(double* x) {
    factorise(mass, m, mass_stride());
    for (Count i = 0; i < m; ++i) set(x, i, at<Real>(force, i));
    solve_mass(x);
  }

  /// Point at which support b holds the pipe.
  Count support(Count b) const { return effects.held[b] * block + nodes; }

  /// Replaces x (rows) by A^-1 x, for the Cholesky factor (rows, stride) of a symmetric A whose
  /// diagonal is inverted.
  static void substitute(const double* factor, Count rows, Count stride, double* x) {
    for (Count i = 0; i < rows; ++i) {
      Real sum = at<Real>(x, i);
      for (Count j = 0; j < i; ++j) sum -= at<Real>(factor, i * stride + j) * at<Real>(x, j);
      set(x, i, Real(sum * at<Real>(factor, i * stride + i)));
    }
    for (Count i = rows - 1; i >= 0; --i) {
      const Real value = at<Real>(x, i) * at<Real>(factor, i * stride + i);
      set(x, i, value);
      for (Count j = 0; j < i; ++j) add(x, j, Real(-at<Real>(factor, i * stride + j) * value));
    }
  }

  /// Replaces x by M^-1 x, with the factor that `solve` leaves.
  void solve_mass(double* x) const { substitute(mass, m, mass_stride(), x); }

  /// Replaces the accelerations z of x at the supports by the forces that cause them, with the
  /// factor in `products`.
  void solve_supports(double* z) const { substitute(products, holds, holds, z); }

  /// Adds to accelerations the part that keeps the pipe at its supports, x'' + 2 k x' + k^2 x = 0,
  /// and to the loads the forces there. To be called after `solve`.
  void hold(const Batch& batch, Count row, double* acceleration) {
    const double k = effects.return_rate;
    for (Count b = 0; b < holds; ++b) {
      const double* const by = moments + support(b) * row;
      double* const own = response + b * m * lanes<Real>;
      const auto about_base = [&](Count column, Count of) {  // supports move with the base
        return Real(at<Real>(by, bias + column) - driven(batch, of));
      };
      Real missed =
          -(about_base(0, Drive::acceleration) +
            k * (2.0 * about_base(2, Drive::velocity) + k * about_base(4, Drive::position)));
      for (Count i = 0; i < m; ++i) {
        set(own, i, at<Real>(by, i));
        missed -= at<Real>(by, i) * at<Real>(acceleration, i);
      }
      set(reaction, b, missed);
      solve_mass(own);
      for (Count c = 0; c <= b; ++c) {
        const double* const other = moments + support(c) * row;
        Real sum{};
        for (Count i = 0; i < m; ++i) sum += at<Real>(other, i) * at<Real>(own, i);
        set(products, b * holds + c, sum);
      }
    }
    factorise(products, holds, holds);
    solve_supports(reaction);
    for (Count b = 0; b < holds; ++b) {
      const Real force_of = at<Real>(reaction, b);
      add(load_x, support(b), force_of);
      for (Count i = 0; i < m; ++i) {
        add(acceleration, i, Real(force_of * at<Real>(response, b * m + i)));
      }
    }
  }

  /// Integrals of the slopes of the basis times factor(point) from the clamp to each support; the
  /// rows of supports are `apart` numbers apart.
  template <class Factor>
  void integrate_to_supports(double* to, Count apart, const Factor& factor) const {
    Count p = 0;
    for (Count b = 0; b < holds; ++b) {
      const Count row = b * apart;
      for (Count i = 0; i < m; ++i) {
        set(to, row + i, b > 0 ? at<Real>(to, row - apart + i) : Real{});
      }
      for (; p < support(b); ++p) {
        const Real own = grid.weight[p] * factor(p);
        for (Count i = 0; i < m; ++i) add(to, row + i, Real(grid.slope[p * padded + i] * own));
      }
    }
  }

  void held(const Batch& batch, double* out) {
    angles(batch.y);
    for (Count b = 0; b < holds; ++b) {
      Real x{};
      for (Count p = 0; p < support(b); ++p) x += grid.weight[p] * at<Real>(sine, p);
      set(out, b, x);
    }
    integrate_to_supports(out + holds * lanes<Real>, m,
                          [&](Count p) { return at<Real>(cosine, p); });
  }

  /// Converts orthonormal coordinates to amplitudes in the basis, in place.
  void to_basis(double* x) const {
    for (Count i = 0; i < m; ++i) {
      Real sum{};
      for (Count j = i; j < m; ++j) sum += grid.to_basis[i * m + j] * at<Real>(x, j);
      set(x, i, sum);
    }
  }

  /// Computes all integrals in rows of this number of columns; returns the length of a row.
  Count kinematics(const Batch& batch, Count columns) {
    const Count row = row_length(columns);
    angles(batch.y);
    set_slopes(row);
    set_acceleration(row, bias);
    if (resists) set_velocity(row, bias + 2);
    integrate(grid, row, integrated * lanes<Real>, integrands, moments);
    add_base(batch, row, bias, true);
    return row;
  }

  void accelerations(const Batch& batch, double* out) {
    const Count row = kinematics(batch, integrated);
    forces(batch, row);
    gram(row);
    solve(out);
    hold(batch, row, out);
    to_basis(out);
  }

  /// Velocities, and positions if a term reads them, relative to the base.
  Count velocities(const Batch& batch) {
    const Count row = row_length(loads ? 4 : 2);
    angles(batch.y);
    for (Count i = 0; i < points * row; ++i) integrands[i] = 0.0;
    set_velocity(row, 0);
    integrate(grid, row, row, integrands, moments);
    return row;
  }

  /// Position of the free end, x then y, and its velocity.
  void tips(const Batch& batch, double* out) {
    Real found[4] = {};
    angles(batch.y);
    for (Count p = 0; p < points; ++p) {
      const Real across = grid.weight[p] * at<Real>(sine, p);
      const Real down = grid.weight[p] * at<Real>(cosine, p), w = at<Real>(omega, p);
      found[0] += across;
      found[1] += down;
      found[2] += down * w;
      found[3] -= across * w;
    }
    for (Count i = 0; i < 4; ++i) set(out, i, found[i]);
  }

  void energy(const Batch& batch, double* out) {
    const Count row = velocities(batch);
    Real twice{};
    for (Count p = 0; p < points; ++p) {
      const Real x = at<Real>(moments + p * row, 0), y = at<Real>(moments + p * row, 1);
      twice += grid.mass[p] * (x * x + y * y);
    }
    for (Count k = 0; k < grid.turning; ++k) {
      const Real rate = at<Real>(omega, grid.turning_at[k]);
      twice += grid.inertia[k] * (rate * rate);
    }
    twice += quadratic_form(grid.elastic, batch.y);
    if (across_alone) {
      for (Count p = 0; p < points; ++p) {
        const double* const v = moments + p * row;
        const Real normal =
            at<Real>(cosine, p) * at<Real>(v, 0) - at<Real>(sine, p) * at<Real>(v, 1);
        twice += (grid.weight[p] * effects.normal_mass) * (normal * normal);
      }
    }
    const double across = 2.0 * effects.gamma * effects.down[0];
    const double down = 2.0 * effects.gamma * effects.down[1];
    if (effects.gamma != 0.0) {  // s - y(s) integrated by parts, with the digits of 1 - cos theta
      for (Count p = 0; p + 1 < points; ++p) {
        const Real s = at<Real>(sine, p), c = at<Real>(cosine, p);
        const Real rise = c > 0.0 ? s * s / (1.0 + c) : 1.0 - c;
        twice += down * grid.weight[p] * grid.beyond[p] * rise;
        if (across != 0.0) twice -= across * grid.weight[p] * grid.beyond[p] * s;
      }
    }
    add_base(batch, row, 0, false);
    for_each_station(batch, row, 0, [&](const auto& law, const auto& station, Count, double w) {
      twice += (2.0 * w) * law.energy(station);
    });
    set(out, 0, Real(0.5 * twice));
  }

  void power(const Batch& batch, double* out) {
    const Count end = points - 1, row = velocities(batch);
    const Real u = load<Real>(batch.u);
    const Real x = at<Real>(moments + end * row, 0), y = at<Real>(moments + end * row, 1);
    Real pushed{}, based{};
    if (batch.drive != nullptr) {
      const Real push = unsteady(batch);
      const Real ax = driven(batch, Drive::acceleration);
      const Real ay = driven(batch, Drive::acceleration + 1);
      for (Count p = 0; p < points; ++p) {
        const Real vx = at<Real>(moments + p * row, 0), vy = at<Real>(moments + p * row, 1);
        pushed -= (grid.weight[p] * push) * (at<Real>(sine, p) * vx + at<Real>(cosine, p) * vy);
        based -= grid.mass[p] * (ax * vx + ay * vy);
        if (!across_alone) continue;
        const Real normal = at<Real>(cosine, p) * vx - at<Real>(sine, p) * vy;
        based -= (grid.weight[p] * effects.normal_mass) * normal *
                 (at<Real>(cosine, p) * ax - at<Real>(sine, p) * ay);
      }
      add_base(batch, row, 0, false);
    }
    const Real s = at<Real>(sine, end), c = at<Real>(cosine, end);
    const Real entry = effects.entry * u, own = (effects.entry - 0.5 * effects.coriolis) * u;
    const Real along = effects.thrust[0] * (u * u), across = effects.thrust[1] * (u * u);
    const Real base_x = driven(batch, Drive::velocity), base_y = driven(batch, Drive::velocity + 1);
    const Real flow = (own * x + entry * base_x - along * s - across * c) * x +
                      (own * y + entry * base_y - along * c + across * s) * y;
    const Real joints = -effects.damping * quadratic_form(grid.damped, batch.y + m * lanes<Real>);
    Real dragged{}, others{};
    if (drags) {
      drag(row, 0);
      for (Count p = 0; p < end; ++p) {
        const Real v = at<Real>(velocity, p);
        const Real force = effects.drag * at<Real>(weighted, p) * (v * v);
        dragged -= force * v;
        based += force * (base_x * at<Real>(cosine, p) - base_y * at<Real>(sine, p));
      }
    }
    for_each_station(batch, row, 0, [&](const auto& law, const auto& station, Count, double w) {
      const Acting<Real> load(law.load(station));
      others += w * power_of(law, station, load);
      if (batch.drive != nullptr) based += w * base_power(law, station, load, base_x, base_y);
    });
    const Real parts[] = {pushed + flow, joints, dragged, others, based};
    for (Count k = 0; k < 5; ++k) set(out, k, parts[k]);
  }
};

}  // namespace
