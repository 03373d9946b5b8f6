// SPDX-License-Identifier: MIT
//
// The reduced model's functions of one vector level. Compiled once for each, like chain/motion.cpp.
// One member goes through with its vectors along the pipe or the functions, a block with one member
// a lane.
#include "pipedyn/galerkin/kernel.hpp"

#include <type_traits>

#include "pipedyn/galerkin/integrals.hpp"
#include "pipedyn/galerkin/signed_weights.hpp"
#include "pipedyn/terms/laws.hpp"
#include "pipedyn/vector/pack.hpp"
#include "pipedyn/vector/scratch.hpp"

namespace {

using pipedyn::Batch, pipedyn::MotionEffects, pipedyn::PanelTerm;

// ---------------------------------------------------------------------------------------- lanes

/// Slopes of a law, in each lane of one member.
template <class Real>
struct SlopesOf {
  Real by_position[2][2], by_velocity[2][2], by_angle[2];
};

template <class Real, class Law>
SlopesOf<Real> slopes_of(const Law& law, const Station<Real>& at) {
  constexpr Count members = lanes<Real>, places = sizeof(Station<double>) / sizeof(double),
                  entries = sizeof(Slopes) / sizeof(double);
  double stations[places][members], all_slopes[entries][members];
  static_assert(sizeof stations == sizeof at && sizeof all_slopes == sizeof(SlopesOf<Real>));
  std::memcpy(stations, &at, sizeof at);
  for (Count b = 0; b < members; ++b) {
    double station[places], slopes[entries];
    for (Count k = 0; k < places; ++k) station[k] = stations[k][b];
    const Slopes found = law.slopes(same_bits<Station<double>>(station));
    std::memcpy(slopes, &found, sizeof found);
    for (Count k = 0; k < entries; ++k) all_slopes[k][b] = slopes[k];
  }
  SlopesOf<Real> result;
  std::memcpy(&result, all_slopes, sizeof result);
  return result;
}

/// Sum of what a vector holds of one member.
template <class Real>
Real sum_of(const Pack& x) {
  if constexpr (lanes<Real> == lanes<Pack>) return x;
  double each[width];
  store(each, x);
  double sum = 0.0;
  for (const double one : each) sum += one;
  return Real{} + sum;
}

// ---------------------------------------------------------------------------------------- block

/// Members side by side, as many as a Real holds, with what is computed of them.
template <class Real>
struct Block {
  static constexpr bool alone = lanes<Real> == 1;
  // What a vector of a sum holds: of one member numbers along the pipe or the functions, of several
  // members one number of each.
  using Numbers = std::conditional_t<alone, Pack, double>;
  static constexpr Count step = lanes<Numbers>;  // points or functions in a vector
  static constexpr Count tile = alone ? 1 : 4;   // vectors at a time
  const GridTables& grid;
  const MotionEffects& effects;
  const Count m = grid.functions, padded = grid.padded, nodes = grid.nodes, points = grid.points;
  const Count block = nodes + 1;  // points of a panel
  const bool drags = effects.drag != 0.0, loads = effects.load_count > 0;
  const bool resists = drags || loads;

  // The columns that are integrated: derivatives of the position by the orthonormal coordinates, x
  // then y; acceleration at q'' = 0; velocity, where drag or a term reads it; position, where a
  // term does. Energy and power take the last two alone. Derivatives of the forces by velocities
  // and, of terms, by positions follow, times the virtual displacements and each x then y.
  const Count bias = 2 * padded, resisted = bias + (loads ? 6 : drags ? 4 : 2);
  const Count held = resisted + (resists ? 2 * padded : 0), last = held + (loads ? 2 * padded : 0);
  double *theta, *omega, *sine, *cosine;  // (points), of a single member (stride)
  double *integrands, *moments;           // rows of columns, and their integrals from the clamp
  double *mass, *force;
  double *velocity, *weighted, *load_x, *load_y, *rest;  // (points); rest 3 Q
  double *own, *acceleration, *spin, *beyond;        // q'' in both bases; theta''; a row of columns
  double *by_angle, *by_rate, *system, *resistance;  // of `linearise`

