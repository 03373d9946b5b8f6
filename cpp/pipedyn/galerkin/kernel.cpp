// SPDX-License-Identifier: MIT
//
// The reduced model's functions of one vector level. Compiled once for each, like motion.cpp. One
// member goes through with its vectors along the pipe or the functions, a block with one member a
// lane.
#include "pipedyn/galerkin/kernel.hpp"

#include "pipedyn/vector/pack.hpp"

namespace {

using pipedyn::Batch, pipedyn::GridTables, pipedyn::MotionEffects, pipedyn::PowerParts;

template <class Real>
inline Real at(const double* array, Count i) {
  return load<Real>(array + i * lanes<Real>);
}

template <class Real>
inline void set(double* array, Count i, const Real& x) {
  store(array + i * lanes<Real>, x);
}

template <class Real>
inline void add(double* array, Count i, const Real& x) {
  store(array + i * lanes<Real>, at<Real>(array, i) + x);
}

template <class Real>
inline Real square_root(const Real& x) {
  double each[lanes<Real>];
  store(each, x);
  for (double& lane : each) lane = std::sqrt(lane);
  return load<Real>(each);
}

// ------------------------------------------------------------------------------------- products

/// Some rows and packs of out = a x.
template <int rows, int packs>
inline void product_tile(Count depth, const double* a, const double* x, Count row_length,
                         double* out) {
  Pack sum[rows][packs] = {};
  for (Count k = 0; k < depth; ++k, x += row_length) {
    Pack values[packs];
    for (int c = 0; c < packs; ++c) values[c] = load<Pack>(x + c * width);
    for (int r = 0; r < rows; ++r) {
      const double factor = a[r * depth + k];
      for (int c = 0; c < packs; ++c) sum[r][c] += factor * values[c];
    }
  }
  for (int r = 0; r < rows; ++r) {
    for (int c = 0; c < packs; ++c) store(out + r * row_length + c * width, sum[r][c]);
  }
}

template <int packs>
inline void product_columns(Count size, const double* a, const double* x, Count row_length,
                            double* out) {
  Count r = 0;
  for (; r + 4 <= size; r += 4) {
    product_tile<4, packs>(size, a + r * size, x, row_length, out + r * row_length);
  }
  for (; r < size; r += 2) {
    product_tile<2, packs>(size, a + r * size, x, row_length, out + r * row_length);
  }
}

/// out = a x with a (size, size), x (size, row_length); size even, rows of whole packs.
void product(Count size, const double* a, const double* x, Count row_length, double* out) {
  const Count all_packs = row_length / width;
  for (Count c = 0; c < all_packs;) {
    const Count left = all_packs - c;
    const double* const from = x + c * width;
    double* const to = out + c * width;
    if (left == 1) {
      product_columns<1>(size, a, from, row_length, to);
      c += 1;
    } else if (left == 2 || left == 4) {
      product_columns<2>(size, a, from, row_length, to);
      c += 2;
    } else {
      product_columns<3>(size, a, from, row_length, to);
      c += 3;
    }
  }
}

/// From sums and differences (both in sums) to the integrals' halves: see GridTables.
void integrate_folded(const GridTables& grid, Count row, double* sums, double* moments) {
  const Count half = (grid.nodes + 1) / 2, middle = half - 1;
  double* const differences = sums + half * row;
  const double* const half_of_all = moments + (2 * half - 1) * row;
  product(half, grid.from_sums, sums, row, moments + half * row);
  for (Count i = 0; i < row; ++i) differences[middle * row + i] = half_of_all[i];
  product(half, grid.from_differences, differences, row, moments);
}

Count integrals_scratch_size(const GridTables& grid, Count columns) {
  return 2 * (grid.nodes + 1) * whole_packs(columns);
}

void integrate(const GridTables& grid, const double* f, Count columns, double* out,
               double* scratch) {
  const Count nodes = grid.nodes, points = nodes + 1, half = points / 2, middle = half - 1;
  const Count row = whole_packs(columns);
  double* const moments = scratch + points * row;
  for (Count p = 0; p < half; ++p) {
    const double* __restrict const here = f + p * columns;
    const double* __restrict const mirrored = f + (nodes - 1 - p) * columns;
    double* __restrict const sum = scratch + p * row;
    double* __restrict const difference = scratch + (half + p) * row;
    const double share = p < middle ? 1.0 : 0.5;  // the middle one is its own mirror
    for (Count i = 0; i < columns; ++i) {
      sum[i] = share * (here[i] + mirrored[i]);
      difference[i] = here[i] - mirrored[i];
    }
    for (Count i = columns; i < row; ++i) sum[i] = difference[i] = 0.0;
  }
  integrate_folded(grid, row, scratch, moments);
  for (Count p = 0; p < half; ++p) {
    const double* __restrict const even = moments + p * row;
    const double* __restrict const odd = moments + (half + p) * row;
    double* __restrict const here = out + p * columns;
    double* __restrict const mirrored = out + (nodes - 1 - p) * columns;
    double* __restrict const end = out + nodes * columns;
    if (p < middle) {
      for (Count i = 0; i < columns; ++i) {
        here[i] = even[i] + odd[i];
        mirrored[i] = even[i] - odd[i];
      }
    } else {
      for (Count i = 0; i < columns; ++i) {
        here[i] = even[i];
        end[i] = 2.0 * odd[i];
      }
    }
  }
}

// -------------------------------------------------------------------------------- drag's weights

/// Zero of the cubic through (x[k], v[k]), k < 4, between low and high, where it changes sign.
double cubic_zero(const double* x, const double* v, Count stride, double low, double high) {
  double d[4] = {v[0], v[stride], v[2 * stride], v[3 * stride]};
  for (int order = 1; order < 4; ++order) {
    for (int k = 3; k >= order; --k) d[k] = (d[k] - d[k - 1]) / (x[k] - x[k - order]);
  }
  const auto value = [&](double s) {
    return d[0] + (s - x[0]) * (d[1] + (s - x[1]) * (d[2] + (s - x[2]) * d[3]));
  };
  double at_low = value(low), at_high = value(high);
  double zero = low;
  for (int step = 0; step < 12 && high - low > 1e-9; ++step) {  // false position, Illinois variant
    zero = (low * at_high - high * at_low) / (at_high - at_low);
    const double here = value(zero);
    if (std::fabs(here) <= 1e-9 * std::fabs(at_high - at_low)) break;
    if ((here > 0.0) == (at_high > 0.0)) {
      high = zero;
      at_high = here;
      at_low *= 0.5;
    } else {
      low = zero;
      at_low = here;
      at_high *= 0.5;
    }
  }
  return zero;
}

/// scratch: 3 Q Reals. From a zero on, twice the integral up to it less twice the whole turns the
/// sign; the zeros of all members are turned together, the first of each and so on.
template <class Real>
void signed_weights_of(const GridTables& grid, const double* v, double* weights, double* scratch) {
  constexpr Count members = lanes<Real>;
  const Count nodes = grid.nodes;
  double* const zero = scratch;
  double* const twice = zero + nodes * members;  // twice the sign before each zero
  double* const turned = twice + nodes * members;
  double last[members];
  Count most = 0, found[members];
  for (Count b = 0; b < members; ++b) {
    double sign = v[b] < 0.0 ? -1.0 : 1.0;
    Count count = 0;
    for (Count p = 0; p < nodes; ++p) {
      if (!(sign * v[(p + 1) * members + b] < 0.0)) continue;
      const Count last_first = nodes - 3, near = p > 0 ? p - 1 : 0;
      const Count first = near < last_first ? near : last_first;
      zero[count * members + b] = cubic_zero(grid.arc + first, v + first * members + b, members,
                                             grid.arc[p], grid.arc[p + 1]);
      twice[count * members + b] = 2.0 * sign;
      sign = -sign;
      ++count;
    }
    last[b] = sign;
    found[b] = count;
    most = count > most ? count : most;
  }
  const Real sign = load<Real>(last);
  if (most == 0) {
    for (Count p = 0; p < nodes; ++p) set(weights, p, Real(sign * grid.weight[p]));
    return;
  }
  for (Count b = 0; b < members; ++b) {
    for (Count k = found[b]; k < most; ++k) zero[k * members + b] = twice[k * members + b] = 0.0;
  }
  for (Count k = 0; k < nodes; ++k) set(turned, k, Real{});
  for (Count j = 0; j < most; ++j) {
    const Real x = 2.0 * at<Real>(zero, j) - 1.0, factor = at<Real>(twice, j);
    Real before = all<Real>(1.0), value = x;  // P_{k-1}, P_k
    add(turned, 0, Real(factor * at<Real>(zero, j)));
    for (Count k = 1; k < nodes; ++k) {
      const double* const step = grid.recurrence + 3 * k;
      const Real next = step[0] * (x * value) - step[1] * before;
      add(turned, k, Real((step[2] * factor) * (next - before)));
      before = value;
      value = next;
    }
  }
  if constexpr (members == 1) {
    for (Count p = 0; p < nodes; ++p) weights[p] = sign * grid.weight[p];
    for (Count k = 0; k < nodes; ++k) {
      const double factor = turned[k];
      const double* const row = grid.expansion + k * grid.stride;
      for (Count p = 0; p < nodes; ++p) weights[p] += factor * row[p];
    }
  } else {
    for (Count p = 0; p < nodes; ++p) {
      Real sums[4] = {sign * grid.weight[p]};
      Count k = 0;
      const double* const column = grid.expansion + p;
      for (; k + 4 <= nodes; k += 4) {
        for (Count i = 0; i < 4; ++i) {
          sums[i] += column[(k + i) * grid.stride] * at<Real>(turned, k + i);
        }
      }
      for (; k < nodes; ++k) sums[0] += column[k * grid.stride] * at<Real>(turned, k);
      set(weights, p, Real((sums[0] + sums[1]) + (sums[2] + sums[3])));
    }
  }
}

// ---------------------------------------------------------------------------------------- block

/// Members side by side, as many as a Real holds, with what is computed of them.
template <class Real>
struct Block {
  const GridTables& grid;
  const MotionEffects& effects;
  const Count m = grid.functions, padded = grid.padded, nodes = grid.nodes, points = nodes + 1;
  const Count half = points / 2, middle = half - 1;

