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

/// The terms' shares, at their places or, in their weights, at all the nodes given.
std::vector<Share> shares_of(const Terms& terms, const Vector& nodes, const Vector& weights) {
  std::vector<Share> shares;
  for (const Term& term : terms) {
    Laws::with(term, [&]<class Law>(const Law& law) {
      const auto share = [&](double s, double weight) {
        const Station<double> straight{0.0, s, 0.0, 1.0, 0.0, 0.0, 0.0};
        const Slopes slopes = law.slopes(straight);
        shares.push_back({s, weight * law.mass(), weight * law.load(straight).y,
                          weight * slopes.by_position[0][0], weight * slopes.by_angle[0],
                          weight * slopes.by_velocity[0][0]});
      };
      if (!Law::along) share(term.at, 1.0);
      for (Index p = 0; Law::along && p < nodes.size(); ++p) share(nodes[p], weights[p]);
    });
  }
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

void add_flow_and_bending(const Pipe& pipe, const Matrix& coriolis, const End& end,
                          const Vector& elastic, Operators& ops) {
  const double sqrt_beta = pipe.sqrt_beta();
  for (Index i = 0; i < elastic.size(); ++i) {
    for (Index j = 0; j < elastic.size(); ++j) {
      ops.gyroscopic(i, j) = sqrt_beta * (coriolis(i, j) - coriolis(j, i));
      ops.end_flux(i, j) = sqrt_beta * (end.x[i] * end.x[j] + end.y[i] * end.y[j]);
      ops.flux(i, j) += end.across[i] * end.slope[j];
    }
    ops.damping(i, i) += pipe.damping * elastic[i];
    ops.stiffness(i, i) += elastic[i];
  }
}

Operators Galerkin::operators() const {
  Operators ops(dof());
  const Matrix value = basis_.evaluate(nodes_, 0), slope = basis_.evaluate(nodes_, 1);
  if (basis_.family() == Family::beam) {
    ops.mass.setIdentity();  // the modes are orthogonal
  } else {
    ops.mass = inner(value, weights_, value);
  }
  ops.flux = inner(slope, -weights_, slope);
  if (pipe_.gamma != 0.0 || !pipe_.terms.empty()) {
    const Quadrature rule(load_nodes);
    Vector tension(nodes_.size());
    for (Index p = 0; p < nodes_.size(); ++p) {
      tension[p] = pipe_.gamma * weights_[p] * (1.0 - nodes_[p]);
      if (!pipe_.terms.empty()) tension[p] += weights_[p] * hanging(pipe_, rule, nodes_[p]);
    }
    ops.stiffness = inner(slope, tension, slope);
  }
  const Vector one = Vector::Ones(1), nothing = Vector::Zero(dof());
  const Matrix end = basis_.evaluate(one, 0), end_slope = basis_.evaluate(one, 1);
  add_flow_and_bending(pipe_, inner(value, weights_, slope),
                       {end.data(), nothing.data(), end.data(), end_slope.data()},
                       basis_.stiffness(), ops);
  const std::vector<Share> shares = shares_of(pipe_.terms, nodes_, weights_);
  if (shares.empty()) return ops;
  const auto all = [&shares](double Share::* part) {
    Vector parts(static_cast<Index>(shares.size()));
    for (Index k = 0; k < parts.size(); ++k) parts[k] = shares[static_cast<std::size_t>(k)].*part;
    return parts;
  };
  const Vector at = all(&Share::at);
  const Matrix there = basis_.evaluate(at, 0);
  ops.mass += inner(there, all(&Share::mass), there);
  Matrix stiffness = inner(there, all(&Share::by_x), there);
  stiffness += inner(there, all(&Share::by_angle), basis_.evaluate(at, 1));
  ops.stiffness -= stiffness;
  ops.damping -= inner(there, all(&Share::by_velocity), there);
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
