// SPDX-License-Identifier: MIT
#include "pipedyn/galerkin/motion.hpp"

#include <algorithm>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "pipedyn/products.hpp"
#include "pipedyn/terms/laws.hpp"
#include "pipedyn/vector/levels.hpp"
#include "pipedyn/vector/scratch.hpp"

namespace pipedyn {

namespace {

using Map = Eigen::Map<const Vector>;
using Strided = Eigen::Map<const Vector, 0, Eigen::InnerStride<>>;

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
  const Index last = out.rows() - 1, block = grid.nodes() + 1;
  Eigen::RowVectorXd all = out.row(last);
  for (Index p = last; p >= 0; --p) {
    if ((p + 1) % block == 0) all += f.row(p);
    out.row(p) = grid.weight()[p] * (all - out.row(p));
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
    angle.noalias() = grid.slope() * q;
    omega.noalias() = grid.slope() * rate;
    sine.resize(angle.size());
    cosine.resize(angle.size());
    const MotionKernel& level = motion_kernel();
    level.sincos(angle.data(), angle.size(), sine.data(), cosine.data(),
                 pipedyn::scratch(3 * level.width));
  }

  void set_velocity(const Grid& grid) {
    integrand.resize(angle.size(), 2);
    integrand.col(0) = cosine.cwiseProduct(omega);
    integrand.col(1) = -sine.cwiseProduct(omega);
    integrate(grid, integrand, velocity);
  }

  void set_position(const Grid& grid) {
    integrand.resize(angle.size(), 2);
    integrand.col(0) = sine;
    integrand.col(1) = cosine;
    integrate(grid, integrand, position);
  }

  void set_drag(const Grid& grid) {
    normal = cosine.cwiseProduct(velocity.col(0)) - sine.cwiseProduct(velocity.col(1));
    weight.resize(normal.size());
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
  integrand.leftCols(m).noalias() = frame.cosine.asDiagonal() * slopes;
  integrand.rightCols(m).noalias() = -(frame.sine.asDiagonal() * slopes);
  integrate(grid, integrand, xy);
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
          load.row(p) += Eigen::RowVector2d(force.x, force.y);
          add(law.slopes(at), xy, p);
        }
      });
    }
  }

 private:
  void add(const Slopes& slopes, const Matrix& xy, Index p) {
    const Index m = xy.cols() / 2;
    const auto x = xy.row(p).head(m), y = xy.row(p).tail(m);
    for (Index k = 0; k < 2; ++k) {
      by_position.row(p).segment(k * m, m) +=
          slopes.by_position[0][k] * x + slopes.by_position[1][k] * y;
      by_velocity.row(p).segment(k * m, m) +=
          slopes.by_velocity[0][k] * x + slopes.by_velocity[1][k] * y;
    }
    by_angle.row(p) += slopes.by_angle[0] * x + slopes.by_angle[1] * y;
  }
};

