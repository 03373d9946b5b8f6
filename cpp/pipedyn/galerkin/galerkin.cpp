// SPDX-License-Identifier: MIT
#include "pipedyn/galerkin/galerkin.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "pipedyn/terms/laws.hpp"
#include "pipedyn/vector/levels.hpp"

namespace pipedyn {

namespace {

constexpr double not_a_number = std::numeric_limits<double>::quiet_NaN();

const GalerkinKernel& kernel() { return *motion_kernel().galerkin; }

/// Calls the kernel's function for blocks of members that take the same grid, one alone or as many
/// as the vectors hold, and writes its results (results, members of the block) to all
/// (results, members); NaN for those that bend more than the largest grid resolves.
void evaluate(const GalerkinKernel::Function function, const Grids& grids,
              const MotionEffects& effects, const Batch& batch, Index results, double* all) {
  static thread_local std::vector<Index> grid_of, chosen;
  static thread_local std::vector<double> numbers;
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
    numbers.resize(static_cast<std::size_t>((state + 1 + results) * width));
    double* const y = numbers.data();
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
      function(grid.tables, effects, block, out);
      for (Index i = 0; i < results; ++i) {
        for (Index b = 0; b < used; ++b) all[i * members + member[b]] = out[i * width + b];
      }
    }
    for (const Index k : chosen) {
      if (grids.resolves(number, batch.y + k, members)) continue;
      for (Index i = 0; i < results; ++i) all[i * members + k] = not_a_number;
    }
  }
}

MotionEffects effects_of(const Pipe& pipe, const Panels& panels) {
  return {.coriolis = 2.0 * pipe.direction() * pipe.sqrt_beta(),
          .centrifugal = pipe.centrifugal,
          .gamma = pipe.gamma,
          .drag = pipe.drag,
          .damping = pipe.damping,
          .loads = panels.loads.data(),
          .load_count = static_cast<Index>(panels.loads.size())};
}

/// Row p, for loops over its columns: expressions of Eigen took twice as long to compile.
double* row(Matrix& matrix, Index p) { return matrix.data() + p * matrix.cols(); }

/// Sum over points and components of weight a b (m, m); a and b (points or more, 2 padded) have the
/// columns of x before those of y.
Matrix inner_of_both(const Slab& a, const Eigen::Ref<const Vector>& weight, const Slab& b,
                     Index m) {
  const Index points = weight.size(), padded = a.cols() / 2;
  Matrix sum = inner(a.block(0, 0, points, m), weight, b.block(0, 0, points, m));
  sum += inner(a.block(0, padded, points, m), weight, b.block(0, padded, points, m));
  return sum;
}

/// What the virtual work is about a state, with all that it is made of: matrices of one shape, so
/// that they are allocated once. Rows belong to virtual displacements along the functions that the
/// tables call orthonormal, columns of the system to the basis. Reads the thread's scratch from
/// `move` on.
class Linearisation {
 public:
  Matrix system;  // derivatives of all forces but bending's, inertia's at fixed q'', by q, then by
                  // q', (m, 2 m)

  /// Moves the pipe to a state y; writes q'' (m,) unless that is null.
  void move(const Grid& grid, const GridTables& tables, const MotionEffects& effects,
            const double* y, double u, double* acceleration) {
    grid_ = &grid;
    tables_ = tables;
    line_ = kernel().kinematics(tables, effects, {y, &u, 1, 0}, acceleration);
  }

  /// The straight pipe's displacements (N, m), to more digits than as integrals of the slopes.
  void set_displacements(const Matrix& w) {
    for (Index p = 0; p < w.rows(); ++p) {
      std::copy_n(w.data() + p * w.cols(), w.cols(), line_.columns + p * line_.row);
    }
  }

  /// The derivatives at the state and its q'' (m,). functions: those of the rows.
  void derive(const MotionEffects& effects, double u, const Vector& acceleration,
              const Orthonormal& functions);

