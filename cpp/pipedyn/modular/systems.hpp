// SPDX-License-Identifier: MIT
//
// (mu - J) x = b of a scene about states that meet guides and pins nearly. With S b the solution of
// the chain that holds forces along rows (chain/shifted.hpp), and J_0, B, C, E as in scene.hpp,
//
//   x = S (b + B z),   ((mu C + E) S B + compliance) z = C b - (mu C + E) S b.
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
  /// speed: of the flow at a time, for a member.
  SceneSystems(const Scene& scene, std::function<double(double t, Index member)> speed);
  void linearise(double t, const double* y, Index member) override;
  void factorise(const double* mu) override;
  void solve(double* b) override;
  bool is_cheap() const override { return true; }

 private:
  static constexpr Index shifts = MotionKernel::shifts;
  using Complex = std::complex<double>;
  using Complexes = Eigen::Matrix<Complex, Eigen::Dynamic, Eigen::Dynamic>;

  const Scene& scene_;
  std::function<double(double t, Index member)> speed_;
  Vector state_;
  double u_ = 0.0;
  Scene::Linear about_;
  std::vector<double> factors_;
  Complex mu_[shifts];
  std::vector<Matrix> responses_;  // S B, (2 n, 2 shifts) each
  Eigen::PartialPivLU<Complexes> systems_[shifts];

  /// Real parts first (rows, 2 shifts).
  using Shifted = Eigen::Matrix<double, Eigen::Dynamic, 2 * shifts, Eigen::RowMajor>;
  static Shifted product(const Matrix& rows, const double* x);
  /// (mu C + E) x for each shift, (size of z, shifts).
  Complexes constrained(const double* x) const;
};

}  // namespace pipedyn
