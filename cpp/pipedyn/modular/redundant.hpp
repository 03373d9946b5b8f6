// SPDX-License-Identifier: MIT
//
// Redundant coordinates q = (x_j, y_j, phi_j), j = 1..n, at 3 (j - 1), 3 (j - 1) + 1 and
// 3 (j - 1) + 2: node P_j at r_j = (x_j, y_j), x across, y down from the clamp, and joint angle
// phi_j. r_0 = (0, base) stays. What modules and constraints read and write of them.
#pragma once

#include <cstdint>
#include <vector>

#include "pipedyn/pipe.hpp"

namespace pipedyn {

using Point = Eigen::Vector2d;
using Block = Eigen::Matrix2d;

inline Index x_of(Index node) { return 3 * (node - 1); }
inline Index y_of(Index node) { return x_of(node) + 1; }
inline Index phi_of(Index joint) { return x_of(joint) + 2; }

/// cross(a, d) = a_x d_y - a_y d_x = a . turned(d) = turned_back(a) . d
inline double cross(const Point& a, const Point& d) { return a.x() * d.y() - a.y() * d.x(); }
inline Point turned(const Point& d) { return {d.y(), -d.x()}; }
inline Point turned_back(const Point& a) { return {-a.y(), a.x()}; }

/// Coordinates, rates or accelerations, by nodes and joints.
struct Nodes {
  const double* values;
  double base;  // y_0; 0 for rates and accelerations

  Point operator()(Index node) const {
    if (node == 0) return {0.0, base};
    return {values[x_of(node)], values[y_of(node)]};
  }
  double angle(Index joint) const { return values[phi_of(joint)]; }
};

/// A state and the signed flow speed U = s u.
struct Motion {
  Nodes place, rate;
  double flow_speed;
};

/// Generalized forces; node 0 takes any.
struct Loads {
  double* values;

  void add(Index node, const Point& force) const {
    if (node == 0) return;
    values[x_of(node)] += force.x();
    values[y_of(node)] += force.y();
  }
  void add_moment(Index joint, double moment) const { values[phi_of(joint)] += moment; }
};

/// Entries (row, column, value) of a sparse matrix; those of one place add up.
struct Triplets {
  std::vector<std::int64_t> rows, columns;
  std::vector<double> values;

  void push(Index row, Index column, double value) {
    rows.push_back(row);
    columns.push_back(column);
    values.push_back(value);
  }
  void add(Index row, Index column, double value) {
    if (value != 0.0) push(row, column, value);
  }
  /// Of two nodes; what falls on node 0 is dropped.
  void add_block(Index row_node, Index column_node, const Block& block) {
    if (row_node == 0 || column_node == 0) return;
    for (Index i = 0; i < 2; ++i) {
      for (Index k = 0; k < 2; ++k) add(x_of(row_node) + i, x_of(column_node) + k, block(i, k));
    }
  }
  void add_uniform(Index row_node, Index column_node, double value) {
    add_block(row_node, column_node, value * Block::Identity());
  }
};

/// Second derivatives by coordinates i and k of the constraint rows: entries (row, i, k, value).
struct Hessians {
  std::vector<std::int64_t> rows;
  Triplets entries;

  void add(Index row, Index i, Index k, double value) {
    rows.push_back(row);
    entries.push(i, k, value);
  }
  void add_both(Index row, Index i, Index k, double value) {
    add(row, i, k, value);
    add(row, k, i, value);
  }
};

/// Derivatives by the coordinates and by their rates.
struct Derivatives {
  Triplets by_coordinates, by_rates;
};

/// Matrices (3 n, 3 n) that no coordinates change: of the inertia and, U = 1, of the flow.
/// Stiffness and damping about any place are the derivatives of the forces there, negated.
struct RedundantOperators {
  Triplets mass, velocity, flux;
};

/// What flow, joints, drag and the pipe's terms add to the energy in unit time.
struct Power {
  double flow = 0.0, joints = 0.0, drag = 0.0, others = 0.0;
};

}  // namespace pipedyn