  /// Mass matrix, its columns like its rows, (m, m).
  Matrix mass() const {
    const auto xy = position_derivatives();
    return inner_of_both(xy, grid_->mass.head(tables_.heavy), xy, tables_.functions);
  }

  /// Derivatives of the position at the points by the rows' coordinates, x then y (N, 2 padded).
  Eigen::Map<const Matrix, 0, Eigen::OuterStride<>> position_derivatives() const {
    return {line_.columns, tables_.points, 2 * tables_.padded, Eigen::OuterStride<>(line_.row)};
  }

 private:
  const double* columns(Index p) const { return line_.columns + p * line_.row; }
  void integrate_beyond();
  void add_terms(const MotionEffects& effects);

  const Grid* grid_ = nullptr;
  GridTables tables_{};
  Kinematics line_{};
  /// Of each point, in its measure: derivatives of the inertia by the virtual displacements, those
  /// by x before those by y (2 padded); of the resistance by the velocities, where there is drag or
  /// a term (2 padded); at `force_`, x and y of the load. Then all beyond each node.
  Matrix loads_, beyond_;
  Index force_ = 0;
  Matrix by_position_, by_velocity_;  // of terms' loads, times the virtual displacements, (N, 2
                                      // padded): by x, then by y
  Matrix by_angle_, by_rate_, across_, swept_;
  Vector spin_, own_acceleration_, pressure_, dragged_;
};

/// Of the loads, each in its point's measure, all beyond each node, in its weight. The quadrature's
/// integration by parts, S^T W = w w^T - W S, gives those of the nodes.
void Linearisation::integrate_beyond() {
  const Index points = loads_.rows(), columns = force_ + 2, block = tables_.nodes + 1;
  beyond_.resize(points, loads_.cols());
  kernel().integrate(tables_, loads_.cols(), columns, loads_.data(), beyond_.data());
  Vector all = beyond_.row(points - 1);
  for (Index p = points - 1; p >= 0; --p) {
    const double weight = tables_.weight[p];
    const double* const here = row(loads_, p);
    double* const beyond = row(beyond_, p);
    const bool end = (p + 1) % block == 0;
    for (Index i = 0; i < columns; ++i) {
      if (end) all[i] += here[i];
      beyond[i] = weight * (all[i] - beyond[i]);
    }
  }
}

/// Takes terms' loads from the force, and sets their slopes times the virtual displacements.
void Linearisation::add_terms(const MotionEffects& effects) {
  const Index points = tables_.points, padded = tables_.padded, block = tables_.nodes + 1;
  by_position_.setZero(points, 2 * padded);
  by_velocity_.setZero(points, 2 * padded);
  for (Index k = 0; k < effects.load_count; ++k) {
    const PanelTerm& placed = effects.loads[k];
    Laws::with(placed.term, [&](const auto& law) {
      for (Index p = 0; p < points; ++p) {
        const bool end = (p + 1) % block == 0;
        if (placed.panel < 0 ? end : p + 1 != (placed.panel + 1) * block) continue;
        const double *const x = columns(p), *const y = x + padded;
        const double *const velocity = y + padded + 2, *const position = velocity + 2;
        const Station<double> at{position[0], position[1], line_.sine[p], line_.cosine[p],
                                 velocity[0], velocity[1], line_.omega[p]};
        const Load<double> load = law.load(at);
        loads_(p, force_) -= load.x;
        loads_(p, force_ + 1) -= load.y;
        const Slopes slopes = law.slopes(at);
        for (Index i = 0; i < padded; ++i) {
          const auto along = [&](double by_x, double by_y) { return by_x * x[i] + by_y * y[i]; };
          for (Index c = 0; c < 2; ++c) {
            by_position_(p, c * padded + i) +=
                along(slopes.by_position[0][c], slopes.by_position[1][c]);
            by_velocity_(p, c * padded + i) +=
                along(slopes.by_velocity[0][c], slopes.by_velocity[1][c]);
          }
          by_angle_(p, i) -= grid_->measure[p] * along(slopes.by_angle[0], slopes.by_angle[1]);
        }
      }
    });
  }
}

