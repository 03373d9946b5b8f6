// SPDX-License-Identifier: MIT
#include "pipedyn/modular/modules.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>
#include <stdexcept>
#include <string>
#include <utility>

namespace pipedyn {

namespace {

[[noreturn]] void refuse(const std::string& message) { throw std::invalid_argument(message); }

void require_place(const char* name, Index place, Index segments) {
  if (place < 1 || place > segments) {
    refuse(std::string(name) + " must lie in 1.." + std::to_string(segments) + ", got " +
           std::to_string(place));
  }
}

/// 1/2 |before r_{j-1}' + after r_j'|^2, in each direction.
void add_rows(std::vector<InertiaRow>& rows, Index node, double before, double after) {
  for (Index i = 0; i < 2; ++i) {
    InertiaRow row;
    if (node > 1) {
      row.coordinate.push_back(static_cast<int>(x_of(node - 1) + i));
      row.weight.push_back(before);
    }
    row.coordinate.push_back(static_cast<int>(x_of(node) + i));
    row.weight.push_back(after);
    rows.push_back(std::move(row));
  }
}

}  // namespace

// ------------------------------------------------------------------------------------- segment

void Segment::check(Index) const {
  if (!(length > 0.0)) refuse("length must be positive");
}

void Segment::add_inertia(std::vector<InertiaRow>& rows) const {
  const double root = std::sqrt(length), turning = gyration_radius / root;
  add_rows(rows, node, root * (1.0 - center), root * center);
  add_rows(rows, node, -turning, turning);
}

void Segment::add_operators(RedundantOperators& ops) const {
  const double turning = gyration_radius * gyration_radius / length;
  const double exchange = length * center * (1.0 - center) - turning;
  ops.mass.add_uniform(node - 1, node - 1, length * (1.0 - center) * (1.0 - center) + turning);
  ops.mass.add_uniform(node - 1, node, exchange);
  ops.mass.add_uniform(node, node - 1, exchange);
  ops.mass.add_uniform(node, node, length * center * center + turning);
}

void Segment::add_force(const Motion&, const Loads& loads) const {
  loads.add(node - 1, {0.0, (1.0 - center) * weight});
  loads.add(node, {0.0, center * weight});
}

double Segment::energy(const Motion& motion) const {
  const Point before = motion.rate(node - 1), after = motion.rate(node);
  const double turning = gyration_radius / length;
  const double height =
      (1.0 - center) * motion.place(node - 1).y() + center * motion.place(node).y();
  return 0.5 * length *
             (((1.0 - center) * before + center * after).squaredNorm() +
              turning * turning * (after - before).squaredNorm()) -
         weight * (height - straight_height);
}

// ---------------------------------------------------------------------------- springs, dashpots

void TorsionalSpring::check(Index segments) const {
  require_place("spring_joint", joint, segments);
}

void TorsionalSpring::add_operators(RedundantOperators& ops) const {
  ops.stiffness.add(phi_of(joint), phi_of(joint), stiffness);
  ops.damping.add(phi_of(joint), phi_of(joint), damping);
}

void TorsionalSpring::add_force(const Motion& motion, const Loads& loads) const {
  loads.add_moment(
      joint, -stiffness * (motion.place.angle(joint) - rest) - damping * motion.rate.angle(joint));
}

void TorsionalSpring::add_derivatives(const Motion&, Derivatives& out) const {
  out.by_coordinates.add(phi_of(joint), phi_of(joint), -stiffness);
  out.by_rates.add(phi_of(joint), phi_of(joint), -damping);
}

double TorsionalSpring::energy(const Motion& motion) const {
  const double phi = motion.place.angle(joint);
  return 0.5 * stiffness * phi * (phi - 2.0 * rest);
}

void TorsionalSpring::add_power(const Motion& motion, ScenePower& out) const {
  const double turning = motion.rate.angle(joint);
  out.joints -= damping * turning * turning;
}

void TransverseSpring::check(Index segments) const {
  require_place("transverse_node", node, segments);
}

void TransverseSpring::add_operators(RedundantOperators& ops) const {
  ops.stiffness.add(x_of(node), x_of(node), stiffness);
}

void TransverseSpring::add_force(const Motion& motion, const Loads& loads) const {
  loads.add_x(node, -stiffness * motion.place.x(node));
}

void TransverseSpring::add_derivatives(const Motion&, Derivatives& out) const {
  out.by_coordinates.add(x_of(node), x_of(node), -stiffness);
}

double TransverseSpring::energy(const Motion& motion) const {
  const double x = motion.place.x(node);
  return 0.5 * stiffness * x * x;
}

void Dashpot::check(Index segments) const { require_place("dashpot_node", node, segments); }

void Dashpot::add_operators(RedundantOperators& ops) const {
  ops.damping.add(x_of(node), x_of(node), coefficient);
}

void Dashpot::add_force(const Motion& motion, const Loads& loads) const {
  loads.add_x(node, -coefficient * motion.rate.x(node));
}

void Dashpot::add_derivatives(const Motion&, Derivatives& out) const {
  out.by_rates.add(x_of(node), x_of(node), -coefficient);
}

void Dashpot::add_power(const Motion& motion, ScenePower& out) const {
  const double speed = motion.rate.x(node);
  out.others -= coefficient * speed * speed;
}

// --------------------------------------------------------------------------------------- masses

void PointMass::check(Index segments) const {
  require_place("mass_node", node, segments);
  if (!(mass >= 0.0)) refuse("mass must not be negative");
}

void PointMass::add_inertia(std::vector<InertiaRow>& rows) const {
  add_rows(rows, node, 0.0, std::sqrt(mass));
}

void PointMass::add_operators(RedundantOperators& ops) const {
  ops.mass.add_uniform(node, node, mass);
}

void PointMass::add_force(const Motion&, const Loads& loads) const {
  loads.add(node, {0.0, weight});
}

double PointMass::energy(const Motion& motion) const {
  return 0.5 * mass * motion.rate(node).squaredNorm() -
         weight * (motion.place(node).y() - straight_height);
}

void FurtherInertia::check(Index segments) const {
  const std::size_t count = matrix.values.size();
  if (matrix.rows.size() != count || matrix.columns.size() != count) {
    refuse("inertia must have as many rows and columns as values");
  }
  for (std::size_t i = 0; i < count; ++i) {
    for (const std::int64_t c : {matrix.rows[i], matrix.columns[i]}) {
      if (c < 0 || c >= 3 * segments) refuse("inertia must lie on the scene's coordinates");
    }
  }
}

void FurtherInertia::add_inertia(std::vector<InertiaRow>& rows) const {
  constexpr double rounding = 1e-10;
  std::map<int, std::map<int, double>> left;
  for (std::size_t i = 0; i < matrix.values.size(); ++i) {
    left[static_cast<int>(matrix.rows[i])][static_cast<int>(matrix.columns[i])] += matrix.values[i];
  }
  const auto entry = [&left](int row, int column) {
    const auto entries = left.find(row);
    if (entries == left.end()) return 0.0;
    const auto found = entries->second.find(column);
    return found == entries->second.end() ? 0.0 : found->second;
  };
  std::map<int, double> diagonal;
  for (const auto& [row, entries] : left) {
    for (const auto& [column, value] : entries) {
      const double transposed = entry(column, row);
      const double size = std::max(std::abs(value), std::abs(transposed));
      if (std::abs(value - transposed) > rounding * size) refuse("inertia must be symmetric");
      diagonal[column] = entry(column, column);
    }
  }
  while (!left.empty()) {
    const int c = left.rbegin()->first;
    const std::map<int, double> entries = std::move(left.rbegin()->second);
    left.erase(c);
    const auto own = entries.find(c);
    const double pivot = own == entries.end() ? 0.0 : own->second;
    if (pivot <= rounding * diagonal[c]) {
      // of a semidefinite matrix nothing is left in this row but rounding
      bool negative = pivot < -10.0 * rounding * std::abs(diagonal[c]) || diagonal[c] < 0.0;
      for (const auto& [column, value] : entries) {
        const double size = std::sqrt(std::abs(diagonal[c] * diagonal[column]));
        negative = negative || std::abs(value) > 1e-4 * size;
      }
      if (negative) refuse("inertia must not be negative");
      for (auto& [row, others] : left) others.erase(c);
      continue;
    }
    InertiaRow factor;
    const double root = std::sqrt(pivot);
    for (const auto& [column, value] : entries) {
      factor.coordinate.push_back(column);
      factor.weight.push_back(value / root);
    }
    for (const int row : factor.coordinate) {
      if (row == c) continue;
      std::map<int, double>& others = left[row];
      const double weight = entries.at(row) / pivot;
      for (const auto& [column, value] : entries) {
        if (column != c) others[column] -= weight * value;
      }
      others.erase(c);
    }
    rows.push_back(std::move(factor));
  }
}

void FurtherInertia::add_operators(RedundantOperators& ops) const {
  for (std::size_t i = 0; i < matrix.values.size(); ++i) {
    ops.mass.add(matrix.rows[i], matrix.columns[i], matrix.values[i]);
  }
}

double FurtherInertia::energy(const Motion& motion) const {
  double sum = 0.0;
  for (std::size_t i = 0; i < matrix.values.size(); ++i) {
    sum += motion.rate.values[matrix.rows[i]] * matrix.values[i] *
           motion.rate.values[matrix.columns[i]];
  }
  return 0.5 * sum;
}

// ----------------------------------------------------------------------------------------- flow

void InternalFlow::add_operators(RedundantOperators& ops) const {
  for (Index j = 1; j <= segments; ++j) {
    ops.gyroscopic.add_uniform(j - 1, j, sqrt_beta);
    ops.gyroscopic.add_uniform(j, j - 1, -sqrt_beta);
  }
  ops.end_flux.add_uniform(segments, segments, sqrt_beta);
  ops.flux.add_uniform(segments, segments, 1.0 / last_length);
  ops.flux.add_uniform(segments, segments - 1, -1.0 / last_length);
}

void InternalFlow::add_force(const Motion& motion, const Loads& loads) const {
  const double u = motion.flow_speed, coriolis = sqrt_beta * u;
  const Index n = segments;
  Point before(0.0, 0.0);
  for (Index j = 1; j <= n; ++j) {
    const Point after = motion.rate(j);
    loads.add(j - 1, -coriolis * after);
    loads.add(j, coriolis * before);
    before = after;
  }
  const Point tangent = (motion.place(n) - motion.place(n - 1)) / last_length;
  loads.add(n, -coriolis * before - centrifugal * u * u * tangent);
}

void InternalFlow::add_derivatives(const Motion& motion, Derivatives& out) const {
  const double u = motion.flow_speed, coriolis = sqrt_beta * u;
  const double thrust = centrifugal * u * u / last_length;
  for (Index j = 1; j <= segments; ++j) {
    out.by_rates.add_uniform(j - 1, j, -coriolis);
    out.by_rates.add_uniform(j, j - 1, coriolis);
  }
  out.by_rates.add_uniform(segments, segments, -coriolis);
  out.by_coordinates.add_uniform(segments, segments, -thrust);
  out.by_coordinates.add_uniform(segments, segments - 1, thrust);
}

void InternalFlow::add_power(const Motion& motion, ScenePower& out) const {
  const double u = motion.flow_speed;
  const Point end = motion.rate(segments);
  const Point tangent = (motion.place(segments) - motion.place(segments - 1)) / last_length;
  out.flow -= sqrt_beta * u * end.squaredNorm() + centrifugal * u * u * tangent.dot(end);
}

// ----------------------------------------------------------------------------------------- drag

Point Drag::normal(const Motion& motion) const {
  return turned((motion.place(node) - motion.place(node - 1)) / length);
}

Point Drag::velocity(const Motion& motion) const {
  return (1.0 - point) * motion.rate(node - 1) + point * motion.rate(node);
}

void Drag::add_force(const Motion& motion, const Loads& loads) const {
  const Point n = normal(motion);
  const double v = n.dot(velocity(motion));
  const Point force = -coefficient * length * std::abs(v) * v * n;
  loads.add(node - 1, (1.0 - point) * force);
  loads.add(node, point * force);
}

void Drag::add_derivatives(const Motion& motion, Derivatives& out) const {
  const Point n = normal(motion), w = velocity(motion);
  const double v = n.dot(w), size = coefficient * std::abs(v);
  const Block turn{{0.0, 1.0}, {-1.0, 0.0}};  // n = turn t, d v = w^T turn d t
  const Block by_velocity = -2.0 * size * length * n * n.transpose();
  const Block by_tangent = -size * (2.0 * n * (w.transpose() * turn) + v * turn);
  const double share[] = {1.0 - point, point};
  for (Index i = 0; i < 2; ++i) {
    for (Index k = 0; k < 2; ++k) {
      const Index row = node - 1 + i, column = node - 1 + k;
      out.by_rates.add_block(row, column, share[i] * share[k] * by_velocity);
      out.by_coordinates.add_block(row, column, (k == 0 ? -share[i] : share[i]) * by_tangent);
    }
  }
}

void Drag::add_power(const Motion& motion, ScenePower& out) const {
  const double v = normal(motion).dot(velocity(motion));
  out.drag -= coefficient * length * std::abs(v) * v * v;
}

}  // namespace pipedyn
