// SPDX-License-Identifier: MIT
#include "pipedyn/galerkin/fitted_motion.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>

#include "pipedyn/products.hpp"
#include "pipedyn/vector/levels.hpp"
#include "pipedyn/vector/scratch.hpp"

namespace pipedyn {

namespace {

/// Rows of member k's state.
Eigen::Map<const Vector, 0, Eigen::InnerStride<>> column(const Batch& batch, Index first,
                                                         Index rows, Index k) {
  return {batch.y + first * batch.members + k, rows, Eigen::InnerStride<>(batch.members)};
}

/// What a state is at a grid's points.
struct Frame {
  Vector angle, omega, sine, cosine;
  Matrix integrand, velocity;  // (points, 2)
  Vector normal, weight;       // v_n, signed weights

  void set(const PanelGrid& grid, const Vector& q, const Vector& rate) {
    angle.noalias() = grid.slope() * q;
    omega.noalias() = grid.slope() * rate;
    sine.resize(angle.size());
    cosine.resize(angle.size());
    sincos(angle.data(), angle.size(), sine.data(), cosine.data());
  }

  void set_velocity(const PanelGrid& grid) {
    integrand.resize(grid.points(), 2);
    integrand.col(0) = cosine.cwiseProduct(omega);
    integrand.col(1) = -sine.cwiseProduct(omega);
    grid.integrate(integrand, velocity);
  }

