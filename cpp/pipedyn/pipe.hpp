// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "pipedyn/profile.hpp"
#include "pipedyn/terms/term.hpp"

namespace pipedyn {

using Index = Eigen::Index;
using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
using Vector = Eigen::VectorXd;

/// How the pipe is held at s = 1: not at all; in direction, free to slide across; on the axis
/// (x = 0), free to turn; both. It slides along the axis in each case.
enum class End { free, guided, pinned, clamped };

/// The nondimensional numbers a pipe is; its length and, at the clamp, mass per length and bending
/// stiffness are 1.
struct Pipe {
  double beta = 0.0;         // fluid's share of the mass, 0 <= beta < 1
  double gamma = 0.0;        // gravity, negative with the free end above the clamp
  double centrifugal = 1.0;  // a: factor of u^2 in the centrifugal term
  double drag = 0.0;         // kappa, quadratic drag
  double damping = 0.0;      // delta, Kelvin-Voigt damping
  bool aspirating = false;   // flow enters at the free end
  // c: share of the free end's velocity that the inflow has before it enters
  double inflow_share = 1.0;
  double jet_angle = 0.0;  // psi, from the free end's tangent to the thrust's direction
  Terms terms{};           // what else acts on the pipe
  double root =
      std::numeric_limits<double>::infinity();  // k_r, rotational spring at s = 0; 0: hinge
  End end = End::free;
  std::vector<double> supports{};  // arc lengths of rigid inner supports (x = 0), ascending
  Profile stiffness{};             // e, bending stiffness along the pipe, of reduced models
  Profile mass{};                  // m, mass per length, with the fluid's beta, of reduced models
  double hysteresis = 0.0;         // mu, loss factor; of linear questions alone
  double rotary_inertia = 0.0;     // J, of cross-sections by length

  double sqrt_beta() const { return std::sqrt(beta); }
  /// Whether the end keeps the direction of the axis.
  bool is_guided() const { return end == End::guided || end == End::clamped; }
  /// s: U = s u is the flow speed counted towards the free end.
  double direction() const { return aspirating ? -1.0 : 1.0; }
  /// Thrust of the flow by u^2, along and across the free end.
  std::array<double, 2> thrust() const {
    if (jet_angle == 0.0) return {centrifugal, 0.0};  // asked at each rate of a motion
    return {centrifugal * std::cos(jet_angle), centrifugal * std::sin(jet_angle)};
  }
  /// By which u v of the free end's velocity v loads it: the entering flow's change of velocity.
  double entry() const { return (1.0 - inflow_share) * direction() * sqrt_beta(); }
};

/// The numbers of a pipe as Python gives them, in the order of OWN_NUMBERS in models/pipe.py.
inline constexpr std::array own_numbers{
    &Pipe::beta,         &Pipe::gamma,     &Pipe::centrifugal,
    &Pipe::drag,         &Pipe::damping,   &Pipe::hysteresis,
    &Pipe::inflow_share, &Pipe::jet_angle, &Pipe::rotary_inertia};

/// Linear operators about the straight pipe at rest, each (dof, dof):
///   mass q'' + (s u (gyroscopic + end_flux) + damping) q'
///     + (stiffness + a u^2 flux + s u' unsteady) q = 0.
/// gyroscopic is skew, end_flux symmetric of rank one; with unsteady they carry sqrt(beta),
/// end_flux also c.
struct Operators {
  Matrix mass, gyroscopic, end_flux, damping, stiffness, flux, unsteady;

  explicit Operators(Index dof) {
    for (Matrix* const of :
         {&mass, &gyroscopic, &end_flux, &damping, &stiffness, &flux, &unsteady}) {
      of->setZero(dof, dof);
    }
  }
};

/// What multiplies the parts of the straight pipe's linear problem: stiffness, damping and inertia,
/// s (gyroscopic + end_flux) and flux of `Operators`, the derivatives of the stiffness by gamma and
/// of the damping by delta, and, of chains alone, s unsteady.
struct LinearPart {
  double still = 0.0, rate = 0.0, square = 0.0, velocity = 0.0, flux = 0.0, gravity = 0.0;
  double by_damping = 0.0, unsteady = 0.0;
};

/// What decides whether motions x grow: x^H M x, Im x^H C x, Re x^H C x and Im x^H K x of each, and
/// how far rounding may move omega Re x^H C x + Im x^H K x of its frequency omega.
struct Works {
  Eigen::ArrayXd mass, gyroscopic, resisted, circulated, lost;

  explicit Works(Index count) {
    for (Eigen::ArrayXd* const of : {&mass, &gyroscopic, &resisted, &circulated, &lost}) {
      of->setZero(count);
    }
  }
};

}  // namespace pipedyn
