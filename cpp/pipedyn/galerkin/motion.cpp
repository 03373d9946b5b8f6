// SPDX-License-Identifier: MIT
#include "pipedyn/galerkin/motion.hpp"

#include <algorithm>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "pipedyn/galerkin/galerkin.hpp"
#include "pipedyn/products.hpp"
#include "pipedyn/terms/laws.hpp"
#include "pipedyn/vector/levels.hpp"
#include "pipedyn/vector/scratch.hpp"

namespace pipedyn {

namespace {

using Map = Eigen::Map<const Vector>;

constexpr double not_a_number = std::numeric_limits<double>::quiet_NaN();

const GalerkinKernel& kernel() { return *motion_kernel().galerkin; }

/// Calls evaluate(grid, block, out, scratch) for blocks of members that take the same grid, one
/// alone or as many as the vectors hold, and writes row i of out, (results, members of the block),
/// to row(i); NaN for those that bend more than the largest grid resolves.
template <class Evaluate, class Row>
void for_each_block(const Grids& grids, const Batch& batch, Index results, const Evaluate& evaluate,
                    const Row& row) {
  static thread_local std::vector<Index> grid_of, chosen;
  const GalerkinKernel& kernel = pipedyn::kernel();
  const Index state = 2 * grids.basis().size(), members = batch.members;
  grid_of.resize(static_cast<std::size_t>(members));
  Index lowest = grids.count(), highest = 0;
  for (Index k = 0; k < members; ++k) {
    const Index number = grids.choose(batch.y + k, members);
    grid_of[static_cast<std::size_t>(k)] = number;
    lowest = std::min(lowest, number);
    highest = std::max(highest, number);
  }
  for (Index number = lowest; number <= highest; ++number) {
    chosen.clear();
    for (Index k = 0; k < members; ++k) {
      if (grid_of[static_cast<std::size_t>(k)] == number) chosen.push_back(k);
    }
    const Index count = static_cast<Index>(chosen.size());
    if (count == 0) continue;
    const Grid& grid = grids[number];
    const Index width = count == 1 ? 1 : motion_kernel().width;
    const Index numbers = whole(kernel.scratch_size(grid.tables(), width), GridTables::widest);
    double* const work = scratch(numbers + (state + 1 + results) * width);
    double* const y = work + numbers;
    double* const u = y + state * width;
    double* const out = u + width;
    const Batch block{y, u, width, 1};
    for (Index first = 0; first < count; first += width) {
      const Index used = std::min(width, count - first);
      const Index* const member = chosen.data() + first;  // lanes to spare repeat the last
      for (Index b = 0; b < width; ++b) {
        const Index k = member[std::min(b, used - 1)];
        u[b] = batch.u[k * batch.u_step];
        for (Index i = 0; i < state; ++i) y[i * width + b] = batch.y[i * members + k];
      }
      evaluate(grid, block, out, work);
      for (Index i = 0; i < results; ++i) {
        double* const to = row(i);
        for (Index b = 0; b < used; ++b) to[member[b]] = out[i * width + b];
      }
    }
    for (const Index k : chosen) {
      if (grids.resolves(number, batch.y + k, members)) continue;
      for (Index i = 0; i < results; ++i) row(i)[k] = not_a_number;
    }
  }
}

/// Row p, for loops over its columns: expressions of Eigen took twice as long to compile.
const double* row(const Slab& matrix, Index p) { return matrix.data() + p * matrix.outerStride(); }
double* row(Matrix& matrix, Index p) { return matrix.data() + p * matrix.cols(); }

/// Integrals from 0 to each point (N, columns) of what f is at the nodes.
void integrate(const Grid& grid, const Matrix& f, Matrix& out) {
  const GridTables& tables = grid.tables();
  out.resize(tables.points, f.cols());
  kernel().integrate(tables, f.data(), f.cols(), out.data(),
                     scratch(kernel().integrals_scratch_size(tables, f.cols())));
}

/// Transposed: of loads f, each in its point's measure, all beyond each node, in its weight. The
/// quadrature's integration by parts, S^T W = w w^T - W S, gives those of the nodes.
void integrate_beyond(const Grid& grid, const Matrix& f, Matrix& out) {
  integrate(grid, f, out);
  const Index last = out.rows() - 1, block = grid.nodes() + 1, columns = out.cols();
  Vector all = out.row(last);
  for (Index p = last; p >= 0; --p) {
    const double weight = grid.weight()[p];
    const double* const here = row(f, p);
    double* const beyond = row(out, p);
    const bool end = (p + 1) % block == 0;
    for (Index i = 0; i < columns; ++i) {
      if (end) all[i] += here[i];
      beyond[i] = weight * (all[i] - beyond[i]);
    }
  }
}

/// Angle, rate and the frame t, n at a grid's points.
struct Frame {
  Vector angle, omega, sine, cosine;
  Matrix velocity, position;  // (points, 2)
  Vector normal;              // v_n
  Vector weight;              // signed weights
  Matrix integrand;
  Vector scratch;

