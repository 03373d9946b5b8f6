// SPDX-License-Identifier: MIT
#include "pipedyn/galerkin/motion.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <limits>
#include <stdexcept>
#include <utility>
#include <vector>

#include "pipedyn/products.hpp"
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

/// Integrals from 0 to each point (Q + 1, columns) of what f is at the nodes, its first Q rows.
void integrate(const Grid& grid, const Matrix& f, Matrix& out) {
  const GridTables& tables = grid.tables();
  out.resize(grid.nodes() + 1, f.cols());
  kernel().integrate(tables, f.data(), f.cols(), out.data(),
                     scratch(kernel().integrals_scratch_size(tables, f.cols())));
}

/// Transposed: of loads f in each node's weight, all beyond each node, in its weight (Q, columns).
/// The quadrature's integration by parts, S^T W = w w^T - W S, gives them; out has a row more.
void integrate_beyond(const Grid& grid, const Matrix& f, Matrix& out) {
  integrate(grid, f, out);
  const Index nodes = grid.nodes();
  for (Index p = 0; p < nodes; ++p) {
    out.row(p) = grid.rule().weight[p] * (out.row(nodes) - out.row(p));
  }
}

/// Angle, rate and the frame t, n at a grid's points.
struct Frame {
  Vector angle, omega, sine, cosine;
  Matrix velocity;  // (points, 2)
  Vector normal;    // v_n
  Vector weight;    // signed weights, (nodes,)
  Matrix turning;   // n omega at the nodes
  Vector scratch;

  template <class Amplitudes, class Rates>
  void set(const Grid& grid, const Amplitudes& q, const Rates& rate) {
    angle.noalias() = grid.slope() * q;
    omega.noalias() = grid.slope() * rate;
    sine.resize(angle.size());
    cosine.resize(angle.size());
    const MotionKernel& level = motion_kernel();
    level.sincos(angle.data(), angle.size(), sine.data(), cosine.data(),
                 pipedyn::scratch(3 * level.width));
  }

  void set_velocity(const Grid& grid) {
    const Index nodes = grid.nodes();
    turning.resize(nodes, 2);
    turning.col(0) = cosine.head(nodes).cwiseProduct(omega.head(nodes));
    turning.col(1) = -sine.head(nodes).cwiseProduct(omega.head(nodes));
    integrate(grid, turning, velocity);
  }

  void set_drag(const Grid& grid) {
    normal = cosine.cwiseProduct(velocity.col(0)) - sine.cwiseProduct(velocity.col(1));
    weight.resize(grid.nodes());
    scratch.resize(3 * grid.nodes());
    kernel().signed_weights(grid.tables(), normal.data(), weight.data(), scratch.data());
  }
};

/// Derivatives of the position, integral of n Theta_i, at a grid's points: x, then y (Q + 1, 2 m);
/// slopes (points, m) holds the Theta_i.
template <class Slopes>
void set_position_derivatives(const Grid& grid, const Frame& frame, const Slopes& slopes,
                              Matrix& integrand, Matrix& xy) {
  const Index nodes = grid.nodes(), m = slopes.cols();
  const auto slope = slopes.topRows(nodes);
  integrand.resize(nodes, 2 * m);
  integrand.leftCols(m).noalias() = frame.cosine.head(nodes).asDiagonal() * slope;
  integrand.rightCols(m).noalias() = -(frame.sine.head(nodes).asDiagonal() * slope);
  integrate(grid, integrand, xy);
}

}  // namespace

GalerkinMotion::GalerkinMotion(const Pipe& pipe, Basis basis, Index least_nodes)
    : pipe_(pipe), grids_(std::move(basis), pipe.drag != 0.0, least_nodes) {}

MotionEffects GalerkinMotion::effects() const {
  return {.coriolis = 2.0 * pipe_.direction() * pipe_.sqrt_beta(),
          .centrifugal = pipe_.centrifugal,
          .gamma = pipe_.gamma,
          .drag = pipe_.drag,
          .damping = pipe_.damping};
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
    kernel().power(grid.tables(), effects, block, {parts, parts + width, parts + 2 * width}, work);
  };
  double* const parts[] = {out.flow, out.joints, out.drag};
  for_each_block(grids_, batch, 3, evaluate, [&](Index i) { return parts[i]; });
}

