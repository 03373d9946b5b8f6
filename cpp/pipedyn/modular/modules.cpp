// SPDX-License-Identifier: MIT
#include "pipedyn/modular/modules.hpp"

#include <cmath>
#include <utility>

#include "pipedyn/terms/laws.hpp"

namespace pipedyn {

namespace {

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

// ------------------------------------------------------------------------------- laws at places

Point between(const Place& place, const Nodes& nodes) {
  return (1.0 - place.point) * nodes(place.node - 1) + place.point * nodes(place.node);
}

Point along(const Place& place, const Nodes& nodes) {
  return nodes(place.node) - nodes(place.node - 1);
}

/// The direction t is that of r_j - r_{j-1}, so that laws see a unit vector at any coordinates.
Station<double> station(const Place& place, const Motion& motion) {
  const Point r = between(place, motion.place), v = between(place, motion.rate);
  const Point a = along(place, motion.place), a_rate = along(place, motion.rate);
  const double length = a.norm(), sine = a.x() / length, cosine = a.y() / length;
  const double omega = (cosine * a_rate.x() - sine * a_rate.y()) / length;
  return {r.x(), r.y(), sine, cosine, v.x(), v.y(), omega};
}

/// A force counted `weight` times, on both nodes.
void add_at(const Place& place, const Point& force, const Loads& loads) {
  loads.add(place.node - 1, (1.0 - place.point) * place.weight * force);
  loads.add(place.node, place.point * place.weight * force);
}

/// Derivatives of such a force: by position and velocity of the station, and by r_j - r_{j-1}.
void add_derivatives_at(const Place& place, const Block& by_position, const Block& by_velocity,
                        const Block& by_difference, Derivatives& out) {
  const double share[] = {1.0 - place.point, place.point};
  for (Index i = 0; i < 2; ++i) {
    for (Index k = 0; k < 2; ++k) {
      const Index row = place.node - 1 + i, column = place.node - 1 + k;
      const double part = share[i] * place.weight, sign = k == 0 ? -1.0 : 1.0;
      out.by_coordinates.add_block(row, column,
                                   part * (share[k] * by_position + sign * by_difference));
      out.by_rates.add_block(row, column, part * share[k] * by_velocity);
    }
  }
}

}  // namespace

void TermLoad::add_force(const Motion& motion, const Loads& loads) const {
  Laws::with(term, [&](const auto& law) {
    const Load<double> load = law.load(station(place, motion));
    add_at(place, {load.x, load.y}, loads);
  });
}

void TermLoad::add_derivatives(const Motion& motion, Derivatives& out) const {
  using Rows = Eigen::Matrix<double, 2, 2, Eigen::RowMajor>;
  const Station<double> at = station(place, motion);
  const Point turning = Point(at.cosine, -at.sine) / along(place, motion.place).norm();
  Laws::with(term, [&](const auto& law) {
    const Slopes slopes = law.slopes(at);
    add_derivatives_at(place, Rows(&slopes.by_position[0][0]), Rows(&slopes.by_velocity[0][0]),
                       Point(slopes.by_angle) * turning.transpose(), out);
  });
}

double TermLoad::energy(const Motion& motion) const {
  double sum = 0.0;
  Laws::with(term, [&](const auto& law) { sum = law.energy(station(place, motion)); });
  return place.weight * sum;
}

void TermLoad::add_power(const Motion& motion, Power& out) const {
  Laws::with(term, [&](const auto& law) {
    out.others += place.weight * law.power(station(place, motion));
  });
}

void Drag::add_force(const Motion& motion, const Loads& loads) const {
  const Point n = normal(motion);
  const double v = n.dot(between(place, motion.rate));
  add_at(place, -coefficient * std::abs(v) * v * n, loads);
}

void Drag::add_derivatives(const Motion& motion, Derivatives& out) const {
  const Point n = normal(motion), w = between(place, motion.rate);
  const double v = n.dot(w), size = coefficient * std::abs(v);
  const Block turn{{0.0, 1.0}, {-1.0, 0.0}};  // n = turn t, d v = w^T turn d t
  const Block by_velocity = -2.0 * size * n * n.transpose();
  const Block by_tangent = -size * (2.0 * n * (w.transpose() * turn) + v * turn);
  add_derivatives_at(place, Block::Zero(), by_velocity, by_tangent / place.weight, out);
}

void Drag::add_power(const Motion& motion, Power& out) const {
  const double v = normal(motion).dot(between(place, motion.rate));
  out.drag -= place.weight * coefficient * std::abs(v) * v * v;
}

Point Drag::normal(const Motion& motion) const {
  return turned(along(place, motion.place) / place.weight);
}

// --------------------------------------------------------------------------------------- bodies

void Body::add_inertia(std::vector<InertiaRow>& rows) const {
  const double root = std::sqrt(mass);
  add_rows(rows, node, root * (1.0 - center), root * center);
  if (turning != 0.0) add_rows(rows, node, -root * turning, root * turning);
}

// ----------------------------------------------------------------------------------------- flow

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

void InternalFlow::add_power(const Motion& motion, Power& out) const {
  const double u = motion.flow_speed;
  const Point end = motion.rate(segments);
  const Point tangent = (motion.place(segments) - motion.place(segments - 1)) / last_length;
  out.flow -= sqrt_beta * u * end.squaredNorm() + centrifugal * u * u * tangent.dot(end);
}

}  // namespace pipedyn