  static Count row_length(Count columns) { return whole_packs(columns * lanes<Real>); }
  /// Of a row of the mass matrix: single rows are written by whole packs.
  Count mass_stride() const { return alone ? whole_packs(padded) : padded; }

  Block(const GridTables& tables, const MotionEffects& present, bool derivatives = false)
      : grid(tables), effects(present) {
    lay_out(pipedyn::scratch(lay_out(nullptr, derivatives)), derivatives);
  }

  /// Numbers used; without scratch it only counts them.
  Count lay_out(double* scratch, bool derivatives) {
    Count used = 0;
    const auto take = [scratch, &used](Count reals) {
      double* const start = scratch == nullptr ? nullptr : scratch + used;
      used += (reals * lanes<Real> + 7) / 8 * 8;
      return start;
    };
    const Count columns = derivatives ? last : bias + 6;
    const Count rows = points * row_length(columns) / lanes<Real> + 1;
    theta = take(grid.stride);
    omega = take(grid.stride);
    sine = take(grid.stride);
    cosine = take(grid.stride);
    integrands = take(rows);
    moments = take(rows);
    mass = take(padded * mass_stride());
    force = take(padded);
    velocity = take(points);
    weighted = take(points);
    load_x = take(points);
    load_y = take(points);
    rest = take(3 * nodes);
    if (!derivatives) return used;
    own = take(mass_stride());
    acceleration = take(m);
    spin = take(grid.stride);
    beyond = take(row_length(columns));
    by_angle = take(points * mass_stride());
    by_rate = take(points * mass_stride());
    system = take(padded * 2 * mass_stride());
    resistance = take(padded * mass_stride());
    return used;
  }

  /// sum_i x_i Theta_i along the pipe, of each x (m,) in the basis.
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

  /// To be integrated: n Theta_i.
  void set_slopes(Count row) {
    for (Count p = 0; p < points; ++p) {
      const Real c = at<Real>(cosine, p), s = at<Real>(sine, p);
      const double* __restrict const slope = grid.orthonormal + p * padded;
      double* __restrict const to = integrands + p * row;
      for (Count i = 0; i < padded; ++i) {
        set(to, i, Real(slope[i] * c));
        set(to, padded + i, Real(-slope[i] * s));
      }
    }
  }

  /// From column on: the velocity's integrand, n theta', and where a term reads it the position's,
  /// t.
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

  /// That of the acceleration at q'' = 0, -t theta'^2.
  void set_acceleration(Count row, Count column) {
    for (Count p = 0; p < points; ++p) {
      const Real w = at<Real>(omega, p), square = w * w;
      double* const to = integrands + p * row + column * lanes<Real>;
      set(to, 0, Real(-at<Real>(sine, p) * square));
      set(to, 1, Real(-at<Real>(cosine, p) * square));
    }
  }

  /// v_n and the signed weights of the nodes.
  void drag(Count row, Count column) {
    for (Count p = 0; p < points; ++p) {
      const double* const v = moments + p * row + column * lanes<Real>;
      set(velocity, p,
          Real(at<Real>(cosine, p) * at<Real>(v, 0) - at<Real>(sine, p) * at<Real>(v, 1)));
    }
    signed_weights_of<Real>(grid, velocity, weighted, rest);
  }

  /// Calls body(law, station, point, weight) wherever a term acts; column: the velocity's.
  template <class Body>
  void for_each_station(Count row, Count column, const Body& body) const {
    const auto station = [&](Count p) {
      const double* const v = moments + p * row + column * lanes<Real>;
      return Station<Real>{at<Real>(v, 2), at<Real>(v, 3), at<Real>(sine, p), at<Real>(cosine, p),
                           at<Real>(v, 0), at<Real>(v, 1), at<Real>(omega, p)};
    };
    for (Count k = 0; k < effects.load_count; ++k) {
      const PanelTerm& placed = effects.loads[k];
      Laws::with(placed.term, [&]<class Law>(const Law& law) {
        if constexpr (Law::loads) {
          if (placed.panel >= 0) {
            const Count end = placed.panel * block + nodes;
            body(law, station(end), end, 1.0);
            return;
          }
          for (Count p = 0; p < points; ++p) {
            if (grid.weight[p] != 0.0) body(law, station(p), p, grid.weight[p]);
          }
        }
      });
    }
  }

