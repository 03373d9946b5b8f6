// SPDX-License-Identifier: MIT
//
// Charts of the segments of chains in space (chain/space.hpp), which integrators change between
// steps. The rotation vector a of a segment is singular where rho = |a| is a multiple k pi, k > 0,
//
//   a <- (-1)^k (1 - k pi / rho) a,
//
// is the same tangent from the nearer end of the axis: in the other chart if k is odd.
//
// A segment that moves in a plane through the axis, to rounding, passes there without harm and
// keeps its chart, so that its angle counts its turns.
#pragma once

#include <cmath>
#include <utility>
#include <vector>

#include "pipedyn/pipe.hpp"

namespace pipedyn {

/// The chart of each segment of each member of a batch. States are [a_x, a_z, a_x', a_z', ...].
class Charts {
 public:
  /// changes: whether each segment may change its chart.
  Charts(std::vector<bool> changes, Index members)
      : changes_(std::move(changes)),
        signs_(Matrix::Ones(static_cast<Index>(changes_.size()), members)) {}

  Index segments() const { return signs_.rows(); }
  /// Signs of a member's segments (segments,), -1 in the second chart.
  auto of(Index member) const { return signs_.col(member); }
  /// Signs of some members (segments, members); empty if all are 1.
  Matrix of(const std::vector<Index>& which) const {
    if (turned_over_ == 0) return {};
    return signs_(Eigen::all, which);
  }

  /// Takes the segments of a member's state that come near the singular direction of their chart to
  /// the nearer end of the axis, and returns whether there are any.
  bool choose(Index member, double* y) {
    // Half way between the poles is pi / 2; segments that stay near it do not change at each step.
    constexpr double farthest = 2.0;
    // Largest part of the rate across the rotation vector in a plane: a thousand times rounding.
    constexpr double in_plane = 1e-13;
    bool changed = false;
    for (Index j = 0; j < segments(); ++j) {
      const Segment segment(y, j, segments());
      const auto [x, z, dx, dz] = segment;
      const double rho = std::hypot(*x, *z), rate = std::hypot(*dx, *dz);
      if (!(rho > farthest) || !changes_[static_cast<std::size_t>(j)]) continue;
      if (!(std::abs(*x * *dz - *z * *dx) > in_plane * rho * rate)) continue;
      const double k = std::round(rho / pi), sign = std::fmod(k, 2.0) == 0.0 ? 1.0 : -1.0;
      segment.shorten(k, sign);
      signs_(j, member) *= sign;
      if (sign < 0.0) turned_over_ += signs_(j, member) < 0.0 ? 1 : -1;
      changed = true;
    }
    return changed;
  }

  /// Replaces a member's state by that in the first chart.
  void leave(Index member, double* y) const { leave(of(member), y); }
  /// Replaces a state whose segments have these signs by that in the first chart, with rho up to pi
  /// for segments that were in the second one. Rates are large close to pi, where the chart is
  /// singular.
  static void leave(const auto& signs, double* y) {
    for (Index j = 0; j < signs.size(); ++j) {
      if (signs[j] > 0.0) continue;
      const Segment segment(y, j, signs.size());
      const auto [x, z, dx, dz] = segment;
      if (*x != 0.0 || *z != 0.0) {
        segment.shorten(1.0, -1.0);
        continue;
      }
      const double rate = std::hypot(*dx, *dz);  // from the side that it comes from
      *x = rate > 0.0 ? -pi * *dx / rate : pi;
      *z = rate > 0.0 ? -pi * *dz / rate : 0.0;
      *dx = -*dx;
      *dz = -*dz;
    }
  }

 private:
  static constexpr double pi = 3.141592653589793;
  /// The numbers of segment j of n in a state.
  struct Segment {
    double *x, *z, *dx, *dz;

    Segment(double* y, Index j, Index n)
        : x(y + j), z(y + n + j), dx(y + 2 * n + j), dz(y + 3 * n + j) {}
    /// Replaces a by sign (1 - k pi / rho) a.
    void shorten(double k, double sign) const {
      const double rho = std::hypot(*x, *z), factor = (rho - k * pi) / rho;
      const double radial = k * pi / rho * ((*x / rho) * *dx + (*z / rho) * *dz) / rho;
      *dx = sign * (factor * *dx + radial * *x);
      *dz = sign * (factor * *dz + radial * *z);
      *x *= sign * factor;
      *z *= sign * factor;
    }
  };

  std::vector<bool> changes_;
  Matrix signs_;
  Index turned_over_ = 0;  // number of signs that are -1
};

}  // namespace pipedyn