/// Sum over points and components of a times b in their measure; both x, then y (N, 2 m).
Matrix inner_of_both(const Grid& grid, const Matrix& a, const Matrix& b) {
  const Index m = a.cols() / 2;
  return inner(a.leftCols(m), grid.measure(), b.leftCols(m)) +
         inner(a.rightCols(m), grid.measure(), b.rightCols(m));
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
    Matrix integrand, xy, along, across, sums, sum_along, sum_across;
    Matrix by_angle, by_rate, by_drag, turn, weighted, force, mass, elastic, swept, system;
    Vector acceleration, spin, pressure, factor;
    Cholesky factors;
  };
  static thread_local Workspace work;
  auto& [frame, terms, integrand, xy, along, across, sums, sum_along, sum_across, by_angle, by_rate,
         by_drag, turn, weighted, force, mass, elastic, swept, system, acceleration, spin, pressure,
         factor, factors] = work;
  const Index m = dof();
  const Map q(y, m), rate(y + m, m);
  const Index number = grids_.choose(y, 1);
  const Grid& grid = grids_[number];
  const Index heavy = grid.heavy(), last = grid.slope().rows() - 1;
  const Matrix& slope = grid.slope();
  const auto weight = grid.weight().array(), measure = grid.measure().array();
  const MotionEffects effects = this->effects();
  const double coriolis = effects.coriolis * u, thrust = effects.centrifugal * u * u;
  const bool drags = effects.drag != 0.0, loads = effects.load_count > 0;

  acceleration.resize(m);
  kernel().accelerations(grid.tables(), effects, {y, &u, 1, 0}, acceleration.data(),
                         scratch(kernel().scratch_size(grid.tables(), 1)));
  frame.set(grid, q, rate);
  const auto orthonormal = grid.orthonormal().leftCols(m);
  set_position_derivatives(grid, frame, orthonormal, integrand, xy);
  const auto jx = xy.leftCols(m), jy = xy.rightCols(m);
  const auto s = frame.sine.array(), c = frame.cosine.array(), omega = frame.omega.array();
  spin.noalias() = slope * acceleration;  // second derivative of the angle

  // Load of each point, in its measure: inertia less the forces; at the end the follower force.
  turn.resize(last + 1, 2);
  turn.col(0) = c * spin.array() - s * omega.square();
  turn.col(1) = -s * spin.array() - c * omega.square();
  integrate(grid, turn, force);
  const auto density = grid.mass().array() / measure;
  force.array().colwise() *= density;
  auto load_x = force.col(0).array(), load_y = force.col(1).array();
  if (coriolis != 0.0) {
    const auto inside = weight / measure;  // 0 at panels' ends
    load_x += coriolis * inside * omega * c;
    load_y -= coriolis * inside * omega * s;
  }
  if (effects.gamma != 0.0) load_y -= effects.gamma * density;
  if (drags || loads) frame.set_velocity(grid);
  if (drags) {
    frame.set_drag(grid);
    pressure = effects.drag * frame.weight.array() * frame.normal.array().square();
    load_x += pressure.array() * c / measure;
    load_y -= pressure.array() * s / measure;
  }
  if (loads) {
    frame.set_position(grid);
    terms.set(grid, grids_.panels(), frame, xy);
    force -= terms.load;
  }
  integrate_beyond(grid, force, weighted);
  weighted.col(0).array() += thrust * s[last] * weight;
  weighted.col(1).array() += thrust * c[last] * weight;

  // Virtual displacements along t and n, and what is beyond of them.
  along = jx.array().colwise() * s + jy.array().colwise() * c;
  across = jx.array().colwise() * c - jy.array().colwise() * s;
  integrand.noalias() = grid.mass().asDiagonal() * xy;
  mass.setZero(m, m);
  add_inner(mass, 1.0, integrand.leftCols(m).topRows(heavy), jx.topRows(heavy));
  add_inner(mass, 1.0, integrand.rightCols(m).topRows(heavy), jy.topRows(heavy));
  integrand = xy.array().colwise() * density;
  integrate_beyond(grid, integrand, sums);
  sum_along = sums.leftCols(m).array().colwise() * s + sums.rightCols(m).array().colwise() * c;
  sum_across = sums.leftCols(m).array().colwise() * c - sums.rightCols(m).array().colwise() * s;

  // Row i of the derivatives is the sum over points of these times Theta_j.
  const auto times = [&factor = factor](const auto& expression) {  // no temporary in a broadcast
    factor = expression;
    return factor.array();
  };
  by_angle = orthonormal.array().colwise() *
             times(-s * weighted.col(0).array() - c * weighted.col(1).array());
  auto angle = by_angle.array();
  angle -= sum_along.array().colwise() * spin.array();
  angle -= sum_across.array().colwise() * times(omega.square());
  by_angle.row(last) += thrust * across.row(last);
  by_rate = sum_along.array().colwise() * times(-2.0 * omega);
  if (coriolis != 0.0) {
    angle -= along.array().colwise() * times(coriolis * weight * omega);
    by_rate.array() += across.array().colwise() * times(coriolis * weight);
  }
  // Rows of the system belong to orthonormal coordinates, columns to the basis.
  const Orthonormal& functions = grids_.orthonormal();
  system.setZero(m, 2 * m);
  if (drags || loads) {
    swept.setZero(m, m);
    integrand.setZero();
    if (drags) {
      const auto v_t = s * frame.velocity.col(0).array() + c * frame.velocity.col(1).array();
      by_drag = across.array().colwise() *
                times(2.0 * effects.drag * frame.weight.array() * frame.normal.array());
      angle -= by_drag.array().colwise() * times(v_t);
      angle -= along.array().colwise() * pressure.array();
      integrand.leftCols(m) = by_drag.array().colwise() * times(c / measure);
      integrand.rightCols(m) = by_drag.array().colwise() * times(-s / measure);
      add_inner(swept, -1.0, across.topRows(heavy), by_drag.topRows(heavy));
    }
    if (loads) {
      integrand -= terms.by_velocity;
      swept += inner_of_both(grid, xy, terms.by_velocity);
      angle -= terms.by_angle.array().colwise() * measure;
      add_inner(system.leftCols(m), 1.0, inner_of_both(grid, xy, terms.by_position),
                functions.inverse);
    }
    integrate_beyond(grid, integrand, sums);
    angle -= sums.leftCols(m).array().colwise() * times(s * omega);
    angle -= sums.rightCols(m).array().colwise() * times(c * omega);
    add_inner(system.rightCols(m), 1.0, swept, functions.inverse);
  }
  add_inner(system.leftCols(m), -1.0, by_angle, slope);
  add_inner(system.rightCols(m), -1.0, by_rate.topRows(heavy), slope.topRows(heavy));
  const Map stiffness(grid.tables().stiffness, m);
  elastic.noalias() = functions.to_basis.transpose() * stiffness.asDiagonal();
  system.leftCols(m) -= elastic;
  if (effects.damping != 0.0) system.rightCols(m) -= effects.damping * elastic;
  const bool positive = solve_positive(factors, mass, system);
  Eigen::Map<Matrix> result(out, 2 * m, 2 * m);
  result.topLeftCorner(m, m).setZero();
  result.topRightCorner(m, m).setIdentity();
  multiply_upper(result.bottomRows(m), functions.to_basis, system);
  if (!positive || !grids_.resolves(number, y, 1)) {
    result.bottomRows(m).setConstant(not_a_number);
  }
}

