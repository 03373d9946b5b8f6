// SPDX-License-Identifier: MIT
//
// The acceleration of the pipe along its tangent, integrated over the pipe. With the acceleration
// A(s) and D(s) = r(1) - r(s), it is
//   int t . r'' = int t . A,
// whose derivatives are int Theta_i (n . A - (theta'' t + theta'^2 n) . D) by q_i,
// -2 int Theta_i theta' t . D by q_i', and int Theta_i n . D by q_i''. Local to each translation
// unit, like vector/pack.hpp.
#pragma once

#include "pipedyn/galerkin/block.hpp"

namespace {

template <class Real>
struct Axial : Block<Real> {
  using Base = Block<Real>;
  using Base::grid, Base::m, Base::padded, Base::points;
  using Base::sine, Base::cosine, Base::omega, Base::integrands, Base::moments;
  double* turning;     // theta'' (points); for a single member (stride)
  double* weighed[4];  // weights of Theta_i in the derivatives, (points) each

  using Base::Base;

  void take(Layout& layout) {
    Base::take(layout);
    turning = layout.take(grid.stride * lanes<Real>);
    for (double*& of : weighed) of = layout.take(points * lanes<Real>);
  }

  void axial(const Batch& batch, double* out) {
    this->angles(batch.y);
    this->template along<1>({batch.y + 2 * m * lanes<Real>}, {turning});
    const Count row = Base::row_length(4);
    for (Count p = 0; p < points; ++p) {
      const Real s = at<Real>(sine, p), c = at<Real>(cosine, p);
      const Real turn = at<Real>(turning, p), w = at<Real>(omega, p), square = w * w;
      double* const to = integrands + p * row;
      set(to, 0, Real(turn * c - square * s));
      set(to, 1, Real(-turn * s - square * c));
      set(to, 2, s);
      set(to, 3, c);
    }
    integrate(grid, row, 4 * lanes<Real>, integrands, moments);
    const Real base_x = this->driven(batch, Drive::acceleration);
    const Real base_y = this->driven(batch, Drive::acceleration + 1);
    const double* const end = moments + (points - 1) * row;
    const auto [down_x, down_y] = this->effects.down;
    Real along{};
    for (Count p = 0; p < points; ++p) {
      const double* const to = moments + p * row;
      const double weight = grid.weight[p];
      const Real s = at<Real>(sine, p), c = at<Real>(cosine, p);
      const Real turn = at<Real>(turning, p), w = at<Real>(omega, p);
      const Real ax = base_x + at<Real>(to, 0), ay = base_y + at<Real>(to, 1);
      const Real x = at<Real>(end, 2) - at<Real>(to, 2), y = at<Real>(end, 3) - at<Real>(to, 3);
      const Real beyond = s * x + c * y, across = c * x - s * y;
      along += weight * (s * ax + c * ay);
      set(weighed[0], p, Real(weight * (c * ax - s * ay - turn * beyond - w * w * across)));
      set(weighed[1], p, Real((-2.0 * weight) * w * beyond));
      set(weighed[2], p, Real(weight * across));
      set(weighed[3], p, Real(weight * (down_x * c - down_y * s)));
    }
    set(out, 0, along);
    set(out, 1, Real(down_x * at<Real>(end, 2) + down_y * at<Real>(end, 3)));
    for (Count k = 0; k < 4; ++k) {
      for (Count i = 0; i < m; ++i) {
        Real sum{};
        for (Count p = 0; p < points; ++p) {
          sum += grid.slope[p * padded + i] * at<Real>(weighed[k], p);
        }
        set(out, 2 + k * m + i, sum);
      }
    }
  }
};

}  // namespace