  // The columns that are integrated: derivatives of the position by the orthonormal coordinates, x
  // then y; acceleration at q'' = 0; velocity, where it drags. Energy and power take the velocity
  // alone.
  const Count bias = 2 * padded;
  double *theta, *omega, *sine, *cosine;  // (points), of a single member (stride)
  double *sums, *moments;                 // rows of columns: see GridTables
  double *mass, *force;
  double *velocity, *weighted, *load_x, *load_y, *rest;  // (points); rest 3 Q

  static Count row_length(Count columns) { return whole_packs(columns * lanes<Real>); }
  /// Of a row of the mass matrix: single rows are written by whole packs.
  Count mass_stride() const { return lanes<Real> == 1 ? whole_packs(padded) : padded; }

  Block(const GridTables& tables, const MotionEffects& present, double* scratch)
      : grid(tables), effects(present) {
    lay_out(scratch);
  }

  static Count size(const GridTables& tables) {
    const MotionEffects none{};
    return Block(tables, none, nullptr).lay_out(nullptr);
  }

  /// Numbers used; without scratch it only counts them.
  Count lay_out(double* scratch) {
    Count used = 0;
    const auto take = [scratch, &used](Count reals) {
      double* const start = scratch == nullptr ? nullptr : scratch + used;
      used += (reals * lanes<Real> + 7) / 8 * 8;
      return start;
    };
    const Count rows = points * row_length(bias + 4) / lanes<Real> + 1;
    theta = take(grid.stride);
    omega = take(grid.stride);
    sine = take(grid.stride);
    cosine = take(grid.stride);
    sums = take(rows);
    moments = take(rows);
    mass = take(padded * mass_stride());
    force = take(padded);
    velocity = take(points);
    weighted = take(points);
    load_x = take(points);
    load_y = take(points);
    rest = take(3 * nodes);
    return used;
  }