  /// All generalised forces but inertia's that is linear in q'', by orthonormal coordinates.
  void forces(const double* y, const Real& u, Count row) {
    bool flows = false;
    double speeds[lanes<Real>];
    store(speeds, u);
    for (const double speed : speeds) flows |= speed != 0.0;
    const Real coriolis = effects.coriolis * u;
    if (drags) drag(row, bias + 2);
    for (Count p = 0; p < points; ++p) {
      const double* const bent = moments + p * row + bias * lanes<Real>;
      const double mass_of = grid.mass[p];  // inertia and weight
      Real x = -mass_of * at<Real>(bent, 0), y_load = mass_of * (effects.gamma - at<Real>(bent, 1));
      if (flows || drags) {
        Real across{};
        if (flows) across = grid.weight[p] * coriolis * at<Real>(omega, p);
        if (drags) {
          const Real v = at<Real>(velocity, p);
          across += effects.drag * at<Real>(weighted, p) * (v * v);
        }
        x -= across * at<Real>(cosine, p);
        y_load += across * at<Real>(sine, p);
      }
      set(load_x, p, x);
      set(load_y, p, y_load);
    }
    if (flows) {  // the follower force
      const Real thrust = effects.centrifugal * (u * u);
      add(load_x, points - 1, Real(-thrust * at<Real>(sine, points - 1)));
      add(load_y, points - 1, Real(-thrust * at<Real>(cosine, points - 1)));
    }
    for_each_station(row, bias + 2, [&](const auto& law, const auto& station, Count p, double w) {
      const auto load = law.load(station);
      add(load_x, p, Real(w * load.x));
      add(load_y, p, Real(w * load.y));
    });
    for (Count i = 0; i < padded; i += tile * step) {
      Pack sum[tile] = {};
      for (Count p = 0; p < points; ++p) {
        const double* const x = moments + p * row + i * lanes<Real>;
        const double* const y_row = x + padded * lanes<Real>;
        const Real fx = at<Real>(load_x, p), fy = at<Real>(load_y, p);
        for (Count k = 0; k < tile; ++k) {
          sum[k] += fx * load<Pack>(x + k * width) + fy * load<Pack>(y_row + k * width);
        }
      }
      for (Count k = 0; k < tile; ++k) store(force + i * lanes<Real> + k * width, sum[k]);
    }
    elastic(y);
  }

  void elastic(const double* y) {
    for (Count i = 0; i < m; ++i) {
      Real strain = at<Real>(y, i);
      if (effects.damping != 0.0) strain += effects.damping * at<Real>(y, m + i);
      const Real moment_of = grid.stiffness[i] * strain;
      if (grid.to_basis == nullptr) {
        add(force, i, Real(-moment_of));
        continue;
      }
      for (Count j = i; j < m; ++j) add(force, j, Real(-grid.to_basis[i * m + j] * moment_of));
    }
  }

  enum class Product { all, lower_half, added };

  /// Writes sum_k left(k, i) right(k, j) to (padded rows, stride), in tiles that are in registers,
  /// or adds it. left gives a Real, right the numbers of a vector from j on.
  template <class Left, class Right>
  void product_of(Count depth, const Left& left, const Right& right, double* to, Count stride,
                  Product kind) const {
    constexpr Count rows = 4, columns = alone ? 1 : width == 8 ? 4 : 2;
    for (Count i = 0; i < padded; i += rows) {
      for (Count j = 0; j < (kind == Product::lower_half ? i + rows : padded);
           j += columns * step) {
        Pack sum[rows][columns] = {};
#pragma GCC unroll 2
        for (Count k = 0; k < depth; ++k) {
          decltype(right(k, j)) others[columns];
          for (Count c = 0; c < columns; ++c) others[c] = right(k, j + c * step);
          for (Count r = 0; r < rows; ++r) {
            const Real value = left(k, i + r);
            for (Count c = 0; c < columns; ++c) sum[r][c] += value * others[c];
          }
        }
        for (Count r = 0; r < rows; ++r) {
          double* const entries = to + ((i + r) * stride + j) * lanes<Real>;
          for (Count c = 0; c < columns; ++c) {
            if (kind == Product::added) sum[r][c] += load<Pack>(entries + c * width);
            store(entries + c * width, sum[r][c]);
          }
        }
      }
    }
  }

