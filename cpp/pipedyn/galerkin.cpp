// SPDX-License-Identifier: MIT
#include "pipedyn/galerkin.hpp"

#include <stdexcept>
#include <utility>

namespace pipedyn {

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
    ops.mass = value.transpose() * weights_.asDiagonal() * value;
  }
  const Matrix coriolis = value.transpose() * weights_.asDiagonal() * slope;
  ops.gyroscopic = pipe_.sqrt_beta() * (coriolis - coriolis.transpose());
  ops.end_flux = pipe_.sqrt_beta() * end_value.transpose() * end_value;
  ops.damping.diagonal() = pipe_.damping * elastic;
  ops.flux = end_value.transpose() * end_slope - slope.transpose() * weights_.asDiagonal() * slope;
  if (pipe_.gamma != 0.0) {
    const Vector tension = pipe_.gamma * weights_.array() * (1.0 - nodes_.array());
    ops.stiffness = slope.transpose() * tension.asDiagonal() * slope;
  }
  ops.stiffness.diagonal() += elastic;
  return ops;
}

}  // namespace pipedyn
