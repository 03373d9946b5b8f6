// SPDX-License-Identifier: MIT
//
// Solution of (mu - J) x = b for a scene without modules in Python, about states that meet guides
// and pins nearly. S b is the solution for the chain with constant forces along the rows
// (chain/shifted.hpp), and R, E and X are those of scene.hpp, where R and X apply to accelerations.
// Then
//
//   x = S (b + X z),   ((mu R + E) S X + compliance) z = R b - (mu R + E) S b.
//
// Each right side costs one solve of the chain; each new mu costs one more for each entry of z. A
// scene without guides, pins and further inertia has no z.
#pragma once

#include "pipedyn/modular/scene.hpp"
#include "pipedyn/motion/radau.hpp"

namespace pipedyn {

/// The linear systems of implicit integrators for a scene without modules in Python.
class SceneSystems final : public ShiftedSystems {
 public:
  SceneSystems(const Scene& scene, FlowAt flow);
  void linearise(double t, const double* y, Index member) override;
  void factorise(const double* mu) override;
  void solve(double* b) override;

 private:
  static constexpr Index shifts = MotionKernel::shifts;
  /// Rows of complex numbers, real parts before imaginary parts (rows, 2 shifts).
  using Shifted = Eigen::Array<double, Eigen::Dynamic, 2 * shifts, Eigen::RowMajor>;
  using Parts = Eigen::Array<double, 1, shifts>;

  const Scene& scene_;
  const Chain& chain_;
  FlowAt flow_at_;
  Vector state_;
  Flows flow_;
  Scene::Linear about_;
  std::vector<double> factors_;
  Parts mu_re_, mu_im_;
  std::vector<Matrix> responses_;  // columns of S X, (2 n, 2 shifts) each
  Shifted systems_;                // factors of the systems for z (size of z squared, 2 shifts)
  std::vector<Index> pivots_;

  /// Product of rows (r, k) and x (k, 2 shifts), shape (r, 2 shifts).
  static Shifted product(const Matrix& rows, const double* x);
  /// Product (mu R + E) x, shape (size of z, 2 shifts).
  Shifted shifted_rows(const double* x) const;
};

}  // namespace pipedyn