  /// Lower triangle of the mass matrix: sum over points and components of w J_i J_j.
  void gram(Count row) {
    const auto displacements = [&](Count k) {  // x and y at each point
      return moments + (k >> 1) * row + (k & 1) * padded * lanes<Real>;
    };
    product_of(
        2 * grid.heavy, [&](Count k, Count i) { return at<Real>(displacements(k), i); },
        [&](Count k, Count j) {
          return grid.mass[k >> 1] * load<Pack>(displacements(k) + j * lanes<Real>);
        },
        mass, mass_stride(), Product::lower_half);
  }

  /// mass x = force by Cholesky's factors, in place; a negative pivot leaves NaN.
  void solve(double* x) {
    const Count stride = mass_stride();
    for (Count i = 0; i < m; ++i) {
      Real remaining = at<Real>(force, i);
      for (Count j = 0; j <= i; ++j) {
        Real sum = at<Real>(mass, i * stride + j);
        for (Count k = 0; k < j; ++k) {
          sum -= at<Real>(mass, i * stride + k) * at<Real>(mass, j * stride + k);
        }
        if (j < i) {
          const Real entry = sum * at<Real>(mass, j * stride + j);
          set(mass, i * stride + j, entry);
          remaining -= entry * at<Real>(x, j);
        } else {
          const Real inverse = 1.0 / square_root(sum);
          set(mass, i * stride + i, inverse);
          set(x, i, Real(remaining * inverse));
        }
      }
    }
    for (Count i = m - 1; i >= 0; --i) {
      const Real value = at<Real>(x, i) * at<Real>(mass, i * stride + i);
      set(x, i, value);
      for (Count j = 0; j < i; ++j) add(x, j, Real(-at<Real>(mass, i * stride + j) * value));
    }
  }

  /// From orthonormal coordinates to the basis, in place.
  void to_basis(double* x) const {
    if (grid.to_basis == nullptr) return;
    for (Count i = 0; i < m; ++i) {
      Real sum{};
      for (Count j = i; j < m; ++j) sum += grid.to_basis[i * m + j] * at<Real>(x, j);
      set(x, i, sum);
    }
  }

  /// All that is integrated, in rows of so many columns; returns their length.
  Count kinematics(const Batch& batch, Count columns) {
    const Count row = row_length(columns);
    angles(batch.y);
    set_slopes(row);
    set_acceleration(row, bias);
    if (resists) set_velocity(row, bias + 2);
    integrate(grid, row, resisted * lanes<Real>, integrands, moments);
    return row;
  }

  void accelerations(const Batch& batch, double* out) {
    const Count row = kinematics(batch, resisted);
    forces(batch.y, load<Real>(batch.u), row);
    gram(row);
    solve(out);
    to_basis(out);
  }

  /// Velocities, and positions where a term reads them.
  Count velocities(const Batch& batch) {
    const Count row = row_length(loads ? 4 : 2);
    angles(batch.y);
    for (Count i = 0; i < points * row; ++i) integrands[i] = 0.0;
    set_velocity(row, 0);
    integrate(grid, row, row, integrands, moments);
    return row;
  }