  void angles(const double* q) {
    const double* const rate = q + m * lanes<Real>;
    if constexpr (lanes<Real> == 1) {
      for (Count p = 0; p < grid.stride; p += width) {
        Pack angle{}, speed{};
        for (Count i = 0; i < m; ++i) {
          const Pack slope = load<Pack>(grid.slope_by_function + i * grid.stride + p);
          angle += q[i] * slope;
          speed += rate[i] * slope;
        }
        store(theta + p, angle);
        store(omega + p, speed);
      }
      sincos(theta, grid.stride, sine, cosine);
    } else {
      for (Count p = 0; p < points; p += 4) {
        Real angle[4] = {}, speed[4] = {};
        for (Count i = 0; i < m; ++i) {
          const Real amplitude = at<Real>(q, i), pace = at<Real>(rate, i);
          const double* const slope = grid.slope_by_function + i * grid.stride + p;
          for (Count k = 0; k < 4; ++k) {
            angle[k] += slope[k] * amplitude;
            speed[k] += slope[k] * pace;
          }
        }
        for (Count k = 0; k < 4; ++k) {
          set(theta, p + k, angle[k]);
          set(omega, p + k, speed[k]);
        }
      }
      sincos(theta, points * lanes<Real>, sine, cosine);
    }
  }