void GalerkinMotion::jacobian(const double* y, double u, double* out) const {
  struct Workspace {  // each of one shape, so that it is allocated once
    Frame frame;
    Matrix integrand, xy, along, across, sums, sum_along, sum_across;
    Matrix by_angle, by_rate, by_drag, turn, weighted, force, mass, elastic, dragged, system;
    Vector acceleration, spin, pressure, factor;
    Eigen::LLT<Matrix> factors;
  };
  static thread_local Workspace work;
  auto& [frame, integrand, xy, along, across, sums, sum_along, sum_across, by_angle, by_rate,
         by_drag, turn, weighted, force, mass, elastic, dragged, system, acceleration, spin,
         pressure, factor, factors] = work;
  const Index m = dof();
  const Map q(y, m), rate(y + m, m);
  const Index number = grids_.choose(y, 1);
  const Grid& grid = grids_[number];
  const Index nodes = grid.nodes(), points = nodes + 1;
  const Matrix& slope = grid.slope();
  const Vector& weight = grid.rule().weight;
  const MotionEffects effects = this->effects();
  const double coriolis = effects.coriolis * u, thrust = effects.centrifugal * u * u;
  const bool drags = effects.drag != 0.0;

  acceleration.resize(m);
  kernel().accelerations(grid.tables(), effects, {y, &u, 1, 0}, acceleration.data(),
                         scratch(kernel().scratch_size(grid.tables(), 1)));
  frame.set(grid, q, rate);
  const auto orthonormal = grid.orthonormal().leftCols(m);
  set_position_derivatives(grid, frame, orthonormal, integrand, xy);
  const auto jx = xy.leftCols(m), jy = xy.rightCols(m);
  const auto s = frame.sine.array(), c = frame.cosine.array(), omega = frame.omega.array();
  spin.noalias() = slope * acceleration;  // second derivative of the angle

  // Load of each node, in its weight: inertia less the forces; at the end the follower force.
  const auto s_in = s.head(nodes), c_in = c.head(nodes), omega_in = omega.head(nodes);
  turn.resize(nodes, 2);
  turn.col(0) = c_in * spin.head(nodes).array() - s_in * omega_in.square();
  turn.col(1) = -s_in * spin.head(nodes).array() - c_in * omega_in.square();
  integrate(grid, turn, force);
  auto load_x = force.col(0).head(nodes).array(), load_y = force.col(1).head(nodes).array();
  if (coriolis != 0.0) {
    load_x += coriolis * omega_in * c_in;
    load_y -= coriolis * omega_in * s_in;
  }
  if (effects.gamma != 0.0) load_y -= effects.gamma;
  if (drags) {
    frame.set_velocity(grid);
    frame.set_drag(grid);
    pressure = effects.drag * frame.weight.array() * frame.normal.head(nodes).array().square();
    load_x += pressure.array() * c_in / weight.array();
    load_y -= pressure.array() * s_in / weight.array();
  }
  integrate_beyond(grid, force, weighted);
  weighted.col(0).head(nodes) += thrust * s[nodes] * weight;
  weighted.col(1).head(nodes) += thrust * c[nodes] * weight;

  // Virtual displacements along t and n, and what is beyond of them.
  along = jx.array().colwise() * s + jy.array().colwise() * c;
  across = jx.array().colwise() * c - jy.array().colwise() * s;
  integrand.noalias() = weight.asDiagonal() * xy.topRows(nodes);
  mass.setZero(m, m);
  add_inner(mass, 1.0, integrand.leftCols(m), jx.topRows(nodes));
  add_inner(mass, 1.0, integrand.rightCols(m), jy.topRows(nodes));
  integrate_beyond(grid, xy, sums);
  sum_along = sums.topLeftCorner(nodes, m).array().colwise() * s_in +
              sums.topRightCorner(nodes, m).array().colwise() * c_in;
  sum_across = sums.topLeftCorner(nodes, m).array().colwise() * c_in -
               sums.topRightCorner(nodes, m).array().colwise() * s_in;

  // Row i of the derivatives is the sum over points of these times Theta_j.
  const auto times = [&factor = factor](const auto& expression) {  // no temporary in a broadcast
    factor = expression;
    return factor.array();
  };
  by_angle.resize(points, m);
  by_angle.row(nodes) = thrust * across.row(nodes);
  auto angle = by_angle.topRows(nodes).array();
  angle = orthonormal.topRows(nodes).array().colwise() *
          times(-s_in * weighted.col(0).head(nodes).array() -
                c_in * weighted.col(1).head(nodes).array());
  angle -= sum_along.array().colwise() * spin.head(nodes).array();
  angle -= sum_across.array().colwise() * times(omega_in.square());
  by_rate = sum_along.array().colwise() * times(-2.0 * omega_in);
  if (coriolis != 0.0) {
    angle -= along.topRows(nodes).array().colwise() * times(coriolis * weight.array() * omega_in);
    by_rate.array() += across.topRows(nodes).array().colwise() * times(coriolis * weight.array());
  }
  system.setZero(m, 2 * m);
  if (drags) {
    const auto v_n = frame.normal.head(nodes).array();
    const auto v_t =
        (s * frame.velocity.col(0).array() + c * frame.velocity.col(1).array()).head(nodes);
    by_drag = across.topRows(nodes).array().colwise() *
              times(2.0 * effects.drag * frame.weight.array() * v_n);
    angle -= by_drag.array().colwise() * times(v_t);
    angle -= along.topRows(nodes).array().colwise() * pressure.array();
    integrand.leftCols(m) = by_drag.array().colwise() * times(c_in / weight.array());
    integrand.rightCols(m) = by_drag.array().colwise() * times(-s_in / weight.array());
    integrate_beyond(grid, integrand, sums);
    angle -= sums.topLeftCorner(nodes, m).array().colwise() * times(s_in * omega_in);
    angle -= sums.topRightCorner(nodes, m).array().colwise() * times(c_in * omega_in);
  }
  add_inner(system.leftCols(m), -1.0, by_angle, slope);
  add_inner(system.rightCols(m), -1.0, by_rate, slope.topRows(nodes));
  // Rows belong to orthonormal coordinates, columns to the basis.
  const Orthonormal& functions = grids_.orthonormal();
  const auto to_basis = functions.to_basis.triangularView<Eigen::Upper>();
  if (drags) {
    dragged.setZero(m, m);
    add_inner(dragged, -1.0, across.topRows(nodes), by_drag);
    add_inner(system.rightCols(m), 1.0, dragged, functions.inverse);
  }
  const Map stiffness(grid.tables().stiffness, m);
  elastic.noalias() = functions.to_basis.transpose() * stiffness.asDiagonal();
  system.leftCols(m) -= elastic;
  if (effects.damping != 0.0) system.rightCols(m) -= effects.damping * elastic;
  factors.compute(mass);
  factors.solveInPlace(system);
  Eigen::Map<Matrix> result(out, 2 * m, 2 * m);
  result.topLeftCorner(m, m).setZero();
  result.topRightCorner(m, m).setIdentity();
  result.bottomRows(m).noalias() = to_basis * system;
  if (factors.info() != Eigen::Success || !grids_.resolves(number, y, 1)) {
    result.bottomRows(m).setConstant(not_a_number);
  }
}