  Real energy(const Batch& batch) {
    const Count row = velocities(batch);
    Real twice{};
    for (Count p = 0; p < grid.heavy; ++p) {
      const Real x = at<Real>(moments + p * row, 0), y = at<Real>(moments + p * row, 1);
      twice += grid.mass[p] * (x * x + y * y);
    }
    for (Count i = 0; i < m; ++i) {
      const Real amplitude = at<Real>(batch.y, i);
      twice += grid.stiffness[i] * (amplitude * amplitude);
    }
    if (effects.gamma != 0.0) {  // s - y(s) integrated by parts, with the digits of 1 - cos theta
      for (Count p = 0; p + 1 < points; ++p) {
        const Real s = at<Real>(sine, p), c = at<Real>(cosine, p);
        const Real rise = c > 0.0 ? s * s / (1.0 + c) : 1.0 - c;
        twice += 2.0 * effects.gamma * grid.weight[p] * grid.beyond[p] * rise;
      }
    }
    for_each_station(row, 0, [&](const auto& law, const auto& station, Count, double w) {
      twice += (2.0 * w) * law.energy(station);
    });
    return 0.5 * twice;
  }

  void power(const Batch& batch, double* out) {
    const Count row = velocities(batch), end = points - 1;
    const Real u = load<Real>(batch.u);
    const Real x = at<Real>(moments + end * row, 0), y = at<Real>(moments + end * row, 1);
    const Real along = at<Real>(sine, end) * x + at<Real>(cosine, end) * y;
    const Real flux = 0.5 * effects.coriolis * u, thrust = effects.centrifugal * (u * u);
    Real joints{}, dragged{}, others{};
    if (effects.damping != 0.0) {
      for (Count i = 0; i < m; ++i) {
        const Real rate = at<Real>(batch.y, m + i);
        joints -= effects.damping * grid.stiffness[i] * (rate * rate);
      }
    }
    if (drags) {
      drag(row, 0);
      for (Count p = 0; p < end; ++p) {
        const Real v = at<Real>(velocity, p);
        dragged -= effects.drag * at<Real>(weighted, p) * (v * v * v);
      }
    }
    for_each_station(row, 0, [&](const auto& law, const auto& station, Count, double w) {
      others += w * law.power(station);
    });
    set(out, 0, Real(-flux * (x * x + y * y) - thrust * along));
    set(out, 1, joints);
    set(out, 2, dragged);
    set(out, 3, others);
  }

  // ------------------------------------------------------------------------------- derivatives

  /// What integrals of loads count of a point, in the pipe's mass per length.
  double unit(Count p) const {
    return grid.weight[p] != 0.0 ? grid.mass[p] : grid.mass[0] / grid.weight[0];
  }

  /// Loads of all points in their units, to be integrated in place of the acceleration at q'' = 0,
  /// and what resists or holds there.
  void set_loads(Count row) {
    for (Count p = 0; p < points; ++p) {
      double* const x = moments + p * row;
      double* const y = x + padded * lanes<Real>;
      Pack sums[2] = {};
      for (Count i = 0; i < padded; i += step) {
        const Pack factor = load<Pack>(own + i * lanes<Real>);
        sums[0] += factor * load<Pack>(x + i * lanes<Real>);
        sums[1] += factor * load<Pack>(y + i * lanes<Real>);
      }
      const double share = 1.0 / unit(p);
      set(x, bias, Real(share * (grid.mass[p] * sum_of<Real>(sums[0]) - at<Real>(load_x, p))));
      set(x, bias + 1, Real(share * (grid.mass[p] * sum_of<Real>(sums[1]) - at<Real>(load_y, p))));
      for (Count k = resisted; k < last; ++k) set(x, k, Real{});
      if (!drags) continue;
      const Real c = at<Real>(cosine, p), s = at<Real>(sine, p);
      const Real by_normal = share * dragged(p);
      for (Count i = 0; i < padded; ++i) {
        const Real by_i = by_normal * (at<Real>(x, i) * c - at<Real>(y, i) * s);
        set(x, resisted + i, Real(by_i * c));
        set(x, resisted + padded + i, Real(-by_i * s));
      }
    }
  }

  /// Derivative of drag on a point by v_n.
  Real dragged(Count p) const {
    return (2.0 * effects.drag) * at<Real>(weighted, p) * at<Real>(velocity, p);
  }

