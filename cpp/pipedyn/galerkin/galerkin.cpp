// SPDX-License-Identifier: MIT
#include "pipedyn/galerkin/galerkin.hpp"

#include <stdexcept>
#include <utility>

#include "pipedyn/products.hpp"

namespace pipedyn {

Galerkin::Galerkin(const Pipe& pipe, Basis basis, Vector nodes, Vector weights, Fittings fittings)
    : pipe_(pipe),
      basis_(std::move(basis)),
      nodes_(std::move(nodes)),
      weights_(std::move(weights)),
      fittings_(std::move(fittings)) {
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
  if (pipe_.gamma != 0.0) {
    Eigen::ArrayXd beyond = 1.0 - nodes_.array();  // mass below each node
    for (const Fitting& fitting : fittings_) {
      beyond += fitting.mass * (nodes_.array() < fitting.at).cast<double>();
    }
    const Vector tension = pipe_.gamma * weights_.array() * beyond;
    ops.stiffness = inner(slope, tension, slope);
  }
  ops.stiffness.diagonal() += elastic;
  if (!fittings_.empty()) {
    const Index count = static_cast<Index>(fittings_.size());
    Vector at(count), mass(count), stiffness(count);
    for (Index f = 0; f < count; ++f) {
      const Fitting& fitting = fittings_[static_cast<std::size_t>(f)];
      at[f] = fitting.at;
      mass[f] = fitting.mass;
      stiffness[f] = fitting.stiffness;
    }
    const Matrix there = basis_.evaluate(at, 0);
    ops.mass += inner(there, mass, there);
    ops.stiffness += inner(there, stiffness, there);
  }
  return ops;
}

}  // namespace pipedyn
