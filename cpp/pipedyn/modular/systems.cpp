// SPDX-License-Identifier: MIT
#include "pipedyn/modular/systems.hpp"

#include <utility>

namespace pipedyn {

SceneSystems::SceneSystems(const Scene& scene, std::function<double(double, Index)> speed)
    : scene_(scene),
      speed_(std::move(speed)),
      factors_(static_cast<std::size_t>(scene.chain().factor_numbers())) {}

void SceneSystems::linearise(double t, const double* y, Index member) {
  state_ = Eigen::Map<const Vector>(y, 2 * scene_.dof());
  u_ = speed_(t, member);
  about_ = scene_.linearised({state_.data(), &u_, 1, 0}, true);
}

SceneSystems::Complexes SceneSystems::constrained(const Eigen::Ref<const Matrix>& x) const {
  const Matrix moved = about_.c * x, turned = about_.e * x;
  Complexes all(moved.rows(), shifts);
  for (Index s = 0; s < shifts; ++s) {
    for (Index i = 0; i < moved.rows(); ++i) {
      all(i, s) = mu_[s] * Complex(moved(i, s), moved(i, shifts + s)) +
                  Complex(turned(i, s), turned(i, shifts + s));
    }
  }
  return all;
}

void SceneSystems::factorise(const double* mu) {
  const Chain& chain = scene_.chain();
  const Index size = about_.b.cols();
  const auto or_none = [](const Vector& of) { return of.size() > 0 ? of.data() : nullptr; };
  chain.factorise({state_.data(), &u_, 1, 0, or_none(about_.moments), or_none(about_.slopes)}, mu,
                  factors_.data());
  for (Index s = 0; s < shifts; ++s) mu_[s] = {mu[s], mu[shifts + s]};
  responses_.assign(static_cast<std::size_t>(size), Matrix::Zero(state_.size(), 2 * shifts));
  Complexes systems[shifts];
  for (Complexes& system : systems) system = Complexes::Zero(size, size);
  for (Index z = 0; z < size; ++z) {
    Matrix& response = responses_[static_cast<std::size_t>(z)];
    response.leftCols(shifts).colwise() = about_.b.col(z);
    chain.solve(u_, factors_.data(), response.data());
    const Complexes column = constrained(response);
    for (Index s = 0; s < shifts; ++s) systems[s].col(z) = column.col(s);
  }
  for (Index s = 0; s < shifts && size > 0; ++s) {
    systems[s].diagonal() += about_.compliance;
    systems_[s].compute(systems[s]);
  }
}

void SceneSystems::solve(double* b) {
  Eigen::Map<Matrix> x(b, state_.size(), 2 * shifts);
  const Index size = about_.b.cols();
  const Matrix wanted = about_.c * x;
  scene_.chain().solve(u_, factors_.data(), b);
  if (size == 0) return;
  const Complexes found = constrained(x);
  for (Index s = 0; s < shifts; ++s) {
    Eigen::VectorXcd z(size);
    for (Index i = 0; i < size; ++i) {
      z[i] = Complex(wanted(i, s), wanted(i, shifts + s)) - found(i, s);
    }
    z = systems_[s].solve(z).eval();
    for (Index i = 0; i < size; ++i) {
      const Matrix& response = responses_[static_cast<std::size_t>(i)];
      x.col(s) += z[i].real() * response.col(s) - z[i].imag() * response.col(shifts + s);
      x.col(shifts + s) += z[i].imag() * response.col(s) + z[i].real() * response.col(shifts + s);
    }
  }
}

}  // namespace pipedyn
