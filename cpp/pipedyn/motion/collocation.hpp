// SPDX-License-Identifier: MIT
//
// Collocation of periodic orbits: the equations linearised about an orbit, with all unknowns but
// the first state eliminated. The stages of an interval leave x(k+1) = T(k) x(k) + r(k). Products
// of the T carry a state through runs of intervals over which no digits are lost; between runs
// orthogonal transformations eliminate the states in pairs down to L x(0) + R x(end) = C (Wright
// 1992), so that large multipliers cost no digits either. The cost is linear in the number of
// intervals.
#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "pipedyn/chain/motion.hpp"
#include "pipedyn/pipe.hpp"

namespace pipedyn {

using GivenMatrix = Eigen::Map<const Matrix>;

/// A collocation method with its nodes c (stages, 1), and the transposes (stages, stages) of its
/// matrices O of first and T of second integrals; see interval_stages.hpp.
struct Weights {
  GivenMatrix nodes, single, twofold;
};

/// A periodic orbit on a mesh, with n = 2 half numbers in a state.
struct Intervals {
  Weights weights;
  GivenMatrix durations;  // (count, 1)
  GivenMatrix starts;     // states at the beginnings of the intervals (count, n)
  GivenMatrix rates;      // accelerations at the stages (count stages, half)
  double frequency;
  double mirror_sign;  // ratio of the state after the last interval to the first state, 1 or -1

  Index count() const { return durations.rows(); }
  Index stages() const { return weights.nodes.rows(); }
  Index half() const { return rates.cols(); }
};

/// Computes the states at the stages of interval m, out (2 half, stages).
void states_at_stages(const Intervals& of, Index m, Eigen::Ref<Matrix> out);

/// Forces along an orbit, for the equations linearised about it.
struct Forces {
  /// Rates of the states of a batch, each followed by their derivatives by the speed and by the
  /// state (members, 2 + n, n), or those by the state alone (members, n, n) if only these count.
  std::function<void(const Batch&, double*)> linearise;
  Vector speeds;  // flow speed at all stages (1,), or at each (count stages,)
  Matrix drive;   // at the stages (Drive::rows or more, count stages); empty if there is none
  // Derivatives of the accelerations by the frequency (half, count stages); empty if they are 0.
  GivenMatrix by_frequency;
  bool speed_varies;  // else the derivatives by the speed count as 0
  // Whether only changes of the state count, and none of the residual, the frequency or the speed.
  bool of_states;
  bool forced;  // whether the speed comes before the frequency among the loads and the unknowns
};

/// The relation L x(0) + R x(end) = C y of the states at both ends of intervals x -> T x + r y, and
/// the states between, for loads y.
class SpanRelation {
 public:
  Matrix first, last, known;  // L and R (n, n), and C (n, loads)

  SpanRelation() = default;
  /// maps: [T | r] (count n, n + loads). A run ends before an entry of its product reaches most.
  SpanRelation(const Matrix& maps, Index n, double most);

  /// States at the beginnings of all intervals (count n, k) from those at both ends, [x(0); x(end)]
  /// (2 n, k), and the loads (loads, k).
  Matrix states(const Matrix& ends, const Matrix& loads) const;

  /// Products [P | R] of the maps, each from the beginning of its interval's run to its end, and
  /// the first interval of each run.
  const Matrix& products() const { return products_; }
  const std::vector<Index>& begins() const { return begins_; }

 private:
  /// Pairs of neighbouring runs, whose states x between them are U x = C y - L x(begin) - R x(end)
  /// with triangles U; the rows of [U | L | R | C] of all pairs.
  using Level = Matrix;

  Matrix products_;
  std::vector<Index> begins_;
  std::vector<Level> levels_;
};

/// The collocation equations linearised about an orbit. The loads are a share of the residual and
/// changes of frequency and speed; or speed and frequency, if the orbit is forced. Unknowns are the
/// states at the beginnings of the intervals, the accelerations at the stages, and both of these.
class LinearisedOrbit {
 public:
  /// most: as for SpanRelation. `regular` is false if a matrix is singular.
  LinearisedOrbit(const Intervals& of, const Forces& forces, double most);

  bool regular = true;
  double unit;      // of velocities; that of positions is 1, so that fast modes have both alike
  Matrix by_rates;  // derivatives of the accelerations (count stages half, n + loads)
  Matrix maps;      // of states in these units (count n, n + loads)
  SpanRelation span;

  Index count() const { return maps.rows() / n_; }
  /// Number of all unknowns.
  Index unknowns() const { return maps.rows() + by_rates.rows() + 2; }

  /// The changes of all unknowns with states at both ends, in these units, [x(0); x(end)] (2 n, k),
  /// and the loads (3, k).
  Matrix restored(const Matrix& ends, const Matrix& loads) const;

  /// The change z of the unknowns for which the linearised equations have `share` of their residual
  /// as load, phase . z = shift and row . z = gap. Empty if it is not unique. If a pipe in space
  /// may be turned about its axis, turn (n,) is the change of the first state by that, in these
  /// units and of length 1; the first state then changes normal to it. It is empty otherwise.
  std::optional<Vector> change(const Vector& phase, double shift, const Vector& row, double gap,
                               double share, const Vector& turn) const;

 private:
  Index n_ = 0, each_ = 0;  // numbers of a state, and of an interval's accelerations
  double mirror_sign_;
  Vector across_;  // a row on the change of the first state and the last two unknowns (n + 2,)
};

}  // namespace pipedyn
