// SPDX-License-Identifier: MIT
#include "pipedyn/modular.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <stdexcept>
#include <string>
#include <utility>

namespace pipedyn {

namespace {

using Point = Eigen::Vector2d;
using Kind = Constraint::Kind;

std::size_t at(Index i) { return static_cast<std::size_t>(i); }

/// First coordinate of a node.
Index first_of(Index node) { return 3 * (node - 1); }

/// Nodes' positions or velocities among coordinates; that of node 0 is fixed.
struct Nodes {
  const double* q;
  double base;  // 0 for velocities

  Point operator()(Index node) const {
    if (node == 0) return {0.0, base};
    return {q[first_of(node)], q[first_of(node) + 1]};
  }
  double angle(Index joint) const { return q[first_of(joint) + 2]; }
};

/// Forces on nodes; node 0 takes any.
struct Loads {
  double* force;

  void add(Index node, const Point& f) const {
    if (node == 0) return;
    force[first_of(node)] += f.x();
    force[first_of(node) + 1] += f.y();
  }
};

double cross(const Point& a, const Point& d) { return a.x() * d.y() - a.y() * d.x(); }

/// cross(a, d) = a . turned(d) = turned_back(a) . d
Point turned(const Point& d) { return {d.y(), -d.x()}; }
Point turned_back(const Point& a) { return {-a.y(), a.x()}; }

/// A 2 x 2 block of nodes; what falls on node 0 is dropped.
void add_block(Triplets& out, Index row_node, Index column_node, const Eigen::Matrix2d& block) {
  if (row_node == 0 || column_node == 0) return;
  for (Index i = 0; i < 2; ++i) {
    for (Index k = 0; k < 2; ++k) {
      if (block(i, k) != 0.0) {
        out.add(first_of(row_node) + i, first_of(column_node) + k, block(i, k));
      }
    }
  }
}

void add_uniform(Triplets& out, Index row_node, Index column_node, double value) {
  add_block(out, row_node, column_node, value * Eigen::Matrix2d::Identity());
}

[[noreturn]] void refuse(const std::string& message) { throw std::invalid_argument(message); }

/// Coordinates of a group, in the order of its values.
std::vector<int> touched_by(const Constraint& constraint) {
  std::vector<int> touched;
  const auto add = [&](Index coordinate) { touched.push_back(static_cast<int>(coordinate)); };
  const Index own = first_of(constraint.node);
  switch (constraint.kind) {
    case Kind::clamp:
    case Kind::joint:
      for (Index node = std::max<Index>(1, constraint.node - 2); node <= constraint.node; ++node) {
        add(first_of(node));
        add(first_of(node) + 1);
      }
      add(own + 2);
      break;
    case Kind::guide:
      add(own);
      break;
    case Kind::pin:
      add(own);
      add(own + 1);
      break;
  }
  return touched;
}

/// Rows W with W^T W = the inertia, by elimination from the last coordinate, so that a local
/// inertia has local rows.
void factor_inertia(const Triplets& inertia, Index coordinates, std::vector<InertiaRow>& rows) {
  constexpr double rounding = 1e-10;
  std::vector<std::map<int, double>> matrix(at(coordinates));
  for (std::size_t i = 0; i < inertia.values.size(); ++i) {
    matrix[at(inertia.rows[i])][static_cast<int>(inertia.columns[i])] += inertia.values[i];
  }
  std::vector<double> diagonal(at(coordinates), 0.0);
  for (Index c = 0; c < coordinates; ++c) {
    const auto own = matrix[at(c)].find(static_cast<int>(c));
    if (own != matrix[at(c)].end()) diagonal[at(c)] = own->second;
    if (diagonal[at(c)] < 0.0) refuse("inertia must not be negative");
  }
  for (Index r = 0; r < coordinates; ++r) {
    for (const auto& [column, value] : matrix[at(r)]) {
      const auto& other = matrix[at(column)];
      const auto mirrored = other.find(static_cast<int>(r));
      const double transposed = mirrored == other.end() ? 0.0 : mirrored->second;
      const double size = std::max(std::abs(value), std::abs(transposed));
      if (std::abs(value - transposed) > rounding * size) refuse("inertia must be symmetric");
    }
  }
  for (int c = static_cast<int>(coordinates) - 1; c >= 0; --c) {
    std::map<int, double>& row = matrix[at(c)];
    while (!row.empty() && row.rbegin()->first > c) row.erase(std::prev(row.end()));
    const auto own = row.find(c);
    const double pivot = own == row.end() ? 0.0 : own->second;
    if (pivot <= rounding * diagonal[at(c)]) {
      const bool negative = pivot < -10.0 * rounding * diagonal[at(c)];
      for (const auto& [column, value] : row) {
        const double size = std::sqrt(diagonal[at(c)] * diagonal[at(column)]);
        if (negative || std::abs(value) > 1e-4 * size) refuse("inertia must not be negative");
      }
      continue;
    }
    InertiaRow factor;
    const double root = std::sqrt(pivot);
    for (const auto& [column, value] : row) {
      if (value == 0.0) continue;
      factor.coordinate.push_back(column);
      factor.weight.push_back(value / root);
    }
    for (std::size_t i = 0; i < factor.coordinate.size(); ++i) {
      for (std::size_t k = 0; k < factor.coordinate.size(); ++k) {
        if (factor.coordinate[i] == c || factor.coordinate[k] == c) continue;
        matrix[at(factor.coordinate[i])][factor.coordinate[k]] -=
            factor.weight[i] * factor.weight[k];
      }
    }
    rows.push_back(std::move(factor));
  }
}

void require_node(const char* what, Index node, Index segments, Index least = 1) {
  if (node < least || node > segments) {
    refuse(std::string(what) + " must lie in " + std::to_string(least) + ".." +
           std::to_string(segments) + ", got " + std::to_string(node));
  }
}

Enforcement enforcement_of(const Modules& modules) {
  const Segments& s = modules.segments;
  const Index n = s.length.size();
  if (n < 1 || s.center.size() != n || s.gyration_radius.size() != n || s.drag_point.size() != n) {
    refuse("segments must have one entry a segment in every array");
  }
  std::vector<double> scale(at(3 * n), 1.0);
  std::vector<InertiaRow> inertia;
  const auto add_row = [&](Index node, double before, double after) {
    for (Index i = 0; i < 2; ++i) {
      InertiaRow row;
      if (node > 1) {
        row.coordinate.push_back(static_cast<int>(first_of(node - 1) + i));
        row.weight.push_back(before);
      }
      row.coordinate.push_back(static_cast<int>(first_of(node) + i));
      row.weight.push_back(after);
      inertia.push_back(std::move(row));
    }
  };
  for (Index j = 1; j <= n; ++j) {
    const double l = s.length[j - 1], chi = s.center[j - 1], eta = s.gyration_radius[j - 1];
    if (!(l > 0.0)) refuse("length must be positive");
    scale[at(first_of(j) + 2)] = 1.0 / l;
    add_row(j, std::sqrt(l) * (1.0 - chi), std::sqrt(l) * chi);
    add_row(j, -eta / std::sqrt(l), eta / std::sqrt(l));
  }
  for (const PointMass& m : modules.masses) {
    require_node("mass_node", m.node, n);
    if (!(m.mass >= 0.0)) refuse("mass must not be negative");
    add_row(m.node, 0.0, std::sqrt(m.mass));
  }
  const Triplets& more = modules.inertia;
  if (more.rows.size() != more.values.size() || more.columns.size() != more.values.size()) {
    refuse("inertia must have as many rows and columns as values");
  }
  for (std::size_t i = 0; i < more.values.size(); ++i) {
    for (const std::int64_t c : {more.rows[i], more.columns[i]}) {
      if (c < 0 || c >= 3 * n) refuse("inertia must lie on the scene's coordinates");
    }
  }
  factor_inertia(more, 3 * n, inertia);
  for (const TorsionalSpring& spring : modules.springs) {
    require_node("spring_joint", spring.joint, n);
  }
  for (const TransverseSpring& spring : modules.transverse_springs) {
    require_node("transverse_node", spring.node, n);
  }
  for (const Dashpot& dashpot : modules.dashpots) require_node("dashpot_node", dashpot.node, n);
  std::vector<Group> groups;
  for (const Constraint& constraint : modules.constraints) {
    if (constraint.kind == Kind::clamp) {
      require_node("a clamp's constraint_node", constraint.node, 1);
    } else if (constraint.kind == Kind::joint) {
      require_node("a joint's constraint_node", constraint.node, n, 2);
    } else if (constraint.kind == Kind::guide || constraint.kind == Kind::pin) {
      require_node("constraint_node", constraint.node, n);
    } else {
      refuse("constraint_kind must lie in 0..3");
    }
    groups.push_back({touched_by(constraint), constraint.rows()});
  }
  return Enforcement(std::move(scale), std::move(inertia), std::move(groups));
}

}  // namespace

Scene::Scene(const Pipe& pipe, Modules modules)
    : pipe_(pipe), modules_(std::move(modules)), enforcement_(enforcement_of(modules_)) {
  const Index n = segments();
  joint_stiffness_ = joint_damping_ = joint_moment_ = weight_ = Vector::Zero(n);
  for (const TorsionalSpring& spring : modules_.springs) {
    joint_stiffness_[spring.joint - 1] += spring.stiffness;
    joint_damping_[spring.joint - 1] += spring.damping;
    joint_moment_[spring.joint - 1] += spring.stiffness * spring.rest;
  }
  for (Index j = 1; j <= n; ++j) {
    const double weight = pipe_.gamma * modules_.segments.length[j - 1];
    const double share = modules_.segments.center[j - 1];
    if (j > 1) weight_[j - 2] += (1.0 - share) * weight;
    weight_[j - 1] += share * weight;
  }
  for (const PointMass& m : modules_.masses) weight_[m.node - 1] += pipe_.gamma * m.mass;

  std::size_t entries = 0;
  for (const Constraint& constraint : modules_.constraints) {
    matrix_start_.push_back(entries);
    entries += touched_by(constraint).size() * static_cast<std::size_t>(constraint.rows());
    rows_ += constraint.rows();
  }
  matrix_start_.push_back(entries);
}

void Scene::require(const char* name, Index size, Index expected) const {
  if (size != expected) {
    refuse(std::string(name) + " must have " + std::to_string(expected) + " entries, got " +
           std::to_string(size));
  }
}

Vector Scene::straight() const {
  Vector q = Vector::Zero(coordinates());
  double y = modules_.segments.base;
  for (Index j = 1; j <= segments(); ++j) {
    y += modules_.segments.length[j - 1];
    q[first_of(j) + 1] = y;
  }
  return q;
}

RedundantOperators Scene::operators() const {
  const Index n = segments();
  const Segments& s = modules_.segments;
  RedundantOperators ops;
  for (Index j = 1; j <= n; ++j) {
    const double l = s.length[j - 1], chi = s.center[j - 1], eta = s.gyration_radius[j - 1];
    const double turning = eta * eta / l, exchange = l * chi * (1.0 - chi) - turning;
    add_uniform(ops.mass, j - 1, j - 1, l * (1.0 - chi) * (1.0 - chi) + turning);
    add_uniform(ops.mass, j - 1, j, exchange);
    add_uniform(ops.mass, j, j - 1, exchange);
    add_uniform(ops.mass, j, j, l * chi * chi + turning);
    const Index phi = first_of(j) + 2;
    if (joint_stiffness_[j - 1] != 0.0) ops.stiffness.add(phi, phi, joint_stiffness_[j - 1]);
    if (joint_damping_[j - 1] != 0.0) ops.damping.add(phi, phi, joint_damping_[j - 1]);
    if (modules_.flow) {
      add_uniform(ops.gyroscopic, j - 1, j, pipe_.sqrt_beta());
      add_uniform(ops.gyroscopic, j, j - 1, -pipe_.sqrt_beta());
    }
  }
  for (const PointMass& m : modules_.masses) add_uniform(ops.mass, m.node, m.node, m.mass);
  const Triplets& more = modules_.inertia;
  for (std::size_t i = 0; i < more.values.size(); ++i) {
    ops.mass.add(more.rows[i], more.columns[i], more.values[i]);
  }
  for (const TransverseSpring& spring : modules_.transverse_springs) {
    ops.stiffness.add(first_of(spring.node), first_of(spring.node), spring.stiffness);
  }
  for (const Dashpot& dashpot : modules_.dashpots) {
    ops.damping.add(first_of(dashpot.node), first_of(dashpot.node), dashpot.coefficient);
  }
  if (modules_.flow) {
    add_uniform(ops.end_flux, n, n, pipe_.sqrt_beta());
    add_uniform(ops.flux, n, n, 1.0 / s.length[n - 1]);
    add_uniform(ops.flux, n, n - 1, -1.0 / s.length[n - 1]);
  }
  return ops;
}

// -------------------------------------------------------------------------------------- forces

void Scene::add_forces(const double* q, const double* rates, double u, double* force) const {
  const Index n = segments();
  const Segments& s = modules_.segments;
  const Nodes place{q, s.base}, velocity{rates, 0.0};
  const Loads loads{force};
  for (Index j = 1; j <= n; ++j) {
    force[first_of(j) + 1] += weight_[j - 1];
    force[first_of(j) + 2] += joint_moment_[j - 1] - joint_stiffness_[j - 1] * place.angle(j) -
                              joint_damping_[j - 1] * velocity.angle(j);
  }
  for (const TransverseSpring& spring : modules_.transverse_springs) {
    force[first_of(spring.node)] -= spring.stiffness * q[first_of(spring.node)];
  }
  for (const Dashpot& dashpot : modules_.dashpots) {
    force[first_of(dashpot.node)] -= dashpot.coefficient * rates[first_of(dashpot.node)];
  }
  if (modules_.flow) {
    const double coriolis = pipe_.sqrt_beta() * pipe_.direction() * u;
    for (Index j = 1; j <= n; ++j) {
      loads.add(j - 1, -coriolis * velocity(j));
      loads.add(j, coriolis * velocity(j - 1));
    }
    const Point tangent = (place(n) - place(n - 1)) / s.length[n - 1];
    loads.add(n, -coriolis * velocity(n) - pipe_.centrifugal() * u * u * tangent);
  }
  if (modules_.drag && pipe_.drag != 0.0) {
    for (Index j = 1; j <= n; ++j) {
      const double l = s.length[j - 1], xi = s.drag_point[j - 1];
      const Point normal = turned((place(j) - place(j - 1)) / l);
      const double v = normal.dot((1.0 - xi) * velocity(j - 1) + xi * velocity(j));
      const Point drag = -pipe_.drag * l * std::abs(v) * v * normal;
      loads.add(j - 1, (1.0 - xi) * drag);
      loads.add(j, xi * drag);
    }
  }
}

Vector Scene::forces(const Vector& y, double u) const {
  require("y", y.size(), 2 * coordinates());
  Vector force = Vector::Zero(coordinates());
  add_forces(y.data(), y.data() + coordinates(), u, force.data());
  return force;
}

Derivatives Scene::force_derivatives(const Vector& y, double u) const {
  require("y", y.size(), 2 * coordinates());
  const Index n = segments();
  const Segments& s = modules_.segments;
  const Nodes place{y.data(), s.base}, velocity{y.data() + coordinates(), 0.0};
  Derivatives out;
  auto& [by_q, by_rates] = out;
  for (Index j = 1; j <= n; ++j) {
    const Index phi = first_of(j) + 2;
    if (joint_stiffness_[j - 1] != 0.0) by_q.add(phi, phi, -joint_stiffness_[j - 1]);
    if (joint_damping_[j - 1] != 0.0) by_rates.add(phi, phi, -joint_damping_[j - 1]);
  }
  for (const TransverseSpring& spring : modules_.transverse_springs) {
    by_q.add(first_of(spring.node), first_of(spring.node), -spring.stiffness);
  }
  for (const Dashpot& dashpot : modules_.dashpots) {
    by_rates.add(first_of(dashpot.node), first_of(dashpot.node), -dashpot.coefficient);
  }
  if (modules_.flow) {
    const double coriolis = pipe_.sqrt_beta() * pipe_.direction() * u;
    const double thrust = pipe_.centrifugal() * u * u / s.length[n - 1];
    for (Index j = 1; j <= n; ++j) {
      add_uniform(by_rates, j - 1, j, -coriolis);
      add_uniform(by_rates, j, j - 1, coriolis);
    }
    add_uniform(by_rates, n, n, -coriolis);
    add_uniform(by_q, n, n, -thrust);
    add_uniform(by_q, n, n - 1, thrust);
  }
  if (modules_.drag && pipe_.drag != 0.0) {
    for (Index j = 1; j <= n; ++j) {
      const double l = s.length[j - 1];
      const std::array<double, 2> share = {1.0 - s.drag_point[j - 1], s.drag_point[j - 1]};
      const Point normal = turned((place(j) - place(j - 1)) / l);
      const Point w = share[0] * velocity(j - 1) + share[1] * velocity(j);
      const double v = normal.dot(w);
      const Eigen::Matrix2d turn{{0.0, 1.0}, {-1.0, 0.0}};
      const Eigen::Matrix2d by_velocity =
          -2.0 * pipe_.drag * l * std::abs(v) * normal * normal.transpose();
      const Eigen::Matrix2d by_tangent =
          -pipe_.drag * std::abs(v) * (2.0 * normal * (w.transpose() * turn) + v * turn);
      for (Index i = 0; i < 2; ++i) {
        for (Index k = 0; k < 2; ++k) {
          add_block(by_rates, j - 1 + i, j - 1 + k, share[at(i)] * share[at(k)] * by_velocity);
          add_block(by_q, j - 1 + i, j - 1 + k, (k == 0 ? -1.0 : 1.0) * share[at(i)] * by_tangent);
        }
      }
    }
  }
  return out;
}

// --------------------------------------------------------------------------------- constraints

/// Any of residual, matrix and right_side may be null. matrix: each group's rows over the
/// coordinates that it touches.
void Scene::fill_constraints(const double* q, const double* rates, double* residual, double* matrix,
                             double* right_side) const {
  const Segments& s = modules_.segments;
  const Nodes place{q, s.base}, velocity{rates, 0.0};
  Index row = 0;
  for (std::size_t group = 0; group < modules_.constraints.size(); ++group) {
    const Constraint& constraint = modules_.constraints[group];
    const Index j = constraint.node;
    double* const values = matrix + matrix_start_[group];
    double* const g = residual + row;
    double* const b = right_side + row;
    row += constraint.rows();
    if (constraint.kind == Kind::guide) {
      g[0] = q[first_of(j)];
      values[0] = 1.0;
      b[0] = 0.0;
      continue;
    }
    if (constraint.kind == Kind::pin) {
      g[0] = q[first_of(j)] - constraint.x;
      g[1] = q[first_of(j) + 1] - constraint.y;
      values[0] = values[3] = 1.0;
      values[1] = values[2] = 0.0;
      b[0] = b[1] = 0.0;
      continue;
    }
    const double l = s.length[j - 1], phi = place.angle(j), turning = velocity.angle(j);
    const double sine = l * std::sin(phi), cosine = l * std::cos(phi);
    const Point a = place(j) - place(j - 1);
    // The clamp is a joint to a fixed segment of unit length, d = (0, 1).
    const bool clamp = constraint.kind == Kind::clamp;
    const double before = clamp ? 1.0 : s.length[j - 2];
    const Point d = clamp ? Point(0.0, 1.0) : Point((place(j - 1) - place(j - 2)) / before);
    const Point da = velocity(j) - velocity(j - 1);
    const Point dd = clamp ? Point(0.0, 0.0) : Point((velocity(j - 1) - velocity(j - 2)) / before);
    g[0] = a.dot(d) - cosine;
    g[1] = cross(a, d) - sine;
    b[0] = -2.0 * da.dot(dd) - cosine * turning * turning;
    b[1] = -2.0 * cross(da, dd) - sine * turning * turning;
    double* to = values;
    const int touched = clamp ? 3 : j == 2 ? 5 : 7;
    const auto add = [&](const Point& first, const Point& second) {
      to[0] = first.x();
      to[1] = first.y();
      to[touched] = second.x();
      to[touched + 1] = second.y();
      to += 2;
    };
    const Point a_scaled = a / before, across = turned(d), back = turned_back(a_scaled);
    if (!clamp) {
      if (j > 2) add(-a_scaled, -back);
      add(a_scaled - d, back - across);
    }
    add(d, across);
    to[0] = sine;
    to[touched] = -cosine;
  }
}

namespace {

struct ConstraintMemory {
  std::vector<double> residual, matrix, right_side;

