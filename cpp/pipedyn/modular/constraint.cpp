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

/// A segment and the direction of the one before, or rates of both.
struct Pair {
  Point a, d;

  Pair(const Nodes& nodes, Index j, const Vector& length, const Point& fixed)
      : a(nodes(j) - nodes(j - 1)), d(fixed) {
    if (j > 1) d = (nodes(j - 1) - nodes(j - 2)) / length[j - 2];
  }
};

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
  if (kind == Kind::guide || kind == Kind::pin) {
    const Point missing = place(node) - Point(x, y);
    for (Index i = 0; i < rows(); ++i) {
      residual[i] = missing[i];
      right_side[i] = 0.0;
      for (Index k = 0; k < rows(); ++k) matrix[rows() * i + k] = i == k ? 1.0 : 0.0;
    }
    return;
  }
  const double l = length[node - 1], phi = place.angle(node), turning = rate.angle(node);
  const double sine = l * std::sin(phi), cosine = l * std::cos(phi);
  const Pair at(place, node, length, {0.0, 1.0}), moves(rate, node, length, {0.0, 0.0});
  residual[0] = at.a.dot(at.d) - cosine;
  residual[1] = cross(at.a, at.d) - sine;
  right_side[0] = -2.0 * moves.a.dot(moves.d) - cosine * turning * turning;
  right_side[1] = -2.0 * cross(moves.a, moves.d) - sine * turning * turning;
  // Rows by the nodes j, j - 1 and j - 2, as far as they move: the last comes last.
  const Point share = node > 1 ? Point(at.a / length[node - 2]) : Point(0.0, 0.0);
  const Point of_dot[] = {at.d, share - at.d, -share};
  const Point of_cross[] = {turned(at.d), turned_back(share) - turned(at.d), -turned_back(share)};
  const Index nodes = std::min<Index>(node, 3);
  double* const second = matrix + 2 * nodes + 1;
  for (Index back = 0; back < nodes; ++back) {
    for (Index i = 0; i < 2; ++i) {
      matrix[2 * (nodes - 1 - back) + i] = of_dot[back][i];
      second[2 * (nodes - 1 - back) + i] = of_cross[back][i];
    }
  }
  matrix[2 * nodes] = sine;
  second[2 * nodes] = -cosine;
}

void Constraint::add_hessians(const Nodes& place, const Vector& length, Index row,
                              Hessians& out) const {
  if (kind == Kind::guide || kind == Kind::pin) return;
  const double l = length[node - 1], phi = place.angle(node);
  out.add(row, phi_of(node), phi_of(node), l * std::cos(phi));
  out.add(row + 1, phi_of(node), phi_of(node), l * std::sin(phi));
  // a . d and cross(a, d) by node j or j - 1 in a, and j - 1 or j - 2 in d; r_0 stays.
  for (Index of_a = 0; of_a < 2; ++of_a) {
    for (Index of_d = 0; of_d < 2 && node - 1 - of_d > 0; ++of_d) {
      const Index a = node - of_a, d = node - 1 - of_d;
      const double value = (of_a == of_d ? 1.0 : -1.0) / length[node - 2];
      out.add_both(row, x_of(a), x_of(d), value);
      out.add_both(row, y_of(a), y_of(d), value);
      out.add_both(row + 1, x_of(a), y_of(d), value);
      out.add_both(row + 1, y_of(a), x_of(d), -value);
    }
  }
}

}  // namespace pipedyn
