// SPDX-License-Identifier: MIT
//
// Derivatives of the motion of a block of members by their states: first of the virtual work at
// fixed q'', then of q''. Local to each translation unit, like vector/pack.hpp.
#pragma once

#include "pipedyn/galerkin/block.hpp"

namespace {

template <class Real>
struct Linearisation : Block<Real> {
  using Base = Block<Real>;
  using Base::each, Base::loads, Base::resists, Base::across_alone, Base::bias;
  using Base::holds, Base::response, Base::reaction;
  using Base::load_x, Base::load_y, Base::mass_stride, Base::product_of;
  using Base::moments, Base::integrands;
  using Base::sine, Base::cosine, Base::omega, Base::mass;
  using Base::step, Base::grid, Base::effects, Base::m, Base::padded, Base::points;
  using typename Base::Numbers, typename Base::Product;

  // Columns besides those that are integrated for the motion, each x then y: derivatives of the
  // loads by velocities, and those of the loads of terms by positions, times the virtual
  // displacements. Between these are, if some mass moves across the pipe alone, the loads by which
  // inertia responds to the displacements; otherwise the displacements themselves are used.
  const Count resisted = Base::integrated;
  const Count beyond_resisted = resisted + (resists ? 2 * each : 0);
  const Count inertial = across_alone ? beyond_resisted : 0;
  const Count held = beyond_resisted + (across_alone ? 2 * each : 0);
  const Count last = held + (loads ? 2 * each : 0) + step;  // with room for a vector
  double *own, *acceleration, *spin;  // q'' in orthonormal coordinates and in the basis; theta''
  double* beyond;                     // a row of columns: loads beyond a point
  Slopes<Real>* slopes;               // of the loads at each point, without inertia
  double *from_angle, *from_rate, *system, *resistance;  // arrays of `linearise`
  double *turned, *returned;  // for supports: G, derivatives of x by q; what G times the
                              // derivatives of q'' by q, then by q', must be

  using Base::Base;

  void take(Layout& layout) {
    Base::take(layout, last);
    const auto take = [&](Count reals) { return layout.take(reals * lanes<Real>); };
    own = take(mass_stride());
    acceleration = take(m);
    spin = take(grid.stride);
    beyond = take(Base::row_length(last));
    slopes = layout.take<Slopes<Real>>(points);
    from_angle = take(points * mass_stride());
    from_rate = take(points * mass_stride());
    system = take(padded * 2 * mass_stride());
    resistance = take(padded * mass_stride());
    turned = take(holds * m);
    returned = take(holds * 2 * m);
  }

  /// Unit of the loads of a point in integrals: its weight, or 1 at the end of a panel.
  double unit(Count p) const { return grid.weight[p] != 0.0 ? grid.weight[p] : 1.0; }

  /// Multiplies the displacements by the mass per length, or divides them by it if `back`.
  void weigh_displacements(Count row, bool back) {
    for (Count p = 0; p < points; ++p) {
      const double density = grid.weight[p] != 0.0 ? grid.mass[p] / grid.weight[p] : 1.0;
      const double factor = back ? 1.0 / density : density;
      double* const x = moments + p * row;
      for (Count i = 0; i < bias * lanes<Real>; ++i) x[i] *= factor;
    }
  }

  /// Adds the slopes of the load of a law at a point.
  void add_slopes(const auto& law, const Station<Real>& station, Count p, double weight) {
    for_each_slope(differentiated_load(law, station), [&](int component, int k, const Real& slope) {
      slopes[p].by[component][k] += weight * slope;
    });
  }

  /// The derivatives of the loads at a point by one variable.
  Acting<Real> by(Count p, int variable) const {
    const auto& of = slopes[p].by;
    return Acting<Real>(Load{of[0][variable], of[1][variable], of[2][variable]});
  }

  /// The work of loads at a point on the virtual displacements and rotation of the functions from i
  /// on. x: the displacements at the point.
  Pack work(const Acting<Real>& load_by, const double* x, Count p, Count i) const {
    const Pack found = load_by.x * load<Pack>(x + i * lanes<Real>) +
                       load_by.y * load<Pack>(x + (each + i) * lanes<Real>);
    return found + load_by.couple * load<Numbers>(grid.orthonormal + p * padded + i);
  }