  /// Sums and differences of n Theta_i over mirrored nodes, to be integrated.
  void fold_slopes(Count row) {
    for (Count p = 0; p < half; ++p) {
      const bool paired = p < middle;
      const Count other = nodes - 1 - p;
      const Real c = at<Real>(cosine, p), s = at<Real>(sine, p);
      const Real c_other = paired ? at<Real>(cosine, other) : Real{};
      const Real s_other = paired ? at<Real>(sine, other) : Real{};
      const double* __restrict const slope = grid.orthonormal + p * padded;
      const double* __restrict const slope_other = grid.orthonormal + other * padded;
      double* __restrict const sum = sums + p * row;
      double* __restrict const difference = sums + (half + p) * row;
      for (Count i = 0; i < padded; ++i) {
        const Real x = slope[i] * c, x_other = slope_other[i] * c_other;
        const Real y = slope[i] * s, y_other = slope_other[i] * s_other;
        set(sum, i, Real(x + x_other));
        set(difference, i, Real(x - x_other));
        set(sum, padded + i, Real(-y - y_other));
        set(difference, padded + i, Real(y_other - y));
      }
    }
  }

  void fold(Count row, Count column, Count p, const Real& here, const Real& mirrored) {
    set(sums + p * row, column, Real(here + mirrored));
    set(sums + (half + p) * row, column, Real(here - mirrored));
  }

  /// Into the two columns from first: the integrand n theta' of the velocity.
  void fold_velocity(Count row, Count first) {
    for (Count p = 0; p < half; ++p) {
      const Count other = nodes - 1 - p;
      const Real w = at<Real>(omega, p), w_other = p < middle ? at<Real>(omega, other) : Real{};
      fold(row, first, p, at<Real>(cosine, p) * w, at<Real>(cosine, other) * w_other);
      fold(row, first + 1, p, -at<Real>(sine, p) * w, -at<Real>(sine, other) * w_other);
    }
  }

  /// The same of the acceleration at q'' = 0, -t theta'^2.
  void fold_acceleration(Count row, Count first) {
    for (Count p = 0; p < half; ++p) {
      const Count other = nodes - 1 - p;
      const Real w = at<Real>(omega, p), w_other = p < middle ? at<Real>(omega, other) : Real{};
      const Real square = w * w, square_other = w_other * w_other;
      fold(row, first, p, -at<Real>(sine, p) * square, -at<Real>(sine, other) * square_other);
      fold(row, first + 1, p, -at<Real>(cosine, p) * square,
           -at<Real>(cosine, other) * square_other);
    }
  }

  /// An integrated column at a point.
  Real moment(Count row, Count column, Count p) const {
    const auto entry = [&](Count which) { return at<Real>(moments + which * row, column); };
    if (p < middle) return entry(p) + entry(half + p);
    if (p == middle) return entry(p);
    if (p == nodes) return 2.0 * entry(2 * half - 1);
    return entry(nodes - 1 - p) - entry(half + nodes - 1 - p);
  }

  /// v_n and the signed weights of the nodes.
  void drag(Count row, Count first) {
    for (Count p = 0; p < points; ++p) {
      const Real x = moment(row, first, p), y = moment(row, first + 1, p);
      set(velocity, p, Real(at<Real>(cosine, p) * x - at<Real>(sine, p) * y));
    }
    signed_weights_of<Real>(grid, velocity, weighted, rest);
  }

  /// Nodes' numbers become the sums and, in the mirrored places, the differences.
  void fold_in_place(double* array) const {
    for (Count p = 0; p < middle; ++p) {
      const Real here = at<Real>(array, p), mirrored = at<Real>(array, nodes - 1 - p);
      set(array, p, Real(here + mirrored));
      set(array, nodes - 1 - p, Real(here - mirrored));
    }
  }