  void add_slopes_of_terms(Count row) {
    for_each_station(row, bias + 2, [&](const auto& law, const auto& station, Count p, double w) {
      double* const x = moments + p * row;
      double* const y = x + padded * lanes<Real>;
      const SlopesOf<Real> slopes = slopes_of(law, station);
      const double share = -w / unit(p);
      for (Count i = 0; i < padded; ++i) {
        const Real by_x = at<Real>(x, i), by_y = at<Real>(y, i);
        const auto times = [&](const Real& a, const Real& b) { return Real(a * by_x + b * by_y); };
        for (Count c = 0; c < 2; ++c) {
          add(x, resisted + c * padded + i,
              Real(share * times(slopes.by_velocity[0][c], slopes.by_velocity[1][c])));
          add(x, held + c * padded + i,
              Real(w * times(slopes.by_position[0][c], slopes.by_position[1][c])));
        }
        add(by_angle, p * mass_stride() + i,
            Real(w * times(slopes.by_angle[0], slopes.by_angle[1])));
      }
    });
  }

  /// Derivatives of all forces but bending's, inertia's at fixed q'', by q, then by q' of the
  /// basis: system (padded, 2 strides), rows by orthonormal coordinates. After `forces` and with
  /// q'' in `own` and `spin`. The loads beyond a node act on what it moves: the quadrature's
  /// integration by parts, S^T W = w w^T - W S, gives those of the nodes.
  void linearise(const Real& u, Count row) {
    const Count stride = mass_stride(), end = points - 1;
    const Real coriolis = effects.coriolis * u, thrust = effects.centrifugal * (u * u);
    if (loads) {
      for (Count k = 0; k < points * stride; ++k) set(by_angle, k, Real{});
    }
    set_loads(row);
    if (loads) add_slopes_of_terms(row);
    integrate(grid, row, held * lanes<Real>, moments, integrands);
    for (Count k = 0; k < held; ++k) set(beyond, k, at<Real>(integrands + end * row, k));
    for (Count p = end; p >= 0; --p) {
      const double* const x = moments + p * row;
      const double* const y = x + padded * lanes<Real>;
      const double* const before = integrands + p * row;
      double factor = grid.mass[p];
      if (grid.weight[p] == 0.0) {
        const double jump = factor / unit(p);
        for (Count k = 0; k < bias; ++k) add(beyond, k, Real(jump * at<Real>(x, k)));
        for (Count k = bias; k < held; ++k) add(beyond, k, at<Real>(x, k));
        factor = 0.0;
      }
      const auto beyond_of = [&](Count k) {
        const Pack rest_of = load<Pack>(beyond + k * lanes<Real>);
        return Pack(factor * (rest_of - load<Pack>(before + k * lanes<Real>)));
      };
      const auto load_beyond = [&](Count k) {
        return Real(factor * (at<Real>(beyond, k) - at<Real>(before, k)));
      };
      const Real c = at<Real>(cosine, p), s = at<Real>(sine, p), w = at<Real>(omega, p);
      const Real turning = at<Real>(spin, p), square = w * w;
      const Real bent = s * load_beyond(bias) + c * load_beyond(bias + 1);
      const Real flow = grid.weight[p] * coriolis;
      Real forward = flow * w;  // load across the pipe, turned along it
      Real sideways = p == end ? Real(-thrust) : Real{};
      if (drags) {
        const Real v = at<Real>(velocity, p);
        forward += effects.drag * at<Real>(weighted, p) * (v * v);
        sideways += dragged(p) * (s * at<Real>(x, bias + 2) + c * at<Real>(x, bias + 3));
      }
      for (Count i = 0; i < padded; i += step) {
        const Pack by_x = load<Pack>(x + i * lanes<Real>), by_y = load<Pack>(y + i * lanes<Real>);
        const Pack beyond_x = beyond_of(i), beyond_y = beyond_of(padded + i);
        const Pack beyond_t = beyond_x * s + beyond_y * c, beyond_n = beyond_x * c - beyond_y * s;
        const Pack normal = by_x * c - by_y * s;
        Pack angle = load<Numbers>(grid.orthonormal + p * padded + i) * bent + normal * sideways +
                     (by_x * s + by_y * c) * forward + beyond_t * turning + beyond_n * square;
        if (resists) {
          angle += beyond_of(resisted + i) * (s * w) + beyond_of(resisted + padded + i) * (c * w);
        }
        double* const to = by_angle + (p * stride + i) * lanes<Real>;
        if (loads) angle += load<Pack>(to);
        store(to, angle);
        store(by_rate + (p * stride + i) * lanes<Real>, Pack(beyond_t * (2.0 * w) - normal * flow));
      }
    }
    const auto by_slopes = [&](const double* left, double* to) {
      product_of(
          points, [&](Count p, Count i) { return at<Real>(left, p * stride + i); },
          [&](Count p, Count j) { return load<Numbers>(grid.slope + p * padded + j); }, to,
          2 * stride, Product::all);
    };
    by_slopes(by_angle, system);
    by_slopes(by_rate, system + stride * lanes<Real>);
    if (loads) add_moved(row, held, [](Count) { return 1.0; }, system);
    if (resists) {
      add_moved(row, resisted, [&](Count p) { return -unit(p); }, system + stride * lanes<Real>);
    }
  }