  void set(const Grid& grid, const Eigen::Ref<const Vector>& q,
           const Eigen::Ref<const Vector>& rate) {
    multiply(angle, grid.slope(), q);
    multiply(omega, grid.slope(), rate);
    sine.resize(angle.size());
    cosine.resize(angle.size());
    motion_kernel().sincos(angle.data(), angle.size(), sine.data(), cosine.data());
  }

  void set_velocity(const Grid& grid) {
    integrand.resize(angle.size(), 2);
    for (Index p = 0; p < angle.size(); ++p) {
      integrand(p, 0) = cosine[p] * omega[p];
      integrand(p, 1) = -sine[p] * omega[p];
    }
    integrate(grid, integrand, velocity);
  }

  void set_position(const Grid& grid) {
    integrand.resize(angle.size(), 2);
    integrand.col(0) = sine;
    integrand.col(1) = cosine;
    integrate(grid, integrand, position);
  }

  void set_drag(const Grid& grid) {
    normal.resize(angle.size());
    weight.resize(angle.size());
    for (Index p = 0; p < angle.size(); ++p) {
      normal[p] = cosine[p] * velocity(p, 0) - sine[p] * velocity(p, 1);
    }
    scratch.resize(3 * grid.nodes());
    kernel().signed_weights(grid.tables(), normal.data(), weight.data(), scratch.data());
  }
};

/// Derivatives of the position, integral of n Theta_i, at a grid's points: x, then y (N, 2 m);
/// slopes (N, m) holds the Theta_i.
void set_position_derivatives(const Grid& grid, const Frame& frame, const Slab& slopes,
                              Matrix& integrand, Matrix& xy) {
  const Index m = slopes.cols();
  integrand.resize(slopes.rows(), 2 * m);
  for (Index p = 0; p < slopes.rows(); ++p) {
    const double c = frame.cosine[p], s = frame.sine[p];
    const double* const slope = row(slopes, p);
    double* const x = row(integrand, p);
    for (Index i = 0; i < m; ++i) {
      x[i] = c * slope[i];
      x[m + i] = -(s * slope[i]);
    }
  }
  integrate(grid, integrand, xy);
}

/// Of derivatives (N, 2 m), x then y, the parts along and across the pipe (N, m).
void set_directions(const Frame& frame, const Matrix& xy, Matrix& along, Matrix& across) {
  const Index m = xy.cols() / 2;
  along.resize(xy.rows(), m);
  across.resize(xy.rows(), m);
  for (Index p = 0; p < xy.rows(); ++p) {
    const double c = frame.cosine[p], s = frame.sine[p];
    const double *const x = row(xy, p), *const y = x + m;
    double *const t = row(along, p), *const n = row(across, p);
    for (Index i = 0; i < m; ++i) {
      t[i] = x[i] * s + y[i] * c;
      n[i] = x[i] * c - y[i] * s;
    }
  }
}

/// What terms do at a state: loads and their slopes times the virtual displacements, each in its
/// point's measure.
struct TermLoads {
  Matrix load;                      // (N, 2)
  Matrix by_position, by_velocity;  // J_i . slopes, by x, then by y (N, 2 m)
  Matrix by_angle;                  // (N, m)