  /// All generalised forces but inertia's that is linear in q'', by orthonormal coordinates.
  void forces(const double* y, const Real& u, Count row) {
    bool flows = false;
    double speeds[lanes<Real>];
    store(speeds, u);
    for (const double speed : speeds) flows |= speed != 0.0;
    const Real coriolis = effects.coriolis * u;
    const bool drags = effects.drag != 0.0;
    if (drags) drag(row, bias + 2);
    for (Count p = 0; p < nodes; ++p) {
      const Real c = at<Real>(cosine, p), s = at<Real>(sine, p);
      const double weight = grid.weight[p];
      Real x = -weight * moment(row, bias, p);
      Real y_load = weight * (effects.gamma - moment(row, bias + 1, p));
      Real across{};
      if (flows) across = weight * coriolis * at<Real>(omega, p);
      if (drags) {
        const Real v = at<Real>(velocity, p);
        across += effects.drag * at<Real>(weighted, p) * (v * v);
      }
      if (flows || drags) {
        x -= across * c;
        y_load += across * s;
      }
      set(load_x, p, x);
      set(load_y, p, y_load);
    }
    fold_in_place(load_x);
    fold_in_place(load_y);
    Real end_x{}, end_y{};  // twice the follower force: the last row is half of the end's
    if (flows) {
      const Real thrust = 2.0 * effects.centrifugal * (u * u);
      end_x = -thrust * at<Real>(sine, nodes);
      end_y = -thrust * at<Real>(cosine, nodes);
    }
    set(load_x, nodes, end_x);
    set(load_y, nodes, end_y);
    if constexpr (lanes<Real> == 1) {
      for (Count i = 0; i < padded; ++i) force[i] = 0.0;
      for (Count p = 0; p < points; ++p) {
        const double* __restrict const x = moments + p * row;
        const double* __restrict const y_row = x + padded;
        const Count from = load_of(p);
        const double fx = load_x[from], fy = load_y[from];
        double* __restrict const to = force;
        for (Count i = 0; i < padded; ++i) to[i] += fx * x[i] + fy * y_row[i];
      }
    } else {
      for (Count i = 0; i < padded; i += 4) {
        Real sum[4] = {};
        for (Count p = 0; p < points; ++p) {
          const double* const x = moments + p * row + i * lanes<Real>;
          const double* const y_row = x + padded * lanes<Real>;
          const Count from = load_of(p);
          const Real fx = at<Real>(load_x, from), fy = at<Real>(load_y, from);
          for (Count k = 0; k < 4; ++k) sum[k] += fx * at<Real>(x, k) + fy * at<Real>(y_row, k);
        }
        for (Count k = 0; k < 4; ++k) set(force, i + k, sum[k]);
      }
    }
    elastic(y);
  }

