// SPDX-License-Identifier: MIT
//
// The nondimensional numbers of a pipe, and the matrices and quadratic forms of its linear problem.
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

/// How the pipe is held at its end s = 1. free: not at all; guided: its direction is held, and it
/// slides across the axis; pinned: it is held on the axis (x = 0), and turns; clamped: both are
/// held. In each case the end slides along the axis.
enum class End { free, guided, pinned, clamped };

/// The nondimensional numbers of a pipe. Its length is 1, and so are its mass per length and its
/// bending stiffness at the clamp.
struct Pipe {
  double beta = 0.0;             // fluid's share of the mass, 0 <= beta < 1
  double gamma = 0.0;            // gravity, negative with the free end above the clamp
  double end_coefficient = 1.0;  // a: factor of u^2 in the centrifugal term
  double drag = 0.0;             // kappa, quadratic drag
  double damping = 0.0;          // delta, Kelvin-Voigt damping
  bool aspirating = false;       // whether the flow enters at the free end
  // c: share of the free end's velocity that the inflow has before it enters
  double inflow_share = 1.0;
  double jet_angle = 0.0;  // psi, from the free end's tangent to the thrust's direction
  Terms terms{};           // further forces and masses on the pipe
  double root =
      std::numeric_limits<double>::infinity();  // k_r, rotational spring at s = 0; 0: hinge
  double root_across = 0.0;  // in space, what that spring has more for rotation across z = 0
  End end = End::free;
  std::vector<double> supports{};  // arc lengths of rigid inner supports (x = 0), ascending
  // Bending stiffness e and mass per length m along the pipe, the fluid's share beta included; only
  // reduced models read them.
  Profile stiffness{};
  Profile mass{};
  double hysteresis = 0.0;      // mu, loss factor; acts in linear problems alone
  double rotary_inertia = 0.0;  // J, rotary inertia of the cross-sections per length
  double inclination = 0.0;     // iota, from the downward vertical to the clamp's axis

  double sqrt_beta() const { return std::sqrt(beta); }
  /// Whether the end keeps the direction of the axis.
  bool end_guided() const { return end == End::guided || end == End::clamped; }
  /// Whether the end is held on the axis of the straight pipe.
  bool end_held() const { return end == End::pinned || end == End::clamped; }
  /// The sign s of the flow: U = s u is the flow speed, positive towards the free end.
  double direction() const { return aspirating ? -1.0 : 1.0; }
  /// Thrust of the flow divided by u^2: its components along and across the free end.
  std::array<double, 2> thrust() const {
    if (jet_angle == 0.0) return {end_coefficient, 0.0};  // saves time in each evaluation of rates
    return {end_coefficient * std::cos(jet_angle), end_coefficient * std::sin(jet_angle)};
  }
  /// The direction of gravity: its components across and along the clamp's axis. Those of a pipe
  /// that is exactly level, hanging or standing are exact.
  std::array<double, 2> down() const {
    if (inclination == 0.0) return {0.0, 1.0};
    const auto clean = [](double x) { return std::abs(x) < 1e-15 ? 0.0 : x; };
    return {clean(std::sin(inclination)), clean(std::cos(inclination))};
  }
  /// Factor of u v, v the free end's velocity, in the force with which entering fluid, as it
  /// changes velocity, acts on the free end.
  double entry() const { return (1.0 - inflow_share) * direction() * sqrt_beta(); }
};

/// Throws std::invalid_argument for a pipe whose equations in three dimensions are not known here:
/// with a term that exists only in a plane.
void require_space(const Pipe& pipe);

/// The numbers of a pipe as Python gives them, in the order of OWN_NUMBERS in models/pipe.py.
inline constexpr std::array own_numbers{
    &Pipe::beta,           &Pipe::gamma,      &Pipe::end_coefficient, &Pipe::drag,
    &Pipe::damping,        &Pipe::hysteresis, &Pipe::inflow_share,    &Pipe::jet_angle,
    &Pipe::rotary_inertia, &Pipe::inclination};

/// Linear operators about the straight pipe at rest, each (dof, dof). The linear equation is
///   mass q'' + (s u (gyroscopic + end_flux) + damping) q'
///     + (stiffness + a u^2 flux + s u' unsteady) q = 0.
/// gyroscopic is skew-symmetric; end_flux is symmetric and has rank one. gyroscopic, end_flux and
/// unsteady contain the factor sqrt(beta), and end_flux the factor c as well.
struct Operators {
  Matrix mass, gyroscopic, end_flux, damping, stiffness, flux, unsteady;

  explicit Operators(Index dof) {
    for (Matrix* const of :
         {&mass, &gyroscopic, &end_flux, &damping, &stiffness, &flux, &unsteady}) {
      of->setZero(dof, dof);
    }
  }
};

/// Factors of the matrices whose sum is part of the straight pipe's linear problem.
///   stiffness, damping, mass, flux: factors of the matrices of these names in `Operators`
///   velocity: factor of s (gyroscopic + end_flux)
///   gravity: factor of the derivative of the stiffness by gamma
///   by_damping: factor of the derivative of the damping by delta
///   unsteady: factor of s unsteady, which only chains read
struct LinearPart {
  double stiffness = 0.0, damping = 0.0, mass = 0.0, velocity = 0.0, flux = 0.0, gravity = 0.0;
  double by_damping = 0.0, unsteady = 0.0;
};

/// The forms of Rayleigh's quotients that decide whether motions x grow, one entry a motion.
///   mass: x^H M x
///   gyroscopic: Im x^H C x
///   dissipative: Re x^H C x
///   circulatory: Im x^H K x
///   error: largest error that rounding may cause in omega dissipative + circulatory, with omega
///     the frequency of the motion
struct Rayleigh {
  Eigen::ArrayXd mass, gyroscopic, dissipative, circulatory, error;

  /// Takes room for some motions, unless it is there.
  void reserve(Index count) {
    for (auto* const one : {&mass, &gyroscopic, &dissipative, &circulatory, &error}) {
      if (one->size() < count) one->resize(count);
    }
  }
};

}  // namespace pipedyn
