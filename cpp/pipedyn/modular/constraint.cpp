// SPDX-License-Identifier: MIT
#include "pipedyn/modular/constraint.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

namespace pipedyn {

namespace {

void require_node(const char* what, Index node, Index least, Index most) {
  if (node < least || node > most) {
    throw std::invalid_argument(std::string(what) + " must lie in " + std::to_string(least) + ".." +
                                std::to_string(most) + ", got " + std::to_string(node));
  }
}

/// Calls put(i, derivative of a . d, derivative of cross(a, d)) for node j - i, i = 0, 1, 2, with
/// a = r_j - r_{j-1} and d = r_{j-1} - r_{j-2}, over l_{j-1} both.
template <class Put>
void by_nodes(const Point& a, const Point& d, const Put& put) {
  const Point across = turned(d), back = turned_back(a);
  put(0, d, across);
  put(1, a - d, back - across);
  put(2, -a, -back);
}

}  // namespace

void Constraint::check(Index segments) const {
  switch (kind) {
    case Kind::clamp:
      return require_node("a clamp's constraint_node", node, 1, 1);
    case Kind::joint:
      return require_node("a joint's constraint_node", node, 2, segments);
    case Kind::guide:
    case Kind::pin:
      return require_node("constraint_node", node, 1, segments);
  }
  throw std::invalid_argument("constraint_kind must lie in 0..3, got " +
                              std::to_string(static_cast<std::int64_t>(kind)));
}

std::vector<int> Constraint::coordinates() const {
  std::vector<int> made;
  const auto add = [&made](Index coordinate) { made.push_back(static_cast<int>(coordinate)); };
  const bool between = kind == Kind::clamp || kind == Kind::joint;
  for (Index j = between ? std::max<Index>(1, node - 2) : node; j <= node; ++j) {
    add(x_of(j));
    if (kind != Kind::guide) add(y_of(j));
  }
  if (between) add(phi_of(node));
  return made;
}

void Constraint::fill(const Nodes& place, const Nodes& rate, const Vector& length, double* residual,
                      double* matrix, double* right_side) const {
  if (kind == Kind::guide) {
    residual[0] = place(node).x();
    matrix[0] = 1.0;
    right_side[0] = 0.0;
    return;
  }
  if (kind == Kind::pin) {
    const Point missing = place(node) - Point(x, y);
    for (Index i = 0; i < 2; ++i) {
      residual[i] = missing[i];
      matrix[2 * i + i] = 1.0;
      matrix[2 * i + 1 - i] = 0.0;
      right_side[i] = 0.0;
    }
    return;
  }
  const double l = length[node - 1], phi = place.angle(node), turning = rate.angle(node);
  const double sine = l * std::sin(phi), cosine = l * std::cos(phi);
  const bool clamp = kind == Kind::clamp;
  const Point a = place(node) - place(node - 1), a_rate = rate(node) - rate(node - 1);
  Point d(0.0, 1.0), d_rate(0.0, 0.0), a_share(0.0, 0.0);  // each over l_{j-1}
  if (!clamp) {
    const double before = length[node - 2];
    d = (place(node - 1) - place(node - 2)) / before;
    d_rate = (rate(node - 1) - rate(node - 2)) / before;
    a_share = a / before;
  }
  residual[0] = a.dot(d) - cosine;
  residual[1] = cross(a, d) - sine;
  right_side[0] = -2.0 * a_rate.dot(d_rate) - cosine * turning * turning;
  right_side[1] = -2.0 * cross(a_rate, d_rate) - sine * turning * turning;
  const Index nodes = std::min<Index>(node, clamp ? 1 : 3);
  double* const first = matrix;
  double* const second = matrix + 2 * nodes + 1;
  by_nodes(a_share, d, [&](Index from_last, const Point& of_dot, const Point& of_cross) {
    if (from_last >= nodes) return;
    for (Index i = 0; i < 2; ++i) {
      first[2 * (nodes - 1 - from_last) + i] = of_dot[i];
      second[2 * (nodes - 1 - from_last) + i] = of_cross[i];
    }
  });
  first[2 * nodes] = sine;
  second[2 * nodes] = -cosine;
}

void Constraint::add_curvature(const Nodes& place, const Vector& length, const double* multipliers,
                               Triplets& out) const {
  if (kind != Kind::clamp && kind != Kind::joint) return;
  const double l = length[node - 1], phi = place.angle(node);
  out.add(phi_of(node), phi_of(node),
          l * (multipliers[0] * std::cos(phi) + multipliers[1] * std::sin(phi)));
  if (kind == Kind::clamp) return;
  // a^T block d
  const double dot = multipliers[0] / length[node - 2], turn = multipliers[1] / length[node - 2];
  const Block block{{dot, turn}, {-turn, dot}};
  for (Index of_a = 0; of_a < 2; ++of_a) {
    for (Index of_d = 0; of_d < 2; ++of_d) {
      const Block share = of_a == of_d ? block : Block(-block);
      out.add_block(node - of_a, node - 1 - of_d, share);
      out.add_block(node - 1 - of_d, node - of_a, share.transpose());
    }
  }
}

void Constraint::add_derivatives(const Nodes& place, const Nodes& rate, const Nodes& acceleration,
                                 const Vector& length, Index row, Derivatives& out) const {
  if (kind != Kind::clamp && kind != Kind::joint) return;
  const double l = length[node - 1], phi = place.angle(node), turning = rate.angle(node);
  const double sine = l * std::sin(phi), cosine = l * std::cos(phi);
  const double faster = acceleration.angle(node);
  out.by_coordinates.add(row, phi_of(node), cosine * faster - sine * turning * turning);
  out.by_coordinates.add(row + 1, phi_of(node), sine * faster + cosine * turning * turning);
  out.by_rates.add(row, phi_of(node), 2.0 * cosine * turning);
  out.by_rates.add(row + 1, phi_of(node), 2.0 * sine * turning);
  if (kind == Kind::clamp) return;
  // of (a'' . d + a . d'' + 2 a' . d') / l_{j-1} and its like with cross
  const auto add = [&](Triplets& to, const Nodes& change, double factor) {
    const Point a = factor * (change(node) - change(node - 1));
    const Point d = factor * (change(node - 1) - change(node - 2));
    by_nodes(a, d, [&](Index from_last, const Point& of_dot, const Point& of_cross) {
      const Index at = node - from_last;
      if (at == 0) return;
      for (Index i = 0; i < 2; ++i) {
        to.add(row, x_of(at) + i, of_dot[i]);
        to.add(row + 1, x_of(at) + i, of_cross[i]);
      }
    });
  };
  add(out.by_coordinates, acceleration, 1.0 / length[node - 2]);
  add(out.by_rates, rate, 2.0 / length[node - 2]);
}

}  // namespace pipedyn