  /// Sets the loads of all points in their units, which are integrated in place of the acceleration
  /// at q'' = 0, and the columns from `resisted` on.
  void set_loads(const Batch& batch, Count row) {
    for (Count p = 0; p < points; ++p) slopes[p] = {};
    Base::for_each_station(batch, row, bias + 2,
                           [&](const auto& law, const auto& station, Count p, double w) {
                             add_slopes(law, station, p, w);
                           });
    for (Count p = 0; p < points; ++p) {
      double* const x = moments + p * row;
      double* const y = x + each * lanes<Real>;
      const double share = 1.0 / unit(p);
      Real turned_x{}, turned_y{};
      for (Count i = 0; i < m; ++i) {
        turned_x += at<Real>(own, i) * at<Real>(x, i);
        turned_y += at<Real>(own, i) * at<Real>(y, i);
      }
      Real along_x = grid.mass[p] * turned_x, along_y = grid.mass[p] * turned_y;
      const Real ax = turned_x + at<Real>(x, bias), ay = turned_y + at<Real>(x, bias + 1);
      add_slopes(Base::point_load(batch, p, ax, ay), Base::station(row, bias + 2, p), p, 1.0);
      // Whole vectors are stored, so columns are set in ascending order.
      const auto set_work = [&](Count column, double factor, int variable) {
        const Acting<Real> load_by = by(p, variable);
        for (Count i = 0; i < each; i += step) {
          store(x + (column + i) * lanes<Real>, Pack(factor * work(load_by, x, p, i)));
        }
      };
      for (int k = 0; resists && k < 2; ++k) set_work(resisted + k * each, -share, by_velocity + k);
      if (across_alone) {
        const Real c = at<Real>(cosine, p), s = at<Real>(sine, p);
        const double own = grid.weight[p] * effects.normal_mass;
        const Real by_turning = own * (c * turned_x - s * turned_y);
        along_x += by_turning * c;
        along_y -= by_turning * s;
        for (Count i = 0; i < each; ++i) {
          const Real by_x = at<Real>(x, i), by_y = at<Real>(y, i);
          const Real by_normal = (share * own) * (c * by_x - s * by_y);
          set(x, inertial + i, Real((share * grid.mass[p]) * by_x + by_normal * c));
          set(x, inertial + each + i, Real((share * grid.mass[p]) * by_y - by_normal * s));
        }
      }
      set(x, bias, Real(share * (along_x - at<Real>(load_x, p))));
      set(x, bias + 1, Real(share * (along_y - at<Real>(load_y, p))));
      for (int k = 0; loads && k < 2; ++k) set_work(held + k * each, 1.0, by_position + k);
    }
  }