  /// Adds the sum over points of scale times the columns from first on by the displacements.
  template <class Scale>
  void add_moved(Count row, Count first, const Scale& scale, double* to) {
    const Count stride = mass_stride();
    const auto component = [&](Count k) {
      return moments + (k >> 1) * row + (k & 1) * padded * lanes<Real>;
    };
    const bool direct = grid.from_basis == nullptr;
    product_of(
        2 * points,
        [&](Count k, Count i) { return Real(scale(k >> 1) * at<Real>(component(k), first + i)); },
        [&](Count k, Count j) { return load<Pack>(component(k) + j * lanes<Real>); },
        direct ? to : resistance, direct ? 2 * stride : stride,
        direct ? Product::added : Product::all);
    if (direct) return;
    product_of(
        m, [&](Count k, Count i) { return at<Real>(resistance, i * stride + k); },
        [&](Count k, Count j) { return load<Numbers>(grid.from_basis + k * padded + j); }, to,
        2 * stride, Product::added);
  }

  /// The system's columns to q''s, in the basis: M^-1 by the factors that `solve` leaves.
  void solve_system() {
    constexpr Count columns = alone ? 2 : 8;  // vectors at a time
    const Count stride = mass_stride(), whole = 2 * stride;
    for (Count j = 0; j < whole; j += columns * step) {
      Pack sum[columns];
      const auto each = [&](Count i, const auto& body) {
        double* const entries = system + (i * whole + j) * lanes<Real>;
        for (Count c = 0; c < columns; ++c) body(entries + c * width, sum[c]);
      };
      const auto take = [](double* entry, Pack& x) { x = load<Pack>(entry); };
      const auto subtract = [&](Count i, const Real& factor) {
        each(i, [&](double* entry, Pack& x) { x -= factor * load<Pack>(entry); });
      };
      const auto put = [&](Count i, const Real& factor) {
        each(i, [&](double* entry, Pack& x) { store(entry, Pack(factor * x)); });
      };
      for (Count i = 0; i < m; ++i) {
        each(i, take);
        for (Count k = 0; k < i; ++k) subtract(k, at<Real>(mass, i * stride + k));
        put(i, at<Real>(mass, i * stride + i));
      }
      for (Count i = m - 1; i >= 0; --i) {
        each(i, take);
        for (Count k = i + 1; k < m; ++k) subtract(k, at<Real>(mass, k * stride + i));
        put(i, at<Real>(mass, i * stride + i));
      }
      if (grid.to_basis == nullptr) continue;
      for (Count i = 0; i < m; ++i) {
        for (Pack& x : sum) x = Pack{};
        for (Count k = i; k < m; ++k) subtract(k, all<Real>(-grid.to_basis[i * m + k]));
        put(i, all<Real>(1.0));
      }
    }
  }

  /// The members' system, (m, 2 m) of each.
  void write_system(double* out) const {
    const Count stride = mass_stride();
    for (Count i = 0; i < m; ++i) {
      for (Count half = 0; half < 2; ++half) {
        for (Count j = 0; j < m; ++j) {
          set(out, (2 * i + half) * m + j, at<Real>(system, (2 * i + half) * stride + j));
        }
      }
    }
  }

