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
// the speed. These s n / 2 equations are solved by LAPACK.
#pragma once

#include "pipedyn/linear/operator.hpp"
#include "pipedyn/pipe.hpp"

namespace pipedyn {

/// A periodic orbit on a mesh, and derivatives at its stages; n = 2 half.
struct Intervals {
  using Table = Eigen::Map<const Matrix>;

  Index stages, half;
  Table durations;  // (count, 1)
  Table starts;     // states at the beginnings of the intervals (count, n)
  Table rates;      // accelerations at the stages (count stages, half)
  // For each stage the rates of its state from the forces, then derivatives of these rates by the
  // speed and by the state (count stages (2 + n), n).
  Table linearised;
  Table by_frequency;  // derivatives of the accelerations by the frequency (half, count stages)
  bool speed_varies;
  double frequency;
  Table nodes;        // c (stages, 1)
  Table once, twice;  // O and T (stages, stages)
  double mirror;      // ratio of the state after the last interval to the first state, 1 or -1
  Table units;        // units of the state (n, 1), or empty if only maps of intervals are needed
};

/// Computes, for interval m, the derivatives of the accelerations (stages half, n + 3) and of the
/// state at the end (n, n + 3) by the state at the beginning, a share of the residual, frequency
/// and speed. With units, the derivatives of the state at the end are those of states in these
/// units, and the residual includes the difference between that state and the beginning of the next
/// interval. Returns false if a matrix is singular.
bool eliminate_stages(const Lapack& lapack, const Intervals& of, Index m,
                      Eigen::Map<Matrix> by_start, Eigen::Map<Matrix> end);

}  // namespace pipedyn