  /// frame: with velocity and position; xy: of set_position_derivatives.
  void set(const Grid& grid, const Panels& panels, const Frame& frame, const Matrix& xy) {
    const Index points = xy.rows(), m = xy.cols() / 2, block = grid.nodes() + 1;
    load.setZero(points, 2);
    by_position.setZero(points, 2 * m);
    by_velocity.setZero(points, 2 * m);
    by_angle.setZero(points, m);
    for (const PanelTerm& placed : panels.loads) {
      Laws::with(placed.term, [&](const auto& law) {
        for (Index p = 0; p < points; ++p) {
          const bool end = (p + 1) % block == 0;
          if (placed.panel < 0 ? end : p + 1 != (placed.panel + 1) * block) continue;
          const Station<double> at{frame.position(p, 0), frame.position(p, 1), frame.sine[p],
                                   frame.cosine[p],      frame.velocity(p, 0), frame.velocity(p, 1),
                                   frame.omega[p]};
          const Load<double> force = law.load(at);
          load(p, 0) += force.x;
          load(p, 1) += force.y;
          add(law.slopes(at), xy, p);
        }
      });
    }
  }

 private:
  void add(const Slopes& slopes, const Matrix& xy, Index p) {
    const Index m = xy.cols() / 2;
    const double *const x = row(xy, p), *const y = x + m;
    const auto& [position, velocity, angle] = slopes;
    for (Index i = 0; i < m; ++i) {
      for (Index k = 0; k < 2; ++k) {
        by_position(p, k * m + i) += position[0][k] * x[i] + position[1][k] * y[i];
        by_velocity(p, k * m + i) += velocity[0][k] * x[i] + velocity[1][k] * y[i];
      }
      by_angle(p, i) += angle[0] * x[i] + angle[1] * y[i];
    }
  }
};

/// Columns of a half of a matrix (rows or more, 2 m).
Slab half(const Matrix& matrix, Index which, Index rows) {
  const Index m = matrix.cols() / 2;
  return matrix.block(0, which * m, rows, m);
}

/// Sum over points and components of weight a b; both x, then y (points or more, 2 m).
Matrix inner_of_both(const Matrix& a, const Eigen::Ref<const Vector>& weight, const Matrix& b,
                     Index points) {
  Matrix sum = inner(half(a, 0, points), weight, half(b, 0, points));
  sum += inner(half(a, 1, points), weight, half(b, 1, points));
  return sum;
}

void require_amplitudes(Index entries, Index m) {
  if (entries != m) {
    throw std::invalid_argument("q must have " + std::to_string(m) + " entries, got " +
                                std::to_string(entries));
  }
}

}  // namespace

GalerkinMotion::GalerkinMotion(const Pipe& pipe, Basis basis, Index least_nodes)
    : pipe_(pipe), grids_(std::move(basis), pipe.terms, pipe.drag != 0.0, least_nodes) {}

MotionEffects GalerkinMotion::effects() const {
  return {.coriolis = 2.0 * pipe_.direction() * pipe_.sqrt_beta(),
          .centrifugal = pipe_.centrifugal,
          .gamma = pipe_.gamma,
          .drag = pipe_.drag,
          .damping = pipe_.damping,
          .loads = grids_.panels().loads.data(),
          .load_count = static_cast<Index>(grids_.panels().loads.size())};
}

Index GalerkinMotion::nodes(const Vector& q) const {
  require_amplitudes(q.size(), dof());
  return grids_[grids_.choose(q.data(), 1)].nodes();
}

void GalerkinMotion::rhs(const Batch& batch, double* rates) const {
  const Index m = dof(), members = batch.members;
  const MotionEffects effects = this->effects();
  std::copy(batch.y + m * members, batch.y + 2 * m * members, rates);
  const auto evaluate = [&](const Grid& grid, const Batch& block, double* out, double* work) {
    kernel().accelerations(grid.tables(), effects, block, out, work);
  };
  for_each_block(grids_, batch, m, evaluate, [&](Index i) { return rates + (m + i) * members; });
}

void GalerkinMotion::energy(const Batch& batch, double* out) const {
  const MotionEffects effects = this->effects();
  const auto evaluate = [&](const Grid& grid, const Batch& block, double* energies, double* work) {
    kernel().energy(grid.tables(), effects, block, energies, work);
  };
  for_each_block(grids_, batch, 1, evaluate, [&](Index) { return out; });
}

void GalerkinMotion::power(const Batch& batch, const PowerParts& out) const {
  const MotionEffects effects = this->effects();
  const auto evaluate = [&](const Grid& grid, const Batch& block, double* parts, double* work) {
    const Index width = block.members;
    kernel().power(grid.tables(), effects, block,
                   {parts, parts + width, parts + 2 * width, parts + 3 * width}, work);
  };
  double* const parts[] = {out.flow, out.joints, out.drag, out.others};
  for_each_block(grids_, batch, 4, evaluate, [&](Index i) { return parts[i]; });
}

void GalerkinMotion::jacobian(const double* y, double u, double* out) const {
  struct Workspace {  // each of one shape, so that it is allocated once
    Frame frame;
    TermLoads terms;
    Matrix integrand, xy, along, across, sums, by_angle, by_rate, by_drag, turn, weighted, force;
    Matrix mass, swept, system;
    Vector acceleration, spin, pressure, density;
    Cholesky factors;
  };
  static thread_local Workspace work;
  auto& [frame, terms, integrand, xy, along, across, sums, by_angle, by_rate, by_drag, turn,
         weighted, force, mass, swept, system, acceleration, spin, pressure, density, factors] =
      work;
  const Index m = dof();
  const Map q(y, m), rate(y + m, m);
  const Index number = grids_.choose(y, 1);
  const Grid& grid = grids_[number];
  const Index heavy = grid.heavy(), points = grid.tables().points, last = points - 1;
  const Matrix& slope = grid.slope();
  const Vector &weight = grid.weight(), &measure = grid.measure();
  const MotionEffects effects = this->effects();
  const double coriolis = effects.coriolis * u, thrust = effects.centrifugal * u * u;
  const bool drags = effects.drag != 0.0, loads = effects.load_count > 0;

  acceleration.resize(m);
  kernel().accelerations(grid.tables(), effects, {y, &u, 1, 0}, acceleration.data(),
                         scratch(kernel().scratch_size(grid.tables(), 1)));
  frame.set(grid, q, rate);
  const Slab orthonormal = grid.orthonormal().leftCols(m);
  set_position_derivatives(grid, frame, orthonormal, integrand, xy);
  multiply(spin, slope, acceleration);  // second derivative of the angle
  if (drags || loads) frame.set_velocity(grid);
  if (drags) frame.set_drag(grid);
  if (loads) {
    frame.set_position(grid);
    terms.set(grid, grids_.panels(), frame, xy);
  }
  const Vector &sine = frame.sine, &cosine = frame.cosine, &omega = frame.omega;

  // Load of each point, in its measure: inertia less the forces; at the end the follower force.
  turn.resize(points, 2);
  for (Index p = 0; p < points; ++p) {
    const double c = cosine[p], s = sine[p], square = omega[p] * omega[p];
    turn(p, 0) = c * spin[p] - s * square;
    turn(p, 1) = -s * spin[p] - c * square;
  }
  integrate(grid, turn, force);
  density.resize(points);
  pressure.setZero(points);
  for (Index p = 0; p < points; ++p) {
    const double c = cosine[p], s = sine[p], inside = weight[p] / measure[p];  // 0 at panels' ends
    double &x = force(p, 0), &y = force(p, 1);
    density[p] = grid.mass()[p] / measure[p];
    x *= density[p];
    y *= density[p];
    x += coriolis * inside * omega[p] * c;
    y -= coriolis * inside * omega[p] * s;
    y -= effects.gamma * density[p];
    if (drags) {
      pressure[p] = effects.drag * frame.weight[p] * (frame.normal[p] * frame.normal[p]);
      x += pressure[p] * c / measure[p];
      y -= pressure[p] * s / measure[p];
    }
    if (loads) {
      x -= terms.load(p, 0);
      y -= terms.load(p, 1);
    }
  }
  integrate_beyond(grid, force, weighted);

  // Virtual displacements along t and n, and what is beyond of them.
  set_directions(frame, xy, along, across);
  for (Index p = 0; p < points; ++p) {
    for (Index i = 0; i < 2 * m; ++i) integrand(p, i) = grid.mass()[p] * xy(p, i);
  }
  mass.setZero(m, m);
  for (const Index k : {0, 1}) add_inner(mass, 1.0, half(integrand, k, heavy), half(xy, k, heavy));
  for (Index p = 0; p < points; ++p) {
    for (Index i = 0; i < 2 * m; ++i) integrand(p, i) = xy(p, i) * density[p];
  }
  integrate_beyond(grid, integrand, sums);

  // Row i of the derivatives is the sum over points of these times Theta_j.
  by_angle.resize(points, m);
  by_rate.resize(points, m);
  by_drag.resize(points, m);
  for (Index p = 0; p < points; ++p) {
    const double c = cosine[p], s = sine[p], w = omega[p], square = w * w;
    const double load_x = weighted(p, 0) + thrust * sine[last] * weight[p];
    const double load_y = weighted(p, 1) + thrust * cosine[last] * weight[p];
    const double bent = -s * load_x - c * load_y, flow = coriolis * weight[p];
    const double *const theta = row(orthonormal, p), *const x = row(sums, p), *const y = x + m;
    const double *const t = row(along, p), *const n = row(across, p);
    double *const angle = row(by_angle, p), *const turning = row(by_rate, p);
    for (Index i = 0; i < m; ++i) {
      const double beyond_t = x[i] * s + y[i] * c, beyond_n = x[i] * c - y[i] * s;
      angle[i] = theta[i] * bent - beyond_t * spin[p] - beyond_n * square;
      if (p == last) angle[i] += thrust * n[i];
      angle[i] -= t[i] * (flow * w);
      turning[i] = beyond_t * (-2.0 * w) + n[i] * flow;
    }
    double *const by_x = row(integrand, p), *const by_y = by_x + m;
    if (drags) {
      const double v_t = s * frame.velocity(p, 0) + c * frame.velocity(p, 1);
      const double drag = 2.0 * effects.drag * frame.weight[p] * frame.normal[p];
      double* const dragged = row(by_drag, p);
      for (Index i = 0; i < m; ++i) {
        dragged[i] = n[i] * drag;
        angle[i] = angle[i] - dragged[i] * v_t - t[i] * pressure[p];
        by_x[i] = dragged[i] * (c / measure[p]);
        by_y[i] = dragged[i] * (-s / measure[p]);
      }
    }
    if (loads) {
      for (Index i = 0; i < m; ++i) {
        by_x[i] = (drags ? by_x[i] : 0.0) - terms.by_velocity(p, i);
        by_y[i] = (drags ? by_y[i] : 0.0) - terms.by_velocity(p, m + i);
        angle[i] -= terms.by_angle(p, i) * measure[p];
      }
    }
  }
  // Rows of the system belong to orthonormal coordinates, columns to the basis.
  const Orthonormal& functions = grids_.orthonormal();
  system.setZero(m, 2 * m);
  WritableSlab by_q = system.leftCols(m), by_qdot = system.rightCols(m);
  if (drags || loads) {
    swept.setZero(m, m);
    if (drags) add_inner(swept, -1.0, across.topRows(heavy), by_drag.topRows(heavy));
    if (loads) {
      swept += inner_of_both(xy, measure, terms.by_velocity, points);
      add_inner(by_q, 1.0, inner_of_both(xy, measure, terms.by_position, points),
                functions.inverse);
    }
    integrate_beyond(grid, integrand, sums);
    for (Index p = 0; p < points; ++p) {
      const double across_x = sine[p] * omega[p], across_y = cosine[p] * omega[p];
      const double *const x = row(sums, p), *const y = x + m;
      double* const angle = row(by_angle, p);
      for (Index i = 0; i < m; ++i) angle[i] = angle[i] - x[i] * across_x - y[i] * across_y;
    }
    add_inner(by_qdot, 1.0, swept, functions.inverse);
  }
  add_inner(by_q, -1.0, by_angle, slope);
  add_inner(by_qdot, -1.0, by_rate.topRows(heavy), slope.topRows(heavy));
  for (Index i = 0; i < m; ++i) {
    for (Index j = 0; j < m; ++j) {
      const double elastic = functions.to_basis(j, i) * grid.tables().stiffness[j];
      system(i, j) -= elastic;
      system(i, m + j) -= effects.damping * elastic;
    }
  }
  const bool positive = solve_positive(factors, mass, system);
  std::fill_n(out, 2 * m * m, 0.0);
  for (Index i = 0; i < m; ++i) out[i * 2 * m + m + i] = 1.0;
  double* const rows = out + 2 * m * m;
  multiply_upper(rows, functions.to_basis, system);
  if (!positive || !grids_.resolves(number, y, 1)) std::fill_n(rows, 2 * m * m, not_a_number);
}

Operators GalerkinMotion::operators(const Vector& q) const {
  const Index m = dof();
  require_amplitudes(q.size(), m);
  const Grid& grid = grids_[grids_.choose(q.data(), 1)];
  const Index heavy = grid.heavy(), points = grid.tables().points, last = points - 1;
  const Matrix& slope = grid.slope();
  Frame frame;
  Matrix integrand, xy, along, across;
  frame.set(grid, q, Vector::Zero(m));
  set_position_derivatives(grid, frame, slope, integrand, xy);
  set_directions(frame, xy, along, across);
  const Vector &sine = frame.sine, &cosine = frame.cosine, &weight = grid.weight();
  TermLoads terms;
  Matrix bears = Matrix::Zero(points, 2);
  const bool loads = !grids_.panels().loads.empty();
  if (loads) {
    frame.velocity.setZero(points, 2);
    frame.set_position(grid);
    terms.set(grid, grids_.panels(), frame, xy);
    integrate_beyond(grid, terms.load, bears);
  }
  // J_i turns by -t Theta_i Theta_j: its projection on the end's tangent is that of two tangents.
  Vector shortening(points), tension(points);
  for (Index p = 0; p < points; ++p) {
    const double s = sine[p], c = cosine[p];
    shortening[p] = -(weight[p] * (sine[last] * s + cosine[last] * c));
    tension[p] = pipe_.gamma * weight[p] * grid.tables().beyond[p] * c;
    tension[p] += s * bears(p, 0) + c * bears(p, 1);
  }
  const auto integral = [&](const Matrix& a, const Vector& of) {
    return inner(a.topRows(heavy), of.head(heavy), slope.topRows(heavy));
  };
  Operators ops(m);
  ops.mass = inner_of_both(xy, grid.mass().head(heavy), xy, heavy);
  ops.flux = integral(slope, shortening);
  if (loads) {
    ops.stiffness -= inner_of_both(terms.by_position, grid.measure(), xy, points);
    ops.stiffness -= inner(terms.by_angle, grid.measure(), slope);
    ops.damping -= inner_of_both(terms.by_velocity, grid.measure(), xy, points);
  }
  if (!tension.isZero(0.0)) ops.stiffness += integral(slope, tension);
  const double* const end = row(xy, last);
  add_flow_and_bending(pipe_, integral(across, weight),
                       {end, end + m, row(across, last), row(slope, last)},
                       Map(grid.tables().stiffness, m), ops);
  return ops;
}

}  // namespace pipedyn