  void set_drag(const PanelGrid& grid) {
    normal = cosine.cwiseProduct(velocity.col(0)) - sine.cwiseProduct(velocity.col(1));
    grid.signed_weights(normal, weight);
  }
};

/// Derivatives of the position, integral of n Theta_i, at the points: x, then y (points, 2 m).
void set_position_derivatives(const PanelGrid& grid, const Frame& frame, const Matrix& slopes,
                              Matrix& integrand, Matrix& xy) {
  const Index m = slopes.cols();
  integrand.resize(grid.points(), 2 * m);
  integrand.leftCols(m) = frame.cosine.asDiagonal() * slopes;
  integrand.rightCols(m) = -(frame.sine.asDiagonal() * slopes);
  grid.integrate(integrand, xy);
}

/// Loads at the points but for the inertia of q'': velocity-product terms, forces and fittings.
/// position_x: at the points; frame holds velocity and drag's weights where the pipe drags.
void set_loads(const PanelGrid& grid, const Pipe& pipe, double u, const Vector& stiffness,
               const Frame& frame, Matrix& integrand, Matrix& acceleration, Matrix& load) {
  const auto s = frame.sine.array(), c = frame.cosine.array(), omega = frame.omega.array();
  const auto w = grid.weight().array();
  integrand.resize(grid.points(), 3);
  integrand.col(0) = -s * omega.square();
  integrand.col(1) = -c * omega.square();
  integrand.col(2) = s;
  grid.integrate(integrand, acceleration);  // at q'' = 0, and x
  load.resize(grid.points(), 2);
  load.noalias() = grid.mass().asDiagonal() * acceleration.leftCols(2);
  auto load_x = load.col(0).array(), load_y = load.col(1).array();
  load_y -= pipe.gamma * grid.mass().array();
  const double coriolis = 2.0 * pipe.direction() * pipe.sqrt_beta() * u;
  load_x += coriolis * w * omega * c;
  load_y -= coriolis * w * omega * s;
  if (pipe.drag != 0.0) {
    load_x += pipe.drag * frame.weight.array() * frame.normal.array().square() * c;
    load_y -= pipe.drag * frame.weight.array() * frame.normal.array().square() * s;
  }
  for (Index panel = 0; panel < grid.panels(); ++panel) {
    const Index end = grid.end_of(panel);
    load_x[end] += stiffness[panel] * acceleration(end, 2);
  }
  const Index last = grid.points() - 1;
  const double thrust = pipe.centrifugal * u * u;
  load_x[last] += thrust * s[last];
  load_y[last] += thrust * c[last];
}

}  // namespace

// -------------------------------------------------------------------------------------- the grid

PanelGrid::PanelGrid(const Basis& basis, const Orthonormal& orthonormal, const Vector& ends,
                     const Vector& mass, Index nodes)
    : rule_(nodes), length_(ends.tail(mass.size()) - ends.head(mass.size())) {
  const Index panels = length_.size(), block = nodes + 1;
  arc_.resize(block);
  arc_ << rule_.node, 1.0;
  integral_ = Matrix::Zero(block, block);
  integral_.topLeftCorner(nodes, nodes) = rule_.integral_to(rule_.node);
  integral_.row(nodes).head(nodes) = rule_.weight.transpose();
  Vector arcs(panels * block);
  weight_ = Vector::Zero(panels * block);
  for (Index panel = 0; panel < panels; ++panel) {
    arcs.segment(panel * block, nodes) = ends[panel] + length_[panel] * rule_.node.array();
    arcs[end_of(panel)] = ends[panel + 1];
    weight_.segment(panel * block, nodes) = length_[panel] * rule_.weight;
  }
  mass_ = weight_;
  for (Index panel = 0; panel < panels; ++panel) mass_[end_of(panel)] = mass[panel];
  slope_ = basis.evaluate(arcs, 1);
  orthonormal_ = slope_ * orthonormal.to_basis;
  Matrix beyond;
  integrate_beyond(mass_, beyond);
  hanging_ = beyond;
  recurrence_ = legendre_recurrence(nodes);
  tables_ = {};
  tables_.nodes = tables_.stride = nodes;
  tables_.weight = rule_.weight.data();
  tables_.arc = arc_.data();
  tables_.expansion = rule_.expansion.data();
  tables_.recurrence = recurrence_.data();
}

void PanelGrid::integrate(const Matrix& f, Matrix& out) const {
  const Index block = nodes() + 1;
  out.resize(points(), f.cols());
  for (Index panel = 0; panel < panels(); ++panel) {
    auto here = out.middleRows(panel * block, block);
    here.noalias() = length_[panel] * integral_ * f.middleRows(panel * block, block);
    if (panel > 0) here.rowwise() += out.row(panel * block - 1).eval();
  }
}

void PanelGrid::integrate_beyond(const Matrix& load, Matrix& out) const {
  const Index block = nodes() + 1;
  out.resize(points(), load.cols());
  Eigen::RowVectorXd beyond = Eigen::RowVectorXd::Zero(load.cols());
  for (Index panel = panels() - 1; panel >= 0; --panel) {
    const auto loads = load.middleRows(panel * block, block);
    auto here = out.middleRows(panel * block, block);
    here.noalias() = length_[panel] * integral_.transpose() * loads;
    here.noalias() += weight_.segment(panel * block, block) * beyond;
    beyond += loads.colwise().sum();
  }
}

void PanelGrid::signed_weights(const Vector& v, Vector& weights) const {
  const Index block = nodes() + 1;
  weights = Vector::Zero(points());
  double* const work = scratch(3 * nodes());
  for (Index panel = 0; panel < panels(); ++panel) {
    motion_kernel().galerkin->signed_weights(tables_, v.data() + panel * block,
                                             weights.data() + panel * block, work);
    weights.segment(panel * block, nodes()) *= length_[panel];
  }
}

// ------------------------------------------------------------------------------------- the model

FittedMotion::FittedMotion(const Pipe& pipe, Basis basis, const Fittings& fittings,
                           Index least_nodes)
    : pipe_(pipe), basis_(std::move(basis)), orthonormal_(basis_), elastic_(basis_.stiffness()) {
  std::vector<double> ends(basis_.ends().begin(), basis_.ends().end());
  for (const Fitting& fitting : fittings) {
    if (!(fitting.at > 0.0 && fitting.at <= 1.0)) {
      throw std::invalid_argument("a fitting must lie in (0, 1]");
    }
    ends.push_back(fitting.at);
  }
  std::sort(ends.begin(), ends.end());
  ends.erase(std::unique(ends.begin(), ends.end()), ends.end());
  const Index panels = static_cast<Index>(ends.size()) - 1;
  ends_ = Eigen::Map<const Vector>(ends.data(), panels + 1);
  mass_ = stiffness_ = Vector::Zero(panels);
  for (const Fitting& fitting : fittings) {
    const auto end = std::lower_bound(ends.begin(), ends.end(), fitting.at);
    const Index panel = static_cast<Index>(end - ends.begin()) - 1;
    mass_[panel] += fitting.mass;
    stiffness_[panel] += fitting.stiffness;
  }

  const bool drag = pipe.drag != 0.0;
  std::vector<Matrix> series;
  for (Index panel = 0; panel < panels; ++panel) {
    series.push_back(slope_series(basis_, ends_[panel], ends_[panel + 1]));
  }
  const Index m = basis_.size();
  const Index most = std::max<Index>(4095, 4 * m) / panels + 1;  // points of some 0.1 GB
  const Index least = std::max({basis_.most_on_a_panel(), least_nodes, pipedyn::least_nodes(drag)});
  const Index largest = std::max(least, std::min<Index>(64 * m + 96, most));
  for (Index nodes = least;; nodes += std::max<Index>(4, nodes / 6)) {
    const bool last = nodes >= largest;
    std::vector<std::vector<NodeTest>> tests;
    for (const Matrix& one : series) {
      tests.push_back(node_tests(one, nodes, drag));
      if (tests.back().empty()) break;
    }
    if (tests.back().empty() && !last) continue;
    Slot& slot = slots_.emplace_back();
    slot.nodes = nodes;
    slot.tests = std::move(tests);
    if (last) break;
  }
}

const PanelGrid& FittedMotion::grid_for(const double* q, Index stride) const {
  const auto serves = [&](const Slot& slot) {
    return std::all_of(slot.tests.begin(), slot.tests.end(),
                       [&](const auto& tests) { return passes(tests, q, stride); });
  };
  auto slot = std::find_if(slots_.begin(), slots_.end() - 1, serves);
  std::call_once(slot->built, [&] {
    slot->grid = std::make_unique<PanelGrid>(basis_, orthonormal_, ends_, mass_, slot->nodes);
  });
  return *slot->grid;
}

bool FittedMotion::resolves(const PanelGrid& grid, const double* q) const {
  const Slot& largest = slots_.back();
  if (grid.nodes() < largest.nodes) return true;
  return std::all_of(largest.tests.begin(), largest.tests.end(),
                     [&](const auto& tests) { return tests.empty() || passes(tests, q, 1); });
}

Index FittedMotion::nodes(const Vector& q) const {
  require_amplitudes(q.size(), dof());
  return grid_for(q.data(), 1).nodes();
}

void FittedMotion::accelerations(const PanelGrid& grid, const Vector& q, const Vector& rate,
                                 double u, Vector& out) const {
  struct Workspace {  // each of one shape, so that it is allocated once
    Frame frame;
    Matrix integrand, bent, xy, at_rest, load, weighted, mass;
    Vector force;
    Eigen::LLT<Matrix> factors;
  };
  static thread_local Workspace work;
  auto& [frame, integrand, bent, xy, at_rest, load, weighted, mass, force, factors] = work;
  const Index m = dof();
  frame.set(grid, q, rate);
  if (pipe_.drag != 0.0) {
    frame.set_velocity(grid);
    frame.set_drag(grid);
  }
  set_position_derivatives(grid, frame, grid.orthonormal(), integrand, xy);
  set_loads(grid, pipe_, u, stiffness_, frame, bent, at_rest, load);
  weighted.noalias() = grid.mass().asDiagonal() * xy;
  mass.setZero(m, m);
  add_inner(mass, 1.0, weighted.leftCols(m), xy.leftCols(m));
  add_inner(mass, 1.0, weighted.rightCols(m), xy.rightCols(m));
  const auto to_basis = orthonormal_.to_basis.triangularView<Eigen::Upper>();
  force = elastic_.array() * (q + pipe_.damping * rate).array();
  force = to_basis.transpose() * force;
  force.noalias() += xy.leftCols(m).transpose() * load.col(0);
  force.noalias() += xy.rightCols(m).transpose() * load.col(1);
  factors.compute(mass);
  if (factors.info() != Eigen::Success || !resolves(grid, q.data())) {
    out.setConstant(m, std::numeric_limits<double>::quiet_NaN());
    return;
  }
  factors.solveInPlace(force);
  force = to_basis * force;
  out = -force;
}

void FittedMotion::rhs(const Batch& batch, double* rates) const {
  const Index m = dof(), members = batch.members;
  std::copy(batch.y + m * members, batch.y + 2 * m * members, rates);
  Vector q(m), rate(m), result(m);
  for (Index k = 0; k < members; ++k) {
    q = column(batch, 0, m, k);
    rate = column(batch, m, m, k);
    accelerations(grid_for(q.data(), 1), q, rate, batch.u[k * batch.u_step], result);
    for (Index i = 0; i < m; ++i) rates[(m + i) * members + k] = result[i];
  }
}

void FittedMotion::energy(const Batch& batch, double* out) const {
  const Index m = dof(), members = batch.members;
  static thread_local Frame frame;
  static thread_local Matrix x;
  Vector q(m), rate(m);
  for (Index k = 0; k < members; ++k) {
    q = column(batch, 0, m, k);
    rate = column(batch, m, m, k);
    const PanelGrid& grid = grid_for(q.data(), 1);
    frame.set(grid, q, rate);
    frame.set_velocity(grid);
    double twice = grid.mass().dot(frame.velocity.rowwise().squaredNorm());
    twice += elastic_.dot(q.cwiseAbs2());
    // 1 - cos, which keeps its digits at small angles
    twice +=
        4.0 * pipe_.gamma * grid.hanging().dot((0.5 * frame.angle).array().sin().square().matrix());
    grid.integrate(frame.sine, x);
    for (Index panel = 0; panel < grid.panels(); ++panel) {
      const double there = x(grid.end_of(panel), 0);
      twice += stiffness_[panel] * there * there;
    }
    out[k] = 0.5 * twice;
  }
}

void FittedMotion::power(const Batch& batch, const PowerParts& out) const {
  const Index m = dof(), members = batch.members;
  static thread_local Frame frame;
  Vector q(m), rate(m);
  for (Index k = 0; k < members; ++k) {
    q = column(batch, 0, m, k);
    rate = column(batch, m, m, k);
    const double u = batch.u[k * batch.u_step];
    const PanelGrid& grid = grid_for(q.data(), 1);
    const Index last = grid.points() - 1;
    frame.set(grid, q, rate);
    frame.set_velocity(grid);
    const auto end = frame.velocity.row(last);
    const double along = frame.sine[last] * end[0] + frame.cosine[last] * end[1];
    out.flow[k] = -pipe_.direction() * pipe_.sqrt_beta() * u * end.squaredNorm() -
                  pipe_.centrifugal * u * u * along;
    out.joints[k] = -pipe_.damping * elastic_.dot(rate.cwiseAbs2());
    out.drag[k] = 0.0;
    if (pipe_.drag != 0.0) {
      frame.set_drag(grid);
      out.drag[k] = -pipe_.drag * frame.weight.dot(frame.normal.array().cube().matrix());
    }
  }
}

void FittedMotion::jacobian(const double* y, double u, double* out) const {
  const Index m = dof();
  const Vector q = Eigen::Map<const Vector>(y, m), rate = Eigen::Map<const Vector>(y + m, m);
  const PanelGrid& grid = grid_for(y, 1);
  const Index last = grid.points() - 1;
  const Matrix& slope = grid.slope();
  const auto w = grid.weight().array();
  const double coriolis = 2.0 * pipe_.direction() * pipe_.sqrt_beta() * u;
  const double thrust = pipe_.centrifugal * u * u;
  const bool drags = pipe_.drag != 0.0;

  Vector acceleration;
  accelerations(grid, q, rate, u, acceleration);
  Frame frame;
  frame.set(grid, q, rate);
  if (drags) {
    frame.set_velocity(grid);
    frame.set_drag(grid);
  }
  const auto s = frame.sine.array(), c = frame.cosine.array(), omega = frame.omega.array();
  const Vector spin = slope * acceleration;  // second derivative of the angle

  // All loads, and what each node's turning bears of them.
  Matrix integrand, at_rest, load, turned, bears;
  set_loads(grid, pipe_, u, stiffness_, frame, integrand, at_rest, load);
  integrand.resize(grid.points(), 2);
  integrand.col(0) = c * spin.array();
  integrand.col(1) = -s * spin.array();
  grid.integrate(integrand, turned);
  load += grid.mass().asDiagonal() * turned;
  grid.integrate_beyond(load, bears);

  // Virtual displacements along t and n, and the masses beyond that they move.
  Matrix xy, sums;
  set_position_derivatives(grid, frame, grid.orthonormal(), integrand, xy);
  const auto jx = xy.leftCols(m), jy = xy.rightCols(m);
  const Matrix along = jx.array().colwise() * s + jy.array().colwise() * c;
  const Matrix across = jx.array().colwise() * c - jy.array().colwise() * s;
  const Matrix weighted = grid.mass().asDiagonal() * xy;
  Matrix mass = Matrix::Zero(m, m);
  add_inner(mass, 1.0, weighted.leftCols(m), jx);
  add_inner(mass, 1.0, weighted.rightCols(m), jy);
  grid.integrate_beyond(weighted, sums);
  const auto sum_x = sums.leftCols(m).array(), sum_y = sums.rightCols(m).array();
  const Matrix sum_along = sum_x.colwise() * s + sum_y.colwise() * c;
  const Matrix sum_across = sum_x.colwise() * c - sum_y.colwise() * s;

  // Row i of the derivatives is the sum over points of these times Theta_j.
  const auto scaled = [](const Matrix& rows, const Vector& factor) -> Matrix {
    return factor.asDiagonal() * rows;
  };
  Matrix by_angle =
      scaled(grid.orthonormal(), -s * bears.col(0).array() - c * bears.col(1).array());
  by_angle -= scaled(sum_along, spin) + scaled(sum_across, omega.square());
  by_angle -= scaled(along, coriolis * w * omega);
  by_angle.row(last) += thrust * across.row(last);
  Matrix by_rate = scaled(sum_along, -2.0 * omega) + scaled(across, coriolis * w);
  Matrix system = Matrix::Zero(m, 2 * m), by_drag;
  if (drags) {
    const Vector v_t = s * frame.velocity.col(0).array() + c * frame.velocity.col(1).array();
    const Vector pressure = pipe_.drag * frame.weight.array() * frame.normal.array().square();
    by_drag = scaled(across, 2.0 * pipe_.drag * frame.weight.array() * frame.normal.array());
    by_angle -= scaled(by_drag, v_t) + scaled(along, pressure);
    integrand.leftCols(m) = c.matrix().asDiagonal() * by_drag;
    integrand.rightCols(m) = -(s.matrix().asDiagonal() * by_drag);
    grid.integrate_beyond(integrand, sums);
    by_angle -= scaled(sums.leftCols(m), s * omega) + scaled(sums.rightCols(m), c * omega);
    by_rate += scaled(sums.leftCols(m), c) - scaled(sums.rightCols(m), s);
  }
  add_inner(system.leftCols(m), -1.0, by_angle, slope);
  add_inner(system.rightCols(m), -1.0, by_rate, slope);
  // Rows belong to orthonormal coordinates, columns to the basis.
  for (Index panel = 0; panel < grid.panels(); ++panel) {
    if (stiffness_[panel] == 0.0) continue;
    const auto there = jx.row(grid.end_of(panel));
    system.leftCols(m) -= stiffness_[panel] * there.transpose() * (there * orthonormal_.inverse);
  }
  const Matrix elastic = orthonormal_.to_basis.transpose() * elastic_.asDiagonal();
  system.leftCols(m) -= elastic;
  system.rightCols(m) -= pipe_.damping * elastic;
  const Eigen::LLT<Matrix> factors(mass);
  Eigen::Map<Matrix> result(out, 2 * m, 2 * m);
  result.topLeftCorner(m, m).setZero();
  result.topRightCorner(m, m).setIdentity();
  if (factors.info() != Eigen::Success || !resolves(grid, y)) {
    result.bottomRows(m).setConstant(std::numeric_limits<double>::quiet_NaN());
    return;
  }
  factors.solveInPlace(system);
  result.bottomRows(m) = orthonormal_.to_basis.triangularView<Eigen::Upper>() * system;
}

Operators FittedMotion::operators(const Vector& q) const {
  const Index m = dof();
  require_amplitudes(q.size(), m);
  const PanelGrid& grid = grid_for(q.data(), 1);
  const Index last = grid.points() - 1, block = grid.nodes() + 1;
  const Matrix& slope = grid.slope();
  Frame frame;
  Matrix integrand, xy, position;
  frame.set(grid, q, Vector::Zero(m));
  set_position_derivatives(grid, frame, slope, integrand, xy);
  grid.integrate(frame.sine, position);
  const auto x = xy.leftCols(m), y = xy.rightCols(m);
  const auto s = frame.sine.array(), c = frame.cosine.array();
  const auto w = grid.weight().array();
  Operators ops(m);
  ops.mass = inner(x, grid.mass(), x) + inner(y, grid.mass(), y);
  const Matrix across = x.array().colwise() * c - y.array().colwise() * s;
  const Matrix coriolis = inner(across, grid.weight(), slope);
  ops.gyroscopic = pipe_.sqrt_beta() * (coriolis - coriolis.transpose());
  ops.end_flux = pipe_.sqrt_beta() *
                 (x.row(last).transpose() * x.row(last) + y.row(last).transpose() * y.row(last));
  // J_i turns by -t Theta_i Theta_j: its projection on the end's tangent is that of two tangents.
  const Vector shortening = -w * (s[last] * s + c[last] * c);
  ops.flux = across.row(last).transpose() * slope.row(last) + inner(slope, shortening, slope);
  ops.damping.diagonal() = pipe_.damping * elastic_;
  Vector tension = pipe_.gamma * grid.hanging().array() * c;
  for (Index panel = 0; panel < grid.panels(); ++panel) {
    const Index end = grid.end_of(panel);
    const double stiffness = stiffness_[panel];
    tension.head((panel + 1) * block).array() -=
        stiffness * position(end, 0) * (w * s).head((panel + 1) * block);
    ops.stiffness += stiffness * x.row(end).transpose() * x.row(end);
  }
  ops.stiffness += inner(slope, tension, slope);
  ops.stiffness.diagonal() += elastic_;
  return ops;
}

}  // namespace pipedyn
