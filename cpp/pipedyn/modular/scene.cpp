// SPDX-License-Identifier: MIT
#include "pipedyn/modular/scene.hpp"

#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>

#include "pipedyn/chain/places.hpp"

namespace pipedyn {

namespace {

std::size_t count(Index size) { return static_cast<std::size_t>(size); }

void require(const char* name, Index size, Index expected) {
  if (size != expected) {
    throw std::invalid_argument(std::string(name) + " must have " + std::to_string(expected) +
                                " entries, got " + std::to_string(size));
  }
}

}  // namespace

template <class Work>
void Scene::for_each_module(const Work& work) const {
  const auto each = [&work](const auto& modules) {
    for (const auto& module : modules) work(module);
  };
  std::apply([&each](const auto&... kinds) { (each(kinds), ...); }, modules_);
}

Scene::Scene(const Pipe& pipe, const Modules& modules)
    : direction_(pipe.direction()),
      base_(modules.segments.base),
      length_(modules.segments.length),
      constraints_(modules.constraints),
      enforcement_(assemble(pipe, modules)) {}

/// The modules, with what they know of the pipe, and their inertia and the groups.
Enforcement Scene::assemble(const Pipe& pipe, const Modules& given) {
  const auto& [length, center, gyration_radius, spring, drag_point, base] = given.segments;
  const Index n = segments();
  if (n < 1 || center.size() != n || gyration_radius.size() != n || drag_point.size() != n) {
    throw std::invalid_argument("segments must have one entry a segment in every array");
  }
  if (!(length.minCoeff() > 0.0)) throw std::invalid_argument("length must be positive");
  const Vector upright = straight();
  const Nodes height{upright.data(), base_};
  auto& [bodies, springs, loads, flows, drags] = modules_;
  const auto add_body = [&](Index node, double mass, double chi, double turning) {
    Body& body = bodies.emplace_back();
    body.node = node;
    body.mass = mass;
    body.center = chi;
    body.turning = turning;
    body.weight = pipe.gamma * mass;
    body.straight_height = (1.0 - chi) * height(node - 1).y() + chi * height(node).y();
  };
  for (Index j = 1; j <= n; ++j) {
    const double l = length[j - 1];
    add_body(j, l, center[j - 1], gyration_radius[j - 1] / l);
    if (given.drag && pipe.drag != 0.0) drags.push_back({{j, drag_point[j - 1], l}, pipe.drag});
  }
  for_each_place(pipe.terms, length, base,
                 [&](const auto& law, const Term& term, Index j, double arm, double weight) {
                   const double point = arm / length[j];
                   if (law.mass() != 0.0) add_body(j + 1, weight * law.mass(), point, 0.0);
                   if (law.loads) loads.push_back({{j + 1, point, weight}, term});
                 });
  springs = given.springs;
  for (const TorsionalSpring& of : springs) {
    if (of.joint >= 1 && of.joint <= n) continue;
    throw std::invalid_argument("spring_joint must lie in 1.." + std::to_string(n) + ", got " +
                                std::to_string(of.joint));
  }
  if (given.flow) flows.emplace_back(pipe, length);

  std::vector<InertiaRow> rows;
  for (const Body& body : bodies) body.add_inertia(rows);
  for (const InertiaRow& row : given.inertia) {
    for (const int c : row.coordinate) {
      if (c >= 0 && c < 3 * n) continue;
      throw std::invalid_argument("inertia must lie on the scene's coordinates");
    }
    rows.push_back(row);
  }
  std::vector<Group> groups;
  for (const Constraint& constraint : constraints_) {
    constraint.check(n);
    groups.push_back({constraint.coordinates(), constraint.rows()});
    rows_ += constraint.rows();
    matrix_size_ += constraint.rows() * static_cast<Index>(groups.back().coordinate.size());
  }
  const auto hold = [&](Index node, Index axis, double value) {
    for (const Held& other : held_) {
      if (other.node == node && other.axis == axis) return;
    }
    held_.push_back({node, axis, value});
  };
  for (const Constraint& constraint : constraints_) {
    const bool pin = constraint.kind == Constraint::Kind::pin;
    if (pin || constraint.kind == Constraint::Kind::guide) hold(constraint.node, 0, constraint.x);
    if (pin) hold(constraint.node, 1, constraint.y);
  }
  std::vector<double> scale(count(3 * n), 1.0);
  for (Index j = 1; j <= n; ++j) scale[count(phi_of(j))] = 1.0 / length[j - 1];
  return Enforcement(std::move(scale), std::move(rows), std::move(groups));
}

Motion Scene::motion(const double* y, double u) const {
  return {{y, base_}, {y + coordinates(), 0.0}, direction_ * u};
}

Vector Scene::straight() const {
  Vector q = Vector::Zero(coordinates());
  double y = base_;
  for (Index j = 1; j <= segments(); ++j) q[y_of(j)] = y += length_[j - 1];
  return q;
}

RedundantOperators Scene::operators() const {
  RedundantOperators ops;
  for (const InertiaRow& row : enforcement_.inertia()) {
    for (std::size_t i = 0; i < row.weight.size(); ++i) {
      for (std::size_t k = 0; k < row.weight.size(); ++k) {
        ops.mass.add(row.coordinate[i], row.coordinate[k], row.weight[i] * row.weight[k]);
      }
    }
  }
  for (const InternalFlow& flow : std::get<std::vector<InternalFlow>>(modules_)) {
    flow.add_operators(ops);
  }
  return ops;
}

Vector Scene::forces(const Vector& y, double u) const {
  require("y", y.size(), 2 * coordinates());
  Vector sum = Vector::Zero(coordinates());
  const Motion now = motion(y.data(), u);
  for_each_module([&](const auto& module) { module.add_force(now, {sum.data()}); });
  return sum;
}

Derivatives Scene::force_derivatives(const Vector& y, double u) const {
  require("y", y.size(), 2 * coordinates());
  Derivatives out;
  const Motion now = motion(y.data(), u);
  for_each_module([&](const auto& module) { module.add_derivatives(now, out); });
  return out;
}

// --------------------------------------------------------------------------------- constraints

/// Calls work(constraint, row), the first of its rows among all.
template <class Work>
void Scene::for_each_constraint(const Work& work) const {
  Index row = 0;
  for (const Constraint& constraint : constraints_) {
    work(constraint, row);
    row += constraint.rows();
  }
}

/// matrix: each group's A over the coordinates that it touches, one group after the other.
void Scene::fill_constraints(const Motion& motion, double* residual, double* matrix,
                             double* right_side) const {
  std::size_t group = 0;
  for_each_constraint([&](const Constraint& constraint, Index row) {
    constraint.fill(motion.place, motion.rate, length_, residual + row, matrix, right_side + row);
    matrix += enforcement_.matrix_size(group++);
  });
}

ConstraintRows Scene::constraints(const Vector& y) const {
  require("y", y.size(), 2 * coordinates());
  ConstraintRows out{Vector(rows_), {}, Vector(rows_), {}};
  Vector values(matrix_size_);
  fill_constraints(motion(y.data(), 0.0), out.residual.data(), values.data(),
                   out.right_side.data());
  Index row = 0, entry = 0;
  for (std::size_t i = 0; i < constraints_.size(); ++i) {
    const std::vector<int> touched = constraints_[i].coordinates();
    for (int r = 0; r < constraints_[i].rows(); ++r, ++row) {
      out.group.push_back(static_cast<std::int64_t>(i));
      for (const int c : touched) out.matrix.add(row, c, values[entry++]);
    }
  }
  return out;
}

Triplets Scene::curvature(const Vector& q, const Vector& multipliers) const {
  require("q", q.size(), coordinates());
  require("multipliers", multipliers.size(), rows_);
  Triplets out;
  for_each_constraint([&](const Constraint& constraint, Index row) {
    constraint.add_curvature({q.data(), base_}, length_, multipliers.data() + row, out);
  });
  return out;
}

Derivatives Scene::acceleration_derivatives(const Vector& y, const Vector& acceleration) const {
  require("y", y.size(), 2 * coordinates());
  require("acceleration", acceleration.size(), coordinates());
  const Motion now = motion(y.data(), 0.0);
  Derivatives out;
  for_each_constraint([&](const Constraint& constraint, Index row) {
    constraint.add_derivatives(now.place, now.rate, {acceleration.data(), 0.0}, length_, row, out);
  });
  return out;
}

// -------------------------------------------------------------------------------------- motion

Matrix Scene::from_angles(const Matrix& theta, const Matrix& omega) const {
  const Index n = segments(), size = coordinates();
  require("theta", theta.rows(), n);
  require("omega", omega.rows(), n);
  require("a row of omega", omega.cols(), theta.cols());
  Matrix states(2 * size, theta.cols());
  for (Index k = 0; k < theta.cols(); ++k) {
    Point r(0.0, base_), v(0.0, 0.0);
    double angle = 0.0, turning = 0.0;  // of the segment before
    for (Index j = 1; j <= n; ++j) {
      const double l = length_[j - 1], own = theta(j - 1, k), own_rate = omega(j - 1, k);
      const Point tangent(std::sin(own), std::cos(own));
      r += l * tangent;
      v += l * own_rate * turned(tangent);
      states(x_of(j), k) = r.x();
      states(y_of(j), k) = r.y();
      states(phi_of(j), k) = own - angle;
      states(size + x_of(j), k) = v.x();
      states(size + y_of(j), k) = v.y();
      states(size + phi_of(j), k) = own_rate - turning;
      angle = own;
      turning = own_rate;
    }
  }
  return states;
}

void Scene::project_one(Vector& theta, Vector& omega) const {
  constexpr double close = 1e-13, rank = 1e-9;
  constexpr int most_steps = 20;
  const Index n = segments(), held = static_cast<Index>(held_.size());
  Matrix rows(held, n);
  Vector missed(held);
  Eigen::CompleteOrthogonalDecomposition<Matrix> factors;
  factors.setThreshold(rank);
  for (int step = 0; step < most_steps; ++step) {
    const Eigen::ArrayXd sine = theta.array().sin(), cosine = theta.array().cos();
    rows.setZero();
    for (Index i = 0; i < held; ++i) {
      const Held& one = held_[count(i)];
      double place = one.axis == 0 ? 0.0 : base_;
      for (Index j = 0; j < one.node; ++j) {
        place += length_[j] * (one.axis == 0 ? sine[j] : cosine[j]);
        rows(i, j) = length_[j] * (one.axis == 0 ? cosine[j] : -sine[j]);
      }
      missed[i] = place - one.value;
    }
    factors.compute(rows);
    if (missed.cwiseAbs().maxCoeff() <= close) {
      omega -= factors.solve(rows * omega);
      return;
    }
    theta -= factors.solve(missed);
  }
  theta.setConstant(std::numeric_limits<double>::quiet_NaN());
  omega = theta;
}

void Scene::project(Matrix& theta, Matrix& omega) const {
  require("theta", theta.rows(), segments());
  require("omega", omega.rows(), segments());
  if (held_.empty()) return;
  for (Index k = 0; k < theta.cols(); ++k) {
    Vector angles = theta.col(k), rates = omega.col(k);
    project_one(angles, rates);
    theta.col(k) = angles;
    omega.col(k) = rates;
  }
}

void Scene::angle_rates(const Batch& batch, double* rates) const {
  const Index n = segments(), size = coordinates(), members = batch.members;
  Vector theta(n), omega(n), met_theta(n), met_omega(n), moved(2 * size);
  for (Index k = 0; k < members; ++k) {
    for (Index j = 0; j < n; ++j) {
      theta[j] = batch.y[j * members + k];
      omega[j] = batch.y[(n + j) * members + k];
    }
    met_theta = theta;
    met_omega = omega;
    if (!held_.empty()) project_one(met_theta, met_omega);
    const Matrix state = from_angles(met_theta, met_omega);
    const Batch one{state.data(), batch.u + k * batch.u_step, 1, 0};
    rhs(one, nullptr, moved.data());
    double flow = 0.0, joints = 0.0, drag = 0.0, others = 0.0;
    power(one, {&flow, &joints, &drag, &others});
    double turning = 0.0;  // of the segment: the joints' accelerations up to it
    for (Index j = 0; j < n; ++j) {
      turning += moved[size + phi_of(j + 1)];
      rates[j * members + k] = met_omega[j] - return_rate * (theta[j] - met_theta[j]);
      rates[(n + j) * members + k] = turning - return_rate * (omega[j] - met_omega[j]);
    }
    rates[2 * n * members + k] = flow + joints + drag + others;
  }
}

template <class Work>
void Scene::for_each_member(const Batch& batch, const Work& work) const {
  thread_local std::vector<double> kept;
  const Index size = 2 * coordinates();
  if (kept.size() < count(size)) kept.resize(count(size));
  for (Index k = 0; k < batch.members; ++k) {
    for (Index i = 0; i < size; ++i) kept[count(i)] = batch.y[i * batch.members + k];
    work(k, motion(kept.data(), batch.u[k * batch.u_step]));
  }
}

/// Accelerations under forces, as Enforcement::solve.
int Scene::enforce(const Motion& motion, const double* force, double* accelerations) const {
  thread_local std::vector<double> kept;
  const Index needed = 2 * rows_ + matrix_size_;
  if (kept.size() < count(needed)) kept.resize(count(needed));
  double* const residual = kept.data();
  double* const right_side = residual + rows_;
  double* const matrix = right_side + rows_;
  fill_constraints(motion, residual, matrix, right_side);
  return enforcement_.solve(matrix, right_side, force, accelerations);
}

void Scene::rhs(const Batch& batch, const double* force, double* rates) const {
  const Index size = coordinates(), members = batch.members;
  thread_local std::vector<double> kept;
  if (kept.size() < count(2 * size)) kept.resize(count(2 * size));
  double* const sum = kept.data();
  double* const acceleration = sum + size;
  for_each_member(batch, [&](Index k, const Motion& now) {
    for (Index i = 0; i < size; ++i) sum[i] = force != nullptr ? force[i * members + k] : 0.0;
    for_each_module([&](const auto& module) { module.add_force(now, {sum}); });
    if (enforce(now, sum, acceleration) != Enforcement::complete) {
      std::fill_n(acceleration, size, std::numeric_limits<double>::quiet_NaN());
    }
    for (Index i = 0; i < size; ++i) {
      rates[i * members + k] = now.rate.values[i];
      rates[(size + i) * members + k] = acceleration[i];
    }
  });
}

Index Scene::lacking(const Vector& q) const {
  require("q", q.size(), coordinates());
  Vector y = Vector::Zero(2 * coordinates()), acceleration(coordinates());
  y.head(coordinates()) = q;
  return enforce(motion(y.data(), 0.0), y.data() + coordinates(), acceleration.data());
}

void Scene::energy(const Batch& batch, double* out) const {
  for_each_member(batch, [&](Index k, const Motion& now) {
    out[k] = 0.0;
    for (const InertiaRow& row : enforcement_.inertia()) {
      double momentum = 0.0;
      for (std::size_t i = 0; i < row.weight.size(); ++i) {
        momentum += row.weight[i] * now.rate.values[row.coordinate[i]];
      }
      out[k] += 0.5 * momentum * momentum;
    }
    for_each_module([&](const auto& module) { out[k] += module.energy(now); });
  });
}

void Scene::power(const Batch& batch, const PowerParts& out) const {
  for_each_member(batch, [&](Index k, const Motion& now) {
    Power sum;
    for_each_module([&](const auto& module) { module.add_power(now, sum); });
    out.flow[k] = sum.flow;
    out.joints[k] = sum.joints;
    out.drag[k] = sum.drag;
    out.others[k] = sum.others;
  });
}

}  // namespace pipedyn