  void jacobian(const Batch& batch, double* out) {
    const Count row = kinematics(batch, last), stride = mass_stride();
    const Real u = load<Real>(batch.u);
    forces(batch.y, u, row);
    gram(row);
    for (Count i = 0; i < stride; ++i) set(own, i, Real{});
    solve(own);
    for (Count i = 0; i < m; ++i) set(acceleration, i, at<Real>(own, i));
    to_basis(acceleration);
    along<1>({acceleration}, {spin});
    linearise(u, row);
    for (Count j = 0; j < m; ++j) {
      const Count most = grid.to_basis == nullptr ? j + 1 : m;
      for (Count i = j; i < most; ++i) {
        const double elastic =
            grid.stiffness[j] * (grid.to_basis == nullptr ? 1.0 : grid.to_basis[j * m + i]);
        add(system, 2 * i * stride + j, all<Real>(-elastic));
        add(system, (2 * i + 1) * stride + j, all<Real>(-effects.damping * elastic));
      }
    }
    solve_system();
    write_system(out);
  }

  /// Of a state at rest: see GalerkinKernel.
  void operators(const Batch& batch, const double* displacements, double* out) {
    const Count row = kinematics(batch, last), stride = mass_stride();
    if (displacements != nullptr) {
      for (Count p = 0; p < points; ++p) {
        for (Count i = 0; i < m; ++i) set(moments + p * row, i, displacements[p * m + i]);
      }
    }
    forces(batch.y, load<Real>(batch.u), row);
    gram(row);
    for (Count i = 0; i < m; ++i) {
      for (Count j = 0; j < m; ++j) {
        out[i * m + j] = mass[i < j ? j * stride + i : i * stride + j];
      }
    }
    for (Count i = 0; i < stride; ++i) own[i] = 0.0;
    for (Count p = 0; p < points; ++p) spin[p] = 0.0;
    linearise(load<Real>(batch.u), row);
    write_system(out + m * m);
    const double* const end = moments + (points - 1) * row;
    for (Count i = 0; i < m; ++i) {
      out[3 * m * m + i] = end[i];
      out[3 * m * m + m + i] = end[padded + i];
    }
  }
};

// ---------------------------------------------------------------------------------------- entry

/// Calls body with the block of a batch, one member or as many as a pack holds.
template <class Body>
void with_block(const GridTables& grid, const MotionEffects& effects, const Batch& batch,
                bool derivatives, const Body& body) {
  if (batch.members == 1) {
    body(Block<double>(grid, effects, derivatives));
  } else {
    body(Block<Pack>(grid, effects, derivatives));
  }
}

void accelerations(const GridTables& grid, const MotionEffects& effects, const Batch& batch,
                   double* out) {
  with_block(grid, effects, batch, false, [&](auto&& block) { block.accelerations(batch, out); });
}

void jacobian(const GridTables& grid, const MotionEffects& effects, const Batch& batch,
              double* out) {
  with_block(grid, effects, batch, true, [&](auto&& block) { block.jacobian(batch, out); });
}

void operators(const GridTables& grid, const MotionEffects& effects, const Batch& batch,
               const double* displacements, double* out) {
  Block<double>(grid, effects, true).operators(batch, displacements, out);
}

void energy(const GridTables& grid, const MotionEffects& effects, const Batch& batch, double* out) {
  with_block(grid, effects, batch, false, [&](auto&& block) { store(out, block.energy(batch)); });
}

void power(const GridTables& grid, const MotionEffects& effects, const Batch& batch, double* out) {
  with_block(grid, effects, batch, false, [&](auto&& block) { block.power(batch, out); });
}

}  // namespace

namespace pipedyn {

const GalerkinKernel PIPEDYN_NAMED(galerkin) = {
    .accelerations = ::accelerations,
    .energy = ::energy,
    .power = ::power,
    .jacobian = ::jacobian,
    .operators = ::operators,
};

}  // namespace pipedyn