  /// Derivatives of all forces except those of bending, with inertia at fixed q'', by q and then by
  /// q' of the basis: system (padded, 2 strides), rows by orthonormal coordinates. To be called
  /// after `forces` and with q'' in `own` and `spin`. Loads beyond a node act on whatever the node
  /// moves. At the nodes, their sums follow from the quadrature's integration by parts,
  /// S^T W = w w^T - W S.
  void linearise(const Batch& batch, Count row) {
    const Count stride = mass_stride(), end = points - 1;
    set_loads(batch, row);
    weigh_displacements(row, false);
    integrate(grid, row, held * lanes<Real>, moments, integrands);
    weigh_displacements(row, true);
    for (Count k = 0; k < held; ++k) set(beyond, k, at<Real>(integrands + end * row, k));
    for (Count p = end; p >= 0; --p) {
      const double* const x = moments + p * row;
      const double* const before = integrands + p * row;
      const double factor = grid.weight[p];
      if (factor == 0.0) {
        const double jump = grid.mass[p] / unit(p);
        for (Count k = 0; k < bias; ++k) add(beyond, k, Real(jump * at<Real>(x, k)));
        for (Count k = bias; k < held; ++k) add(beyond, k, at<Real>(x, k));
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
      const Acting<Real> turned_loads = by(p, by_angle), rate_loads = by(p, by_rate);
      for (Count i = 0; i < each; i += step) {
        const Pack beyond_x = beyond_of(inertial + i), beyond_y = beyond_of(inertial + each + i);
        const Pack beyond_t = beyond_x * s + beyond_y * c, beyond_n = beyond_x * c - beyond_y * s;
        Pack angle = load<Numbers>(grid.orthonormal + p * padded + i) * bent +
                     work(turned_loads, x, p, i) + beyond_t * turning + beyond_n * square;
        if (resists) {
          angle += beyond_of(resisted + i) * (s * w) + beyond_of(resisted + each + i) * (c * w);
        }
        store(from_angle + (p * stride + i) * lanes<Real>, angle);
        const Pack rate = beyond_t * (2.0 * w) + work(rate_loads, x, p, i);
        store(from_rate + (p * stride + i) * lanes<Real>, rate);
      }
    }
    const auto by_slopes = [&](const double* left, double* to) {
      product_of(
          points, [&](Count p, Count i) { return at<Real>(left, p * stride + i); },
          [&](Count p, Count j) { return load<Numbers>(grid.slope + p * padded + j); }, to,
          2 * stride, Product::all);
    };
    by_slopes(from_angle, system);
    by_slopes(from_rate, system + stride * lanes<Real>);
    if (loads) add_moved(row, held, [](Count) { return 1.0; }, system);
    if (resists) {
      add_moved(row, resisted, [&](Count p) { return -unit(p); }, system + stride * lanes<Real>);
    }
  }

  /// Adds to `to` the sum over points of scale times the columns from `first` on times the
  /// displacements.
  template <class Scale>
  void add_moved(Count row, Count first, const Scale& scale, double* to) {
    const Count stride = mass_stride();
    const auto component = [&](Count k) {
      return moments + (k >> 1) * row + (k & 1) * each * lanes<Real>;
    };
    product_of(
        2 * points,
        [&](Count k, Count i) { return Real(scale(k >> 1) * at<Real>(component(k), first + i)); },
        [&](Count k, Count j) { return load<Pack>(component(k) + j * lanes<Real>); }, resistance,
        stride, Product::all);
    product_of(
        m, [&](Count k, Count i) { return at<Real>(resistance, i * stride + k); },
        [&](Count k, Count j) { return load<Numbers>(grid.from_basis + k * padded + j); }, to,
        2 * stride, Product::added);
  }

  /// Replaces the columns of the system by those of q'' in the basis: multiplies by M^-1, with the
  /// factor that `solve` leaves.
  void solve_system() {
    const Count stride = mass_stride(), whole = 2 * stride * lanes<Real>;
    // Replaces row i by its product with `own` and the sum of other rows, each times its factor.
    const auto combine = [&](Count i, Count first, Count end, const Real& own, const auto& factor) {
      double* const to = system + i * whole;
      for (Count j = 0; j < whole; j += width) {
        Pack sum = own * load<Pack>(to + j);
        for (Count k = first; k < end; ++k) sum += factor(k) * load<Pack>(system + k * whole + j);
        store(to + j, sum);
      }
    };
    const auto entry = [&](Count i, Count k) { return at<Real>(mass, i * stride + k); };
    for (Count i = 0; i < m; ++i) {
      const Real own = entry(i, i);
      combine(i, 0, i, own, [&](Count k) { return Real(-own * entry(i, k)); });
    }
    for (Count i = m - 1; i >= 0; --i) {
      const Real own = entry(i, i);
      combine(i, i + 1, m, own, [&](Count k) { return Real(-own * entry(k, i)); });
    }
    for (Count i = 0; i < m; ++i) {
      const double* const row = grid.to_basis + i * m;
      combine(i, i + 1, m, all<Real>(row[i]), [&](Count k) { return row[k]; });
    }
  }

  /// Computes `turned` and `returned`: sums of the slopes of the basis along the pipe to each
  /// support.
  void set_supports() {
    const double k = effects.return_rate;
    Base::integrate_to_supports(turned, m, [&](Count p) { return at<Real>(cosine, p); });
    Base::integrate_to_supports(returned, 2 * m, [&](Count p) {
      const Real c = at<Real>(cosine, p), s = at<Real>(sine, p), w = at<Real>(omega, p);
      return Real(s * (at<Real>(spin, p) + 2.0 * k * w) + c * (w * w - k * k));
    });
    Base::integrate_to_supports(returned + m * lanes<Real>, 2 * m, [&](Count p) {
      return Real(2.0 * (at<Real>(sine, p) * at<Real>(omega, p) - k * at<Real>(cosine, p)));
    });
  }

  /// Adds the effect of the supports to the columns of the system, which are derivatives of q''
  /// without supports.
  void hold_system() {
    const Count stride = mass_stride();
    set_supports();
    for (Count b = 0; b < holds; ++b) Base::to_basis(response + b * m * lanes<Real>);
    for (Count j = 0; j < 2 * m; ++j) {
      const Count column = j < m ? j : stride + j - m;
      for (Count b = 0; b < holds; ++b) set(reaction, b, at<Real>(returned, 2 * b * m + j));
      hold_column(system + column * lanes<Real>, 2 * stride);
    }
  }

  /// Adds the effect of the supports to a column of derivatives of q'' without supports, whose
  /// entries are `apart` numbers apart, such that the product of G and the column becomes what
  /// `reaction` holds.
  void hold_column(double* column, Count apart) {
    for (Count b = 0; b < holds; ++b) {
      Real missed = at<Real>(reaction, b);
      for (Count i = 0; i < m; ++i) {
        missed -= at<Real>(turned, b * m + i) * at<Real>(column, i * apart);
      }
      set(reaction, b, missed);
    }
    Base::solve_supports(reaction);
    for (Count b = 0; b < holds; ++b) {
      for (Count i = 0; i < m; ++i) {
        add(column, i * apart, Real(at<Real>(reaction, b) * at<Real>(response, b * m + i)));
      }
    }
  }

  /// Derivative of q'' without supports by the speed, in the basis. Overwrites the loads.
  void by_speed(const Batch& batch, Count row, double* to) {
    const Real one = all<Real>(1.0), twice = 2.0 * load<Real>(batch.u);
    for (Count p = 0; p < points; ++p) {
      const Acting<Real> load(Base::flow_at(p, one, twice).load(Base::station(row, bias + 2, p)));
      set(load_x, p, load.x);
      set(load_y, p, load.y);
      set(Base::couple, p, load.couple);
    }
    Base::gather(row);
    for (Count i = 0; i < m; ++i) set(to, i, at<Real>(Base::force, i));
    Base::solve_mass(to);
    Base::to_basis(to);
  }

  /// Writes the system of the members, (m, 2 m) of each.
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
    const Count row = Base::kinematics(batch, last), stride = mass_stride();
    Base::forces(batch, row);
    Base::gram(row);
    Base::solve(own);
    Base::hold(batch, row, own);
    for (Count i = 0; i < m; ++i) set(acceleration, i, at<Real>(own, i));
    Base::to_basis(acceleration);
    Base::template along<1>({acceleration}, {spin});
    linearise(batch, row);
    for (Count j = 0; j < m; ++j) {
      const double* const elastic = grid.elastic_forces + j * m;
      const double* const damped = grid.damped_forces + j * m;
      for (Count i = 0; i < m; ++i) {
        add(system, 2 * i * stride + j, all<Real>(-elastic[i]));
        add(system, (2 * i + 1) * stride + j, all<Real>(-effects.damping * damped[i]));
      }
    }
    solve_system();
    double* const accelerations = out + 2 * m * m * lanes<Real>;
    double* const by_u = accelerations + m * lanes<Real>;
    by_speed(batch, row, by_u);
    if (holds > 0) {
      hold_system();
      for (Count b = 0; b < holds; ++b) set(reaction, b, Real{});
      hold_column(by_u, 1);
    }
    write_system(out);
    for (Count i = 0; i < m; ++i) set(accelerations, i, at<Real>(acceleration, i));
  }

  /// Operators of a state at rest: see GalerkinKernel.
  void operators(const Batch& batch, const double* displacements, double* out) {
    const Count row = Base::kinematics(batch, last), stride = mass_stride();
    if (displacements != nullptr) {
      for (Count p = 0; p < points; ++p) {
        for (Count i = 0; i < m; ++i) set(moments + p * row, i, displacements[p * m + i]);
      }
    }
    Base::forces(batch, row);
    const double* const forces_of = Base::force;
    Base::gram(row);
    for (Count i = 0; i < m; ++i) {
      for (Count j = 0; j < m; ++j) {
        out[i * m + j] = mass[i < j ? j * stride + i : i * stride + j];
      }
    }
    for (Count i = 0; i < m; ++i) own[i] = 0.0;
    for (Count p = 0; p < points; ++p) spin[p] = 0.0;
    linearise(batch, row);
    write_system(out + m * m);
    const double* const end = moments + (points - 1) * row;
    for (Count i = 0; i < m; ++i) {
      out[3 * m * m + i] = end[i];
      out[3 * m * m + m + i] = end[each + i];
      out[3 * m * m + 2 * m + i] = forces_of[i];
    }
  }
};

}  // namespace
