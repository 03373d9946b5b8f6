// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>

namespace pipedyn {

/// A periodic orbit as polynomials on the intervals of a mesh of phases: accelerations through the
/// values at the stages, velocities and positions their integrals. Arrays are row-major.
struct Polynomials {
  std::ptrdiff_t count, stages, half;
  const double* edges;   // phases (count + 1,), from 0
  const double* starts;  // states where intervals begin (count, 2 half)
  const double* rates;   // accelerations at the stages (count, stages, half)
  double frequency;
  double mirror;  // of the states after the span, 1 or -1
  // Coefficients in Legendre's polynomials over an interval of length 1 of the integrals from its
  // beginning of a value at each stage, (stages + 1, stages), and of the integrals of these,
  // (stages + 2, stages).
  const double* once;
  const double* twice;
};

/// States at phases, out (2 half, size). Throws nothing.
void states_at(const Polynomials& orbit, const double* phases, std::ptrdiff_t size, double* out);

}  // namespace pipedyn