  void fit(std::size_t rows, std::size_t entries) {
    if (residual.size() < rows) residual.resize(rows);
    if (right_side.size() < rows) right_side.resize(rows);
    if (matrix.size() < entries) matrix.resize(entries);
  }
};

}  // namespace

ConstraintRows Scene::constraints(const Vector& y) const {
  require("y", y.size(), 2 * coordinates());
  ConstraintRows out;
  out.residual.resize(rows_);
  out.right_side.resize(rows_);
  std::vector<double> values(matrix_start_.back());
  fill_constraints(y.data(), y.data() + coordinates(), out.residual.data(), values.data(),
                   out.right_side.data());
  Index row = 0;
  std::size_t entry = 0;
  for (std::size_t group = 0; group < modules_.constraints.size(); ++group) {
    const std::vector<int> touched = touched_by(modules_.constraints[group]);
    for (int r = 0; r < modules_.constraints[group].rows(); ++r, ++row) {
      out.group.push_back(static_cast<std::int64_t>(group));
      for (const int c : touched) out.matrix.add(row, c, values[entry++]);
    }
  }
  return out;
}

Triplets Scene::curvature(const Vector& q, const Vector& multipliers) const {
  require("q", q.size(), coordinates());
  require("multipliers", multipliers.size(), rows_);
  const Segments& s = modules_.segments;
  Triplets out;
  Index row = 0;
  for (const Constraint& constraint : modules_.constraints) {
    const Index j = constraint.node, own = row;
    row += constraint.rows();
    if (constraint.kind != Kind::clamp && constraint.kind != Kind::joint) continue;
    const double first = multipliers[own], second = multipliers[own + 1];
    const Index phi = first_of(j) + 2;
    const double l = s.length[j - 1];
    out.add(phi, phi, l * (first * std::cos(q[phi]) + second * std::sin(q[phi])));
    if (constraint.kind == Kind::clamp) continue;
    // a^T block d, of which a = r_j - r_{j-1} and d = r_{j-1} - r_{j-2}
    const double before = s.length[j - 2];
    const Eigen::Matrix2d block{{first / before, second / before},
                                {-second / before, first / before}};
    for (Index of_a = 0; of_a < 2; ++of_a) {
      for (Index of_d = 0; of_d < 2; ++of_d) {
        const Eigen::Matrix2d signed_block = of_a == of_d ? block : -block;
        add_block(out, j - of_a, j - 1 - of_d, signed_block);
        add_block(out, j - 1 - of_d, j - of_a, signed_block.transpose());
      }
    }
  }
  return out;
}

Derivatives Scene::acceleration_derivatives(const Vector& y, const Vector& acceleration) const {
  require("y", y.size(), 2 * coordinates());
  require("acceleration", acceleration.size(), coordinates());
  const Segments& s = modules_.segments;
  const Nodes place{y.data(), s.base}, velocity{y.data() + coordinates(), 0.0};
  const Nodes change{acceleration.data(), 0.0};
  Derivatives out;
  auto& [by_q, by_rates] = out;
  Index row = 0;
  const auto add = [&row](Triplets& to, Index node, const Point& first, const Point& second) {
    if (node == 0) return;
    for (Index i = 0; i < 2; ++i) {
      to.add(row, first_of(node) + i, first[i]);
      to.add(row + 1, first_of(node) + i, second[i]);
    }
  };
  for (const Constraint& constraint : modules_.constraints) {
    const Index j = constraint.node;
    if (constraint.kind == Kind::clamp || constraint.kind == Kind::joint) {
      const double l = s.length[j - 1], phi = place.angle(j);
      const double sine = l * std::sin(phi), cosine = l * std::cos(phi);
      const double rate = velocity.angle(j), turning = change.angle(j);
      const Index own = first_of(j) + 2;
      by_q.add(row, own, cosine * turning - sine * rate * rate);
      by_q.add(row + 1, own, sine * turning + cosine * rate * rate);
      by_rates.add(row, own, 2.0 * cosine * rate);
      by_rates.add(row + 1, own, 2.0 * sine * rate);
      if (constraint.kind == Kind::joint) {
        // a''. d + a . d'' + 2 a'. d' and its like with the cross product
        const double before = s.length[j - 2];
        const auto by_node = [&](Triplets& to, const Point& of_a, const Point& of_d) {
          add(to, j, of_d, turned(of_d));
          add(to, j - 1, of_a - of_d, turned_back(of_a) - turned(of_d));
          add(to, j - 2, -of_a, -turned_back(of_a));
        };
        by_node(by_q, (change(j) - change(j - 1)) / before,
                (change(j - 1) - change(j - 2)) / before);
        by_node(by_rates, 2.0 / before * (velocity(j) - velocity(j - 1)),
                2.0 / before * (velocity(j - 1) - velocity(j - 2)));
      }
    }
    row += constraint.rows();
  }
  return out;
}

// -------------------------------------------------------------------------------------- motion

Matrix Scene::from_angles(const Matrix& theta, const Matrix& omega) const {
  const Index n = segments();
  require("theta", theta.rows(), n);
  require("omega", omega.rows(), n);
  require("a row of omega", omega.cols(), theta.cols());
  Matrix states(6 * n, theta.cols());
  for (Index k = 0; k < theta.cols(); ++k) {
    Point r(0.0, modules_.segments.base), v(0.0, 0.0);
    for (Index j = 0; j < n; ++j) {
      const double l = modules_.segments.length[j];
      const Point tangent(std::sin(theta(j, k)), std::cos(theta(j, k)));
      r += l * tangent;
      v += l * omega(j, k) * turned(tangent);
      states(3 * j, k) = r.x();
      states(3 * j + 1, k) = r.y();
      states(3 * j + 2, k) = theta(j, k) - (j > 0 ? theta(j - 1, k) : 0.0);
      states(3 * (n + j), k) = v.x();
      states(3 * (n + j) + 1, k) = v.y();
      states(3 * (n + j) + 2, k) = omega(j, k) - (j > 0 ? omega(j - 1, k) : 0.0);
    }
  }
  return states;
}

void Scene::rhs(const Batch& batch, const double* force, double* rates) const {
  const Index size = coordinates(), members = batch.members;
  thread_local std::vector<double> state, sum, acceleration;
  thread_local ConstraintMemory memory;
  if (state.size() < at(2 * size)) state.resize(at(2 * size));
  if (sum.size() < at(size)) sum.resize(at(size));
  if (acceleration.size() < at(size)) acceleration.resize(at(size));
  memory.fit(at(rows_), matrix_start_.back());
  const double* const q = state.data();
  for (Index k = 0; k < members; ++k) {
    for (Index i = 0; i < 2 * size; ++i) state[at(i)] = batch.y[i * members + k];
    for (Index i = 0; i < size; ++i) {
      sum[at(i)] = force != nullptr ? force[i * members + k] : 0.0;
    }
    add_forces(q, q + size, batch.u[k * batch.u_step], sum.data());
    fill_constraints(q, q + size, memory.residual.data(), memory.matrix.data(),
                     memory.right_side.data());
    const int lacking = enforcement_.solve(memory.matrix.data(), memory.right_side.data(),
                                           sum.data(), acceleration.data());
    if (lacking != Enforcement::complete) {
      std::fill_n(acceleration.begin(), size, std::numeric_limits<double>::quiet_NaN());
    }
    for (Index i = 0; i < size; ++i) {
      rates[i * members + k] = state[at(size + i)];
      rates[(size + i) * members + k] = acceleration[at(i)];
    }
  }
}

Index Scene::lacking(const Vector& q) const {
  require("q", q.size(), coordinates());
  const Vector still = Vector::Zero(coordinates());
  Vector acceleration(coordinates());
  ConstraintMemory memory;
  memory.fit(at(rows_), matrix_start_.back());
  fill_constraints(q.data(), still.data(), memory.residual.data(), memory.matrix.data(),
                   memory.right_side.data());
  return enforcement_.solve(memory.matrix.data(), memory.right_side.data(), still.data(),
                            acceleration.data());
}

void Scene::energy(const Batch& batch, double* out) const {
  const Index n = segments(), size = coordinates(), members = batch.members;
  const Segments& s = modules_.segments;
  std::vector<double> state(at(2 * size));
  for (Index k = 0; k < members; ++k) {
    for (Index i = 0; i < 2 * size; ++i) state[at(i)] = batch.y[i * members + k];
    const double* const rates = state.data() + size;
    const Nodes place{state.data(), s.base}, velocity{rates, 0.0};
    double y = s.base, sum = 0.0;
    for (Index j = 1; j <= n; ++j) {
      const double l = s.length[j - 1], chi = s.center[j - 1], eta = s.gyration_radius[j - 1];
      const Point center = (1.0 - chi) * velocity(j - 1) + chi * velocity(j);
      const Point turning = (eta / l) * (velocity(j) - velocity(j - 1));
      const double phi = place.angle(j);
      y += l;
      sum += 0.5 * l * (center.squaredNorm() + turning.squaredNorm()) +
             phi * (0.5 * joint_stiffness_[j - 1] * phi - joint_moment_[j - 1]) +
             weight_[j - 1] * (y - place(j).y());
    }
    for (const PointMass& m : modules_.masses) {
      sum += 0.5 * m.mass * velocity(m.node).squaredNorm();
    }
    for (const TransverseSpring& spring : modules_.transverse_springs) {
      const double x = state[at(first_of(spring.node))];
      sum += 0.5 * spring.stiffness * x * x;
    }
    const Triplets& more = modules_.inertia;
    for (std::size_t i = 0; i < more.values.size(); ++i) {
      sum += 0.5 * rates[more.rows[i]] * more.values[i] * rates[more.columns[i]];
    }
    out[k] = sum;
  }
}

void Scene::power(const Batch& batch, const ScenePowerParts& out) const {
  const Index n = segments(), size = coordinates(), members = batch.members;
  const Segments& s = modules_.segments;
  std::vector<double> state(at(2 * size));
  for (Index k = 0; k < members; ++k) {
    for (Index i = 0; i < 2 * size; ++i) state[at(i)] = batch.y[i * members + k];
    const Nodes place{state.data(), s.base}, velocity{state.data() + size, 0.0};
    const double u = batch.u[k * batch.u_step];
    double joints = 0.0, drag = 0.0, others = 0.0;
    for (Index j = 1; j <= n; ++j) {
      joints -= joint_damping_[j - 1] * velocity.angle(j) * velocity.angle(j);
      if (!modules_.drag) continue;
      const double l = s.length[j - 1], xi = s.drag_point[j - 1];
      const Point normal = turned((place(j) - place(j - 1)) / l);
      const double v = normal.dot((1.0 - xi) * velocity(j - 1) + xi * velocity(j));
      drag -= pipe_.drag * l * std::abs(v) * v * v;
    }
    for (const Dashpot& dashpot : modules_.dashpots) {
      const double v = state[at(size + first_of(dashpot.node))];
      others -= dashpot.coefficient * v * v;
    }
    out.flow[k] = 0.0;
    if (modules_.flow) {
      const Point end = velocity(n), tangent = (place(n) - place(n - 1)) / s.length[n - 1];
      out.flow[k] = -pipe_.sqrt_beta() * pipe_.direction() * u * end.squaredNorm() -
                    pipe_.centrifugal() * u * u * tangent.dot(end);
    }
    out.joints[k] = joints;
    out.drag[k] = drag;
    out.others[k] = others;
  }
}

}  // namespace pipedyn
