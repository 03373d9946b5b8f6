// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <vector>

namespace pipedyn {

/// A periodic orbit on a mesh of phases. On each interval accelerations are the polynomial through
/// their values at the stages; velocities and positions are its integrals. Arrays are row-major.
struct Polynomials {
  std::ptrdiff_t count, stages, half;
  const double* edges;   // phases (count + 1,), from 0
  const double* starts;  // states where intervals begin (count, 2 half)
  const double* rates;   // accelerations at the stages (count, stages, half)
  double frequency;
  double mirror;  // factor of the states after the span, 1 or -1
  // Expansions in Legendre polynomials, on an interval of length 1, of the first integral of the
  // polynomial through the stages, (stages + 1, stages), and of its second, (stages + 2, stages).
  const double* once;
  const double* twice;
};

/// Computes the states at given phases, out (2 half, size). It does not throw.
void states_at(const Polynomials& orbit, const double* phases, std::ptrdiff_t size, double* out);

/// Products of the maps x -> T x + r of intervals, given as [T | r] (count, n, columns). The
/// intervals are divided into runs; out receives for each interval the product [P | R] of all maps
/// from the beginning of its run to its own end (count, n, columns). A run ends before an entry of
/// P reaches most. Returns the beginnings of the runs.
std::vector<std::ptrdiff_t> carry_maps(const double* maps, std::ptrdiff_t count, std::ptrdiff_t n,
                                       std::ptrdiff_t columns, double most, double* out);

}  // namespace pipedyn
