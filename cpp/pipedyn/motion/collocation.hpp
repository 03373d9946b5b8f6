// SPDX-License-Identifier: MIT
//
// Linearised collocation of a periodic orbit: it eliminates the stages of each interval and joins
// the intervals. An interval of length h that begins at the state (p, v) has accelerations k_i at
// its stages c_i,
//
//   p_i = p + h c_i v + h^2 sum_j T_ij k_j,   v_i = v + h sum_j O_ij k_j,   k_i = f(p_i, v_i),
//
// and their changes dk solve (1 - h O (x) f_v - h^2 T (x) f_p) dk = b, where the right-hand sides b
// are the effects of the first state, of the residual, of the frequency (h ~ 1 / frequency) and of
// the speed.
#pragma once

#include <vector>

#include "pipedyn/pipe.hpp"

namespace pipedyn {

using GivenMatrix = Eigen::Map<const Matrix>;

/// A periodic orbit on a mesh of phases. On each interval accelerations are the polynomial through
/// their values at the stages; velocities and positions are its integrals.
struct Polynomials {
  GivenMatrix edges;   // phases, from 0 (count + 1, 1)
  GivenMatrix starts;  // states where intervals begin (count, 2 half)
  GivenMatrix rates;   // accelerations at the stages (count stages, half)
  double frequency;
  double mirror_sign;  // factor of the states after the span, 1 or -1
  // Expansions in Legendre polynomials, on an interval of length 1, of the first integral of the
  // polynomial through the stages, (stages + 1, stages), and of its second, (stages + 2, stages).
  GivenMatrix single, twofold;
};

/// Computes the states at given phases, out (2 half, number of phases).
void states_at(const Polynomials& orbit, const Vector& phases, Eigen::Map<Matrix> out);

/// A periodic orbit on a mesh, and derivatives at its stages; n = 2 half.
struct Intervals {
  Index stages, half;
  GivenMatrix durations;  // (count, 1)
  GivenMatrix starts;     // states at the beginnings of the intervals (count, n)
  GivenMatrix rates;      // accelerations at the stages (count stages, half)
  // For each stage the rates of its state from the forces, then derivatives of these rates by the
  // speed and by the state (count stages (2 + n), n).
  GivenMatrix linearised;
  // Derivatives of the accelerations by the frequency (half, count stages); empty if they are 0.
  GivenMatrix by_frequency;
  bool speed_varies;
  double frequency;
  GivenMatrix nodes;            // c (stages, 1)
  GivenMatrix single, twofold;  // O and T (stages, stages)
  double mirror_sign;  // ratio of the state after the last interval to the first state, 1 or -1
  GivenMatrix units;   // units of the state (n, 1), or empty if only maps of intervals are needed
};

/// Computes, for interval m, the derivatives of the accelerations (stages half, n + 3) and of the
/// state at the end (n, n + 3) by the state at the beginning, a share of the residual, frequency
/// and speed. With units, the derivatives of the state at the end are those of states in these
/// units, and the residual includes the difference between that state and the beginning of the next
/// interval. system: memory from stage_system. Returns false if a matrix is singular.
bool eliminate_stages(const Intervals& of, Index m, Matrix& system, Eigen::Map<Matrix> by_start,
                      Eigen::Map<Matrix> end);

/// Memory for the equations of an interval's stages, which eliminate_stages overwrites.
Matrix stage_system(Index stages, Index half);

/// Products of the maps x -> T x + r of intervals, given as [T | r] (count, n, columns). The
/// intervals are divided into runs; out receives for each interval the product [P | R] of all maps
/// from the beginning of its run to its own end (count, n, columns). A run ends before an entry of
/// P reaches most. Returns the beginnings of the runs.
std::vector<Index> multiply_maps(const double* maps, Index count, Index n, Index columns,
                                 double most, double* out);

}  // namespace pipedyn
