// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <cmath>

#include "pipedyn/terms/term.hpp"

namespace pipedyn {

using Index = Eigen::Index;
using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
using Vector = Eigen::VectorXd;

/// The nondimensional numbers a pipe is; length, mass per length and bending stiffness are 1.
struct Pipe {
  double beta = 0.0;         // fluid's share of the mass, 0 <= beta < 1
  double gamma = 0.0;        // gravity, negative with the free end above the clamp
  double centrifugal = 1.0;  // a: factor of u^2 in the centrifugal term
  double drag = 0.0;         // kappa, quadratic drag
  double damping = 0.0;      // delta, Kelvin-Voigt damping
  bool aspirating = false;   // flow enters at the free end
  Terms terms{};             // what else acts on the pipe

  double sqrt_beta() const { return std::sqrt(beta); }
  /// s: U = s u is the flow speed counted towards the free end.
  double direction() const { return aspirating ? -1.0 : 1.0; }
};

/// Linear operators about the straight pipe at rest, each (dof, dof):
///   mass q'' + (s u (gyroscopic + end_flux) + damping) q'
///     + (stiffness + a u^2 flux + s u' unsteady) q = 0.
/// gyroscopic is skew, end_flux symmetric of rank one; with unsteady they carry sqrt(beta).
struct Operators {
  Matrix mass, gyroscopic, end_flux, damping, stiffness, flux, unsteady;

  explicit Operators(Index dof)
      : mass(Matrix::Zero(dof, dof)),
        gyroscopic(Matrix::Zero(dof, dof)),
        end_flux(Matrix::Zero(dof, dof)),
        damping(Matrix::Zero(dof, dof)),
        stiffness(Matrix::Zero(dof, dof)),
        flux(Matrix::Zero(dof, dof)),
        unsteady(Matrix::Zero(dof, dof)) {}
};

}  // namespace pipedyn
