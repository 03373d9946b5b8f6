// SPDX-License-Identifier: MIT
#include "pipedyn/galerkin/galerkin.hpp"

#include <stdexcept>
#include <utility>
#include <vector>

#include "pipedyn/galerkin/quadrature.hpp"
#include "pipedyn/products.hpp"
#include "pipedyn/terms/laws.hpp"

namespace pipedyn {

namespace {

/// Nodes of the integral of a load over what is beyond a place: laws are smooth all along.
constexpr Index load_nodes = 20;

/// What a term adds at a place of the straight pipe at rest; pull is its load along the pipe.
struct Share {
  double at, mass, pull, by_x, by_angle, by_velocity;
};

/// Adds the term's shares at its place or, in their weights, at all the nodes given.
void add_shares(const Term& term, const Vector& nodes, const Vector& weights,
                std::vector<Share>& shares) {
  Laws::with(term, [&]<class Law>(const Law& law) {
    const auto share = [&](double s, double weight) {
      const Station<double> straight{0.0, s, 0.0, 1.0, 0.0, 0.0, 0.0};
      const Slopes slopes = law.slopes(straight);
      shares.push_back({s, weight * law.mass(), weight * law.load(straight).y,
                        weight * slopes.by_position[0][0], weight * slopes.by_angle[0],
                        weight * slopes.by_velocity[0][0]});
    };
    if (!Law::along) {
      share(term.at, 1.0);
    } else {
      for (Index p = 0; p < nodes.size(); ++p) share(nodes[p], weights[p]);
    }
  });
}

std::vector<Share> shares_of(const Terms& terms, const Vector& nodes, const Vector& weights) {
  std::vector<Share> shares;
  for (const Term& term : terms) add_shares(term, nodes, weights, shares);
  return shares;
}

/// What terms beyond a place pull there, their weight with it.
double hanging(const Pipe& pipe, const Quadrature& rule, double s) {
  double pull = 0.0;
  const Vector nodes = s + (1.0 - s) * rule.node.array(), weights = (1.0 - s) * rule.weight;
  for (const Share& share : shares_of(pipe.terms, nodes, weights)) {
    if (share.at > s) pull += pipe.gamma * share.mass + share.pull;
  }
  return pull;
}

}  // namespace

Galerkin::Galerkin(const Pipe& pipe, Basis basis, Vector nodes, Vector weights)
    : pipe_(pipe),
      basis_(std::move(basis)),
      nodes_(std::move(nodes)),
      weights_(std::move(weights)) {
  if (nodes_.size() != weights_.size()) {
    throw std::invalid_argument("quadrature must have as many weights as nodes");
  }
}

Operators Galerkin::operators() const {
  Operators ops(dof());
  const Matrix value = basis_.evaluate(nodes_, 0);
  const Matrix slope = basis_.evaluate(nodes_, 1);
  const Vector end = Vector::Ones(1);
  const Matrix end_value = basis_.evaluate(end, 0);
  const Matrix end_slope = basis_.evaluate(end, 1);
  const Vector elastic = basis_.stiffness();

  if (basis_.family() == Family::beam) {
    ops.mass.setIdentity();  // the modes are orthogonal
  } else {
    ops.mass = inner(value, weights_, value);
  }
  const Matrix coriolis = inner(value, weights_, slope);
  ops.gyroscopic = pipe_.sqrt_beta() * (coriolis - coriolis.transpose());
  ops.end_flux = pipe_.sqrt_beta() * end_value.transpose() * end_value;
  ops.damping.diagonal() = pipe_.damping * elastic;
  ops.flux = end_value.transpose() * end_slope - inner(slope, weights_, slope);
  if (pipe_.gamma != 0.0 || !pipe_.terms.empty()) {
    Vector tension = pipe_.gamma * weights_.array() * (1.0 - nodes_.array());
    if (!pipe_.terms.empty()) {
      const Quadrature rule(load_nodes);
      for (Index p = 0; p < nodes_.size(); ++p)
        tension[p] += weights_[p] * hanging(pipe_, rule, nodes_[p]);
    }
    ops.stiffness = inner(slope, tension, slope);
  }
  ops.stiffness.diagonal() += elastic;
  const std::vector<Share> shares = shares_of(pipe_.terms, nodes_, weights_);
  if (shares.empty()) return ops;
  const Index count = static_cast<Index>(shares.size());
  Vector at(count), mass(count), by_x(count), by_angle(count), by_velocity(count);
  for (Index k = 0; k < count; ++k) {
    const Share& share = shares[static_cast<std::size_t>(k)];
    at[k] = share.at;
    mass[k] = share.mass;
    by_x[k] = share.by_x;
    by_angle[k] = share.by_angle;
    by_velocity[k] = share.by_velocity;
  }
  const Matrix there = basis_.evaluate(at, 0);
  ops.mass += inner(there, mass, there);
  ops.stiffness -= inner(there, by_x, there) + inner(there, by_angle, basis_.evaluate(at, 1));
  ops.damping -= inner(there, by_velocity, there);
  return ops;
}

double Galerkin::term_stiffness() const {
  double bound = 0.0;
  for (const Share& share : shares_of(pipe_.terms, nodes_, weights_)) {
    const double s = share.at, weight = std::abs(pipe_.gamma) * share.mass + std::abs(share.pull);
    bound += std::abs(share.by_x) * s * s * s / 3.0 + std::abs(share.by_angle) * s * s +
             0.5 * weight * s * s;
  }
  return bound;
}

}  // namespace pipedyn