  /// Where the folded load of a row of the moments stands.
  Count load_of(Count row) const {
    if (row < half) return row;
    return row < nodes ? nodes - 1 - (row - half) : nodes;
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

  /// Lower triangle of the mass matrix in tiles: sum over rows and components of w J_i J_j.
  void gram(Count row) {
    if constexpr (lanes<Real> == 1) {
      const Count stride = mass_stride();
      for (Count i = 0; i < padded; i += 4) {
        for (Count k = 0; k < i + 4; k += width) {
          Pack by_x[4] = {}, by_y[4] = {};
          for (Count p = 0; p < nodes; ++p) {
            const double* const x = moments + p * row;
            const double* const y = x + padded;
            const Pack first = grid.folded_weight[p] * load<Pack>(x + k);
            const Pack second = grid.folded_weight[p] * load<Pack>(y + k);
            for (Count r = 0; r < 4; ++r) {
              by_x[r] += x[i + r] * first;
              by_y[r] += y[i + r] * second;
            }
          }
          for (Count r = 0; r < 4; ++r) store(mass + (i + r) * stride + k, by_x[r] + by_y[r]);
        }
      }
    } else {
      constexpr Count rows = 4, columns = width == 8 ? 4 : 2;  // a tile stays in registers
      for (Count i = 0; i < padded; i += rows) {
        for (Count k = 0; k < i + rows; k += columns) {
          Real sum[rows][columns] = {};
          for (Count p = 0; p < nodes; ++p) {
            for (Count component = 0; component < 2; ++component) {
              const double* const from = moments + p * row + component * padded * lanes<Real>;
              Real others[columns];
              for (Count c = 0; c < columns; ++c) {
                others[c] = grid.folded_weight[p] * at<Real>(from, k + c);
              }
              for (Count r = 0; r < rows; ++r) {
                const Real value = at<Real>(from, i + r);
                for (Count c = 0; c < columns; ++c) sum[r][c] += value * others[c];
              }
            }
          }
          for (Count r = 0; r < rows; ++r) {
            for (Count c = 0; c < columns; ++c) set(mass, (i + r) * padded + k + c, sum[r][c]);
          }
        }
      }
    }
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

  void accelerations(const Batch& batch, double* out) {
    const bool drags = effects.drag != 0.0;
    const Count row = row_length(drags ? bias + 4 : bias + 2);
    angles(batch.y);
    fold_slopes(row);
    fold_acceleration(row, bias);
    if (drags) fold_velocity(row, bias + 2);
    integrate_folded(grid, row, sums, moments);
    forces(batch.y, load<Real>(batch.u), row);
    gram(row);
    solve(out);
    to_basis(out);
  }

  /// Velocities alone: rows of two columns.
  Count velocities(const Batch& batch) {
    const Count row = row_length(2);
    angles(batch.y);
    for (Count i = 0; i < points * row; ++i) sums[i] = 0.0;
    fold_velocity(row, 0);
    integrate_folded(grid, row, sums, moments);
    return row;
  }

  Real energy(const Batch& batch) {
    const Count row = velocities(batch);
    Real twice{};
    for (Count p = 0; p < nodes; ++p) {
      const Real x = at<Real>(moments + p * row, 0), y = at<Real>(moments + p * row, 1);
      twice += grid.folded_weight[p] * (x * x + y * y);
    }
    for (Count i = 0; i < m; ++i) {
      const Real amplitude = at<Real>(batch.y, i);
      twice += grid.stiffness[i] * (amplitude * amplitude);
    }
    if (effects.gamma != 0.0) {  // s - y(s) integrated by parts, with the digits of 1 - cos theta
      for (Count p = 0; p < nodes; ++p) {
        const Real s = at<Real>(sine, p), c = at<Real>(cosine, p);
        const Real rise = c > 0.0 ? s * s / (1.0 + c) : 1.0 - c;
        twice += 2.0 * effects.gamma * grid.weight[p] * (1.0 - grid.arc[p]) * rise;
      }
    }
    return 0.5 * twice;
  }

  void power(const Batch& batch, const PowerParts& out) {
    const Count row = velocities(batch);
    const Real u = load<Real>(batch.u);
    const Real x = moment(row, 0, nodes), y = moment(row, 1, nodes);
    const Real along = at<Real>(sine, nodes) * x + at<Real>(cosine, nodes) * y;
    const Real flux = 0.5 * effects.coriolis * u, thrust = effects.centrifugal * (u * u);
    Real joints{}, dragged{};
    if (effects.damping != 0.0) {
      for (Count i = 0; i < m; ++i) {
        const Real rate = at<Real>(batch.y, m + i);
        joints -= effects.damping * grid.stiffness[i] * (rate * rate);
      }
    }
    if (effects.drag != 0.0) {
      drag(row, 0);
      for (Count p = 0; p < nodes; ++p) {
        const Real v = at<Real>(velocity, p);
        dragged -= effects.drag * at<Real>(weighted, p) * (v * v * v);
      }
    }
    store(out.flow, Real(-flux * (x * x + y * y) - thrust * along));
    store(out.joints, joints);
    store(out.drag, dragged);
  }
};

// ---------------------------------------------------------------------------------------- entry

Count scratch_size(const GridTables& grid, Count members) {
  return members == 1 ? Block<double>::size(grid) : Block<Pack>::size(grid);
}

void accelerations(const GridTables& grid, const MotionEffects& effects, const Batch& batch,
                   double* out, double* scratch) {
  if (batch.members == 1) {
    Block<double>(grid, effects, scratch).accelerations(batch, out);
  } else {
    Block<Pack>(grid, effects, scratch).accelerations(batch, out);
  }
}

void energy(const GridTables& grid, const MotionEffects& effects, const Batch& batch, double* out,
            double* scratch) {
  if (batch.members == 1) {
    store(out, Block<double>(grid, effects, scratch).energy(batch));
  } else {
    store(out, Block<Pack>(grid, effects, scratch).energy(batch));
  }
}

void power(const GridTables& grid, const MotionEffects& effects, const Batch& batch,
           const PowerParts& out, double* scratch) {
  if (batch.members == 1) {
    Block<double>(grid, effects, scratch).power(batch, out);
  } else {
    Block<Pack>(grid, effects, scratch).power(batch, out);
  }
}

void signed_weights(const GridTables& grid, const double* v, double* weights, double* scratch) {
  signed_weights_of<double>(grid, v, weights, scratch);
}

}  // namespace

namespace pipedyn {

const GalerkinKernel PIPEDYN_NAMED(galerkin) = {
    .scratch_size = ::scratch_size,
    .accelerations = ::accelerations,
    .energy = ::energy,
    .power = ::power,
    .integrals_scratch_size = ::integrals_scratch_size,
    .integrate = ::integrate,
    .signed_weights = ::signed_weights,
};

}  // namespace pipedyn