void Linearisation::derive(const MotionEffects& effects, double u, const Vector& acceleration,
                           const Orthonormal& functions) {
  const Index m = tables_.functions, padded = tables_.padded;
  const Index points = tables_.points, last = points - 1;
  const Vector& measure = grid_->measure;
  const double *const weight = tables_.weight, *const omega = line_.omega;
  const double *const sine = line_.sine, *const cosine = line_.cosine;
  const double coriolis = effects.coriolis * u, thrust = effects.centrifugal * u * u;
  const bool drags = effects.drag != 0.0, loads = effects.load_count > 0;
  const Slab slope = grid_->slope.leftCols(m), inverse = functions.inverse;
  spin_.noalias() = slope * acceleration;  // second derivative of the angle
  own_acceleration_.noalias() = inverse * acceleration;

  const Index resisted = 2 * padded;
  force_ = drags || loads ? 2 * resisted : resisted;
  loads_.resize(points, force_ + GridTables::widest);
  across_.resize(points, padded);
  pressure_.setZero(points);
  dragged_.setZero(points);
  for (Index p = 0; p < points; ++p) {
    const double *const x = columns(p), *const y = x + padded;
    const double density = tables_.mass[p] / measure[p];
    double a_x = y[padded], a_y = y[padded + 1];
    for (Index i = 0; i < m; ++i) {
      a_x += x[i] * own_acceleration_[i];
      a_y += y[i] * own_acceleration_[i];
    }
    if (drags) pressure_[p] = effects.drag * line_.weight[p] * (line_.normal[p] * line_.normal[p]);
    const double across = (coriolis * weight[p] * omega[p] + pressure_[p]) / measure[p];
    double *const load = row(loads_, p), *const n = row(across_, p);
    std::fill_n(load + force_, GridTables::widest, 0.0);
    load[force_] = density * a_x + across * cosine[p];
    load[force_ + 1] = density * (a_y - effects.gamma) - across * sine[p];
    for (Index i = 0; i < 2 * padded; ++i) load[i] = density * x[i];
    for (Index i = 0; i < padded; ++i) n[i] = x[i] * cosine[p] - y[i] * sine[p];
    if (!drags && !loads) continue;
    if (drags) dragged_[p] = 2.0 * effects.drag * line_.weight[p] * line_.normal[p];
    const double by_x = dragged_[p] * cosine[p] / measure[p];
    const double by_y = -dragged_[p] * sine[p] / measure[p];
    for (Index i = 0; i < padded; ++i) {
      load[resisted + i] = by_x * n[i];
      load[resisted + padded + i] = by_y * n[i];
    }
  }
  by_angle_.setZero(points, padded);
  if (loads) {
    add_terms(effects);
    loads_.middleCols(resisted, 2 * padded) -= by_velocity_;
  }
  integrate_beyond();

  // Row i of the derivatives is the sum over points of these times Theta_j.
  by_rate_.resize(points, padded);
  for (Index p = 0; p < points; ++p) {
    const double c = cosine[p], s = sine[p], w = omega[p], square = w * w, spin = spin_[p];
    const double *const x = columns(p), *const y = x + padded, *const velocity = y + padded + 2;
    const double* const beyond_x = row(beyond_, p);
    const double load_x = beyond_x[force_] + thrust * sine[last] * weight[p];
    const double load_y = beyond_x[force_ + 1] + thrust * cosine[last] * weight[p];
    const double bent = -s * load_x - c * load_y, flow = coriolis * weight[p];
    const double forward = flow * w + pressure_[p];  // load across the pipe, turned along it
    double sideways = p == last ? thrust : 0.0;
    if (drags) sideways -= dragged_[p] * (s * velocity[0] + c * velocity[1]);
    const double *const theta = tables_.orthonormal + p * padded, *const n = row(across_, p);
    const double *const beyond_y = beyond_x + padded, *const resisted_x = beyond_x + resisted;
    double *const angle = row(by_angle_, p), *const rate = row(by_rate_, p);
    for (Index i = 0; i < padded; ++i) {
      const double along = x[i] * s + y[i] * c;
      const double beyond_t = beyond_x[i] * s + beyond_y[i] * c;
      const double beyond_n = beyond_x[i] * c - beyond_y[i] * s;
      angle[i] += theta[i] * bent - beyond_t * spin - beyond_n * square;
      angle[i] += n[i] * sideways - along * forward;
      rate[i] = beyond_t * (-2.0 * w) + n[i] * flow;
    }
    if (!drags && !loads) continue;
    for (Index i = 0; i < padded; ++i) {
      angle[i] -= resisted_x[i] * (s * w) + resisted_x[padded + i] * (c * w);
    }
  }

  system.setZero(m, 2 * m);
  WritableSlab by_q = system.leftCols(m), by_qdot = system.rightCols(m);
  if (drags || loads) {
    const Slab across = across_.leftCols(m);
    swept_ = inner(across, -dragged_, across);
    if (loads) {
      const auto by_coordinates = position_derivatives();
      swept_ += inner_of_both(by_coordinates, measure, by_velocity_, m);
      add_inner(by_q, 1.0, inner_of_both(by_coordinates, measure, by_position_, m),
                functions.inverse);
    }
    add_inner(by_qdot, 1.0, swept_, functions.inverse);
  }
  add_inner(by_q, -1.0, by_angle_.leftCols(m), slope);
  add_inner(by_qdot, -1.0, by_rate_.leftCols(m), slope);
}

