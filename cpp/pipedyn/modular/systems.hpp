// SPDX-License-Identifier: MIT
//
// (mu - J) x = b of a scene about states that meet guides and pins nearly. With S b the solution of
// the chain that holds forces along rows (chain/shifted.hpp), and R, E and X as in scene.hpp, R and
// X of accelerations,
//
//   x = S (b + X z),   ((mu R + E) S X + compliance) z = R b - (mu R + E) S b.
//
// A chain's solve each, and one for each z where mu changes.
#pragma once

#include "pipedyn/modular/scene.hpp"
#include "pipedyn/motion/radau.hpp"

namespace pipedyn {

class SceneSystems final : public ShiftedSystems {
 public:
  SceneSystems(const Scene& scene, FlowAt flow);
  void linearise(double t, const double* y, Index member) override;
  void factorise(const double* mu) override;
  void solve(double* b) override;
  bool is_cheap() const override { return true; }

 private:
  static constexpr Index shifts = MotionKernel::shifts;
  /// Real parts first (rows, 2 shifts).
  using Shifted = Eigen::Array<double, Eigen::Dynamic, 2 * shifts, Eigen::RowMajor>;
  using Parts = Eigen::Array<double, 1, shifts>;

  const Scene& scene_;
  FlowAt flow_at_;
  Vector state_;
  Flow flow_;
  Scene::Linear about_;
  std::vector<double> factors_;
  Parts mu_re_, mu_im_;
  std::vector<Matrix> responses_;  // S X, (2 n, 2 shifts) each
  Shifted systems_;                // of z, factorised (size of z squared, 2 shifts)
  std::vector<Index> pivots_;

  static Shifted product(const Matrix& rows, const double* x);
  /// (mu R + E) x, (size of z, 2 shifts).
  Shifted shifted_rows(const double* x) const;
};

}  // namespace pipedyn