Operators GalerkinMotion::operators(const Vector& q) const {
  const Index m = dof();
  require_amplitudes(q.size(), m);
  const Grid& grid = grids_[grids_.choose(q.data(), 1)];
  const Index nodes = grid.nodes();
  const Vector& weight = grid.rule().weight;
  const Matrix& slope = grid.slope();
  const auto slope_in = slope.topRows(nodes);
  const Map stiffness(grid.tables().stiffness, m);
  Frame frame;
  Matrix integrand, xy;
  frame.set(grid, q, Vector(Vector::Zero(m)));
  set_position_derivatives(grid, frame, slope, integrand, xy);
  const auto x = xy.leftCols(m), y = xy.rightCols(m);
  const auto x_in = x.topRows(nodes), y_in = y.topRows(nodes);
  const auto s = frame.sine.head(nodes).array(), c = frame.cosine.head(nodes).array();
  Operators ops(m);
  ops.mass = inner(x_in, weight, x_in) + inner(y_in, weight, y_in);
  const Matrix across = (x_in.array().colwise() * c - y_in.array().colwise() * s).matrix();
  const Matrix coriolis = inner(across, weight, slope_in);
  ops.gyroscopic = pipe_.sqrt_beta() * (coriolis - coriolis.transpose());
  const auto end_x = x.row(nodes), end_y = y.row(nodes);
  ops.end_flux = pipe_.sqrt_beta() * (end_x.transpose() * end_x + end_y.transpose() * end_y);
  const double end_s = frame.sine[nodes], end_c = frame.cosine[nodes];
  // J_i turns by -t Theta_i Theta_j: its projection on the end's tangent is that of two tangents.
  const Vector shortening = -(weight.array() * (end_s * s + end_c * c)).matrix();
  ops.flux = (end_c * end_x - end_s * end_y).transpose() * slope.row(nodes) +
             inner(slope_in, shortening, slope_in);
  ops.damping.diagonal() = pipe_.damping * stiffness;
  if (pipe_.gamma != 0.0) {
    const Vector tension = pipe_.gamma * weight.array() * (1.0 - grid.rule().node.array()) * c;
    ops.stiffness = inner(slope_in, tension, slope_in);
  }
  ops.stiffness.diagonal() += stiffness;
  return ops;
}

}  // namespace pipedyn