/// Operators about a configuration q at rest.
Operators operators_at(const Grid& grid, const Basis& basis, const MotionEffects& effects,
                       double sqrt_beta, const Vector& q) {
  const Index m = q.size(), last = grid.tables.points - 1;
  const Orthonormal functions(m);
  const Vector still = Vector::Zero(m);
  Vector y(2 * m);
  y << q, still;
  MotionEffects rest = effects;  // what does not depend on the flow; drag has no linear part
  rest.coriolis = rest.centrifugal = rest.drag = 0.0;
  const MotionEffects flow{.coriolis = 2.0 * sqrt_beta, .centrifugal = 1.0};
  GridTables in_basis = grid.tables;  // the basis' functions for the orthonormal ones
  in_basis.orthonormal = grid.slope.data();
  in_basis.to_basis = nullptr;
  Linearisation about;
  about.move(grid, in_basis, rest, y.data(), 1.0, nullptr);
  if (q.isZero(0.0)) about.set_displacements(basis.evaluate(grid.places, 0));
  Operators ops(m);
  about.derive(rest, 1.0, still, functions);
  ops.mass = about.mass();
  ops.stiffness = -about.system.leftCols(m);
  ops.damping = -about.system.rightCols(m);
  for (Index i = 0; i < m; ++i) {
    ops.stiffness(i, i) += in_basis.stiffness[i];
    ops.damping(i, i) += effects.damping * in_basis.stiffness[i];
  }
  about.derive(flow, 1.0, still, functions);
  ops.flux = -about.system.leftCols(m);
  const Matrix coriolis = -about.system.rightCols(m);
  ops.gyroscopic = 0.5 * (coriolis - coriolis.transpose());
  const auto end = about.position_derivatives().row(last);
  const Matrix carried = inner_of_both(end, Vector::Constant(1, sqrt_beta), end, m);
  ops.end_flux = 0.5 * (carried + carried.transpose());
  return ops;
}

void require_amplitudes(Index entries, Index m) {
  if (entries != m) {
    throw std::invalid_argument("q must have " + std::to_string(m) + " entries, got " +
                                std::to_string(entries));
  }
}

}  // namespace

Galerkin::Galerkin(const Pipe& pipe, Basis basis, Index least_nodes)
    : pipe_(pipe), basis_(std::move(basis)), least_nodes_(least_nodes) {}

