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

#include <Eigen/LU>
#include <complex>

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
  using Complex = std::complex<double>;
  using Complexes = Eigen::Matrix<Complex, Eigen::Dynamic, Eigen::Dynamic>;

  const Scene& scene_;
  FlowAt flow_at_;
  Vector state_;
  Flow flow_;
  Scene::Linear about_;
  std::vector<double> factors_;
  Complex mu_[shifts];
  std::vector<Matrix> responses_;  // S X, (2 n, 2 shifts) each
  Eigen::PartialPivLU<Complexes> systems_[shifts];

  /// Real parts first (rows, 2 shifts).
  using Shifted = Eigen::Matrix<double, Eigen::Dynamic, 2 * shifts, Eigen::RowMajor>;
  static Shifted product(const Matrix& rows, const double* x);
  /// (mu R + E) x for each shift, (size of z, shifts).
  Complexes shifted_rows(const double* x) const;
};

}  // namespace pipedyn
