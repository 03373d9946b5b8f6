// SPDX-License-Identifier: MIT
#include "pipedyn/modular/scene.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>

#include "pipedyn/chain/places.hpp"

namespace pipedyn {

namespace {

/// Scratch of the thread, which one caller uses at a time.
double* resized(std::vector<double>& kept, Index size) {
  if (static_cast<Index>(kept.size()) < size) kept.resize(static_cast<std::size_t>(size));
  return kept.data();
}

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
  for (const Constraint& of : constraints_) {
    const bool pin = of.kind == Constraint::Kind::pin;
    if (pin || of.kind == Constraint::Kind::guide) held_.push_back({of.node, 0, of.x});
    if (pin) held_.push_back({of.node, 1, of.y});
  }
  std::vector<double> scale(static_cast<std::size_t>(3 * n), 1.0);
  for (Index j = 1; j <= n; ++j) scale[phi_of(j)] = 1.0 / length[j - 1];
  return Enforcement(std::move(scale), std::move(rows), std::move(groups));
}

Motion Scene::motion(const double* y, double u) const {
  return {{y, base_}, {y + coordinates(), 0.0}, direction_ * u};
}

Vector Scene::straight() const {
  const Matrix upright = Matrix::Zero(segments(), 1);
  return from_angles(upright, upright).col(0).head(coordinates());
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
  Derivatives by_flow;
  for (InternalFlow flow : std::get<std::vector<InternalFlow>>(modules_)) {
    flow.centrifugal = 1.0;
    flow.add_derivatives({{nullptr, 0.0}, {nullptr, 0.0}, 1.0}, by_flow);
  }
  ops.velocity = std::move(by_flow.by_rates);
  ops.flux = std::move(by_flow.by_coordinates);
  for (Triplets* of : {&ops.velocity, &ops.flux}) {
    for (double& value : of->values) value = -value;
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

/// matrix: each group's A over the coordinates that it touches, one group after the other.
void Scene::fill_constraints(const Motion& motion, double* residual, double* matrix,
                             double* right_side) const {
  for (std::size_t i = 0; i < constraints_.size(); ++i) {
    constraints_[i].fill(motion.place, motion.rate, length_, residual, matrix, right_side);
    residual += constraints_[i].rows();
    right_side += constraints_[i].rows();
    matrix += enforcement_.matrix_size(i);
  }
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

Hessians Scene::hessians(const Vector& q) const {
  require("q", q.size(), coordinates());
  Hessians out;
  Index row = 0;
  for (const Constraint& constraint : constraints_) {
    constraint.add_hessians({q.data(), base_}, length_, row, out);
    row += constraint.rows();
  }
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

namespace {

/// Least x with rows x = wanted, where each column holds a row of length n and its wanted values
/// below it. Gram and Schmidt's method; rows that follow from those before them are left out.
Matrix least(Eigen::MatrixXd& columns, Index n) {
  constexpr double rank = 1e-9;
  const double largest = columns.topRows(n).colwise().norm().maxCoeff();
  for (Index k = 0; k < columns.cols(); ++k) {
    for (Index i = 0; i < 2 * k; ++i) {  // twice, as once leaves what rounding makes
      const auto before = columns.col(i % k);
      columns.col(k) -= before.head(n).dot(columns.col(k).head(n)) * before;
    }
    const double norm = columns.col(k).head(n).norm();
    columns.col(k) *= norm > rank * largest ? 1.0 / norm : 0.0;
  }
  const Index wanted = columns.rows() - n;
  Matrix x = Matrix::Zero(n, wanted);
  for (Index k = 0; k < columns.cols(); ++k) {
    for (Index i = 0; i < wanted; ++i) x.col(i) += columns(n + i, k) * columns.col(k).head(n);
  }
  return x;
}

}  // namespace

double Scene::project_one(Vector& theta, Vector& omega) const {
  constexpr double longest = 0.5;  // rad a step, so that segments do not turn over
  constexpr int most_steps = 100;
  const Index n = segments(), held = static_cast<Index>(held_.size());
  // Of each coordinate held: its derivative by the angles, how far it is missed, and its rate.
  Eigen::MatrixXd columns(n + 2, held);
  Vector closest = theta;
  double least_missed = std::numeric_limits<double>::infinity();
  for (int step = 0; step < most_steps; ++step) {
    const Eigen::ArrayXd sine = theta.array().sin(), cosine = theta.array().cos();
    columns.setZero();
    for (Index i = 0; i < held; ++i) {
      const auto& [node, axis, value] = held_[i];
      double place = axis == 0 ? 0.0 : base_, rate = 0.0;
      for (Index j = 0; j < node; ++j) {
        place += length_[j] * (axis == 0 ? sine[j] : cosine[j]);
        columns(j, i) = length_[j] * (axis == 0 ? cosine[j] : -sine[j]);
        rate += columns(j, i) * omega[j];
      }
      columns(n, i) = place - value;
      columns(n + 1, i) = rate;
    }
    const double missed = columns.row(n).cwiseAbs().maxCoeff();
    const Matrix change = least(columns, n);
    if (missed < least_missed) {
      least_missed = missed;
      closest = theta;
    }
    if (missed <= met) {
      omega -= change.col(1);
      break;
    }
    const double turn = change.col(0).cwiseAbs().maxCoeff();
    if (!(turn > 0.0)) break;
    theta -= std::min(1.0, longest / turn) * change.col(0);
  }
  theta = closest;
  return least_missed;
}

Vector Scene::project(Matrix& theta, Matrix& omega) const {
  require("theta", theta.rows(), segments());
  require("omega", omega.rows(), segments());
  Vector missed = Vector::Zero(theta.cols());
  for (Index k = 0; k < theta.cols() && !held_.empty(); ++k) {
    Vector angles = theta.col(k), rates = omega.col(k);
    missed[k] = project_one(angles, rates);
    theta.col(k) = angles;
    omega.col(k) = rates;
  }
  return missed;
}

void Scene::angle_rates(const Batch& batch, double* rates) const {
  const Index n = segments(), size = coordinates(), members = batch.members;
  const Eigen::Map<const Matrix> given(batch.y, 2 * n, members);
  Vector moved(2 * size);
  for (Index k = 0; k < members; ++k) {
    const Vector y = given.col(k);
    Vector theta = y.head(n), omega = y.tail(n);
    if (!held_.empty() && !(project_one(theta, omega) <= met)) {
      theta.setConstant(std::numeric_limits<double>::quiet_NaN());
    }
    const Matrix state = from_angles(theta, omega);
    const Batch one{state.data(), batch.u + k * batch.u_step, 1, 0};
    rhs(one, nullptr, moved.data());
    double flow = 0.0, joints = 0.0, drag = 0.0, others = 0.0;
    power(one, {&flow, &joints, &drag, &others});
    double turning = 0.0;  // of the segment: the joints' accelerations up to it
    for (Index j = 0; j < n; ++j) {
      turning += moved[size + phi_of(j + 1)];
      rates[j * members + k] = omega[j] - return_rate * (y[j] - theta[j]);
      rates[(n + j) * members + k] = turning - return_rate * (y[n + j] - omega[j]);
    }
    rates[2 * n * members + k] = flow + joints + drag + others;
  }
}

template <class Work>
void Scene::for_each_member(const Batch& batch, const Work& work) const {
  thread_local std::vector<double> kept;
  double* const y = resized(kept, 2 * coordinates());
  for (Index k = 0; k < batch.members; ++k) {
    for (Index i = 0; i < 2 * coordinates(); ++i) y[i] = batch.y[i * batch.members + k];
    work(k, motion(y, batch.u[k * batch.u_step]));
  }
}

/// Accelerations under forces, as Enforcement::solve.
int Scene::enforce(const Motion& motion, const double* force, double* accelerations) const {
  thread_local std::vector<double> kept;
  double* const residual = resized(kept, 2 * rows_ + matrix_size_);
  double* const right_side = residual + rows_;
  double* const matrix = right_side + rows_;
  fill_constraints(motion, residual, matrix, right_side);
  return enforcement_.solve(matrix, right_side, force, accelerations);
}

void Scene::rhs(const Batch& batch, const double* force, double* rates) const {
  const Index size = coordinates(), members = batch.members;
  thread_local std::vector<double> kept;
  double* const sum = resized(kept, 2 * size);
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