const Grids& Galerkin::grids() const {
  std::call_once(moved_, [this] {
    grids_ = std::make_unique<Grids>(basis_, pipe_.terms, pipe_.drag != 0.0, least_nodes_);
  });
  return *grids_;
}

Operators Galerkin::operators(const Vector& q) const {
  if (q.size() > 0) {
    require_amplitudes(q.size(), dof());
    const Grid& grid = grids()[grids().choose(q.data(), 1)];
    return operators_at(grid, basis_, effects_of(pipe_, grids().panels()), pipe_.sqrt_beta(), q);
  }
  // Legendre products are polynomials of twice a panel's functions and 2; beam mode m has about
  // m / 2 waves and a layer of width 1 / (m pi) at either end.
  const bool beam = basis_.family() == Family::beam;
  const Index nodes = beam ? 2 * dof() + 30 : basis_.most_on_a_panel() + 3;
  const Panels panels(basis_, pipe_.terms);
  const Grid grid(basis_, Orthonormal(dof()), panels, whole(nodes + 1, GridTables::multiple) - 1);
  return operators_at(grid, basis_, effects_of(pipe_, panels), pipe_.sqrt_beta(),
                      Vector::Zero(dof()));
}

Index Galerkin::nodes(const Vector& q) const {
  require_amplitudes(q.size(), dof());
  return grids()[grids().choose(q.data(), 1)].tables.nodes;
}

void Galerkin::rhs(const Batch& batch, double* rates) const {
  const Index m = dof(), members = batch.members;
  std::copy(batch.y + m * members, batch.y + 2 * m * members, rates);
  evaluate(kernel().accelerations, grids(), effects_of(pipe_, grids().panels()), batch, m,
           rates + m * members);
}

void Galerkin::rhs_and_power(const Batch& batch, double* rates) const {
  rhs(batch, rates);
  const Index members = batch.members;
  Matrix parts(4, members);
  power(batch, parts.data());
  Eigen::Map<Vector>(rates + 2 * dof() * members, members) = parts.colwise().sum();
}

void Galerkin::energy(const Batch& batch, double* out) const {
  evaluate(kernel().energy, grids(), effects_of(pipe_, grids().panels()), batch, 1, out);
}

void Galerkin::power(const Batch& batch, double* out) const {
  evaluate(kernel().power, grids(), effects_of(pipe_, grids().panels()), batch, 4, out);
}

void Galerkin::jacobian(const double* y, double u, double* out) const {
  static thread_local Linearisation at;
  static thread_local Vector acceleration;
  static thread_local Eigen::LLT<Matrix> factors;
  const Index m = dof(), number = grids().choose(y, 1);
  const Grid& grid = grids()[number];
  const Orthonormal& functions = grids().orthonormal();
  const MotionEffects effects = effects_of(pipe_, grids().panels());
  acceleration.resize(m);
  at.move(grid, grid.tables, effects, y, u, acceleration.data());
  at.derive(effects, u, acceleration, functions);
  for (Index i = 0; i < m; ++i) {
    for (Index j = 0; j < m; ++j) {
      const double elastic = functions.to_basis(j, i) * grid.tables.stiffness[j];
      at.system(i, j) -= elastic;
      at.system(i, m + j) -= effects.damping * elastic;
    }
  }
  factors.compute(at.mass());
  factors.solveInPlace(at.system);
  const bool known = factors.info() == Eigen::Success && grids().resolves(number, y, 1);
  Eigen::Map<Matrix> whole(out, 2 * m, 2 * m);
  whole.setZero();
  for (Index i = 0; i < m; ++i) {
    whole(i, m + i) = 1.0;
    double* const to = out + (m + i) * 2 * m;
    for (Index j = i; j < m; ++j) {
      const double factor = known ? functions.to_basis(i, j) : not_a_number;
      const double* const from = row(at.system, j);
      for (Index k = 0; k < 2 * m; ++k) to[k] += factor * from[k];
    }
  }
}

}  // namespace pipedyn