Operators GalerkinMotion::operators(const Vector& q) const {
  const Index m = dof();
  require_amplitudes(q.size(), m);
  const Grid& grid = grids_[grids_.choose(q.data(), 1)];
  const Index heavy = grid.heavy(), last = grid.slope().rows() - 1;
  const Matrix& slope = grid.slope();
  const Map stiffness(grid.tables().stiffness, m), beyond(grid.tables().beyond, last + 1);
  Frame frame;
  Matrix integrand, xy;
  frame.set(grid, q, Vector::Zero(m));
  set_position_derivatives(grid, frame, slope, integrand, xy);
  const auto x = xy.leftCols(m), y = xy.rightCols(m);
  const auto s = frame.sine.array(), c = frame.cosine.array();
  const auto weight = grid.weight().array();
  const auto integral = [heavy](const Slab& a, const Vector& of, const Slab& b) {
    return inner(a.topRows(heavy), of.head(heavy), b.topRows(heavy));
  };
  Operators ops(m);
  ops.mass = integral(x, grid.mass(), x) + integral(y, grid.mass(), y);
  const Matrix across = x.array().colwise() * c - y.array().colwise() * s;
  const Matrix coriolis = integral(across, grid.weight(), slope);
  ops.gyroscopic = pipe_.sqrt_beta() * (coriolis - coriolis.transpose());
  const auto end_x = x.row(last), end_y = y.row(last);
  ops.end_flux = pipe_.sqrt_beta() * (end_x.transpose() * end_x + end_y.transpose() * end_y);
  // J_i turns by -t Theta_i Theta_j: its projection on the end's tangent is that of two tangents.
  const Vector shortening = -(weight * (s[last] * s + c[last] * c)).matrix();
  ops.flux = across.row(last).transpose() * slope.row(last) + integral(slope, shortening, slope);
  ops.damping.diagonal() = pipe_.damping * stiffness;
  Vector tension = pipe_.gamma * weight * beyond.array() * c;
  if (!grids_.panels().loads.empty()) {
    TermLoads terms;
    Matrix bears;
    frame.velocity.setZero(last + 1, 2);
    frame.set_position(grid);
    terms.set(grid, grids_.panels(), frame, xy);
    integrate_beyond(grid, terms.load, bears);
    tension.array() += s * bears.col(0).array() + c * bears.col(1).array();
    ops.stiffness = -inner_of_both(grid, terms.by_position, xy);
    ops.stiffness -= inner(terms.by_angle, grid.measure(), slope);
    ops.damping -= inner_of_both(grid, terms.by_velocity, xy);
  }
  if (!tension.isZero(0.0)) ops.stiffness += integral(slope, tension, slope);
  ops.stiffness.diagonal() += stiffness;
  return ops;
}

}  // namespace pipedyn
