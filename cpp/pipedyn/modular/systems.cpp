// SPDX-License-Identifier: MIT
#include "pipedyn/modular/systems.hpp"

#include <utility>

namespace pipedyn {

SceneSystems::SceneSystems(const Scene& scene, FlowAt flow)
    : scene_(scene),
      flow_at_(std::move(flow)),
      factors_(static_cast<std::size_t>(scene.chain().factor_numbers())) {}

void SceneSystems::linearise(double t, const double* y, Index member) {
  state_ = Eigen::Map<const Vector>(y, 2 * scene_.dof());
  flow_ = flow_at_(t, member);
  about_ = scene_.linearised(flow_.of(state_.data()), Scene::return_rate);
}

SceneSystems::Shifted SceneSystems::product(const Matrix& rows, const double* x) {
  Shifted all = Shifted::Zero(rows.rows(), 2 * shifts);
  for (Index i = 0; i < rows.rows(); ++i) {
    Eigen::Matrix<double, 1, 2 * shifts> sum = Eigen::Matrix<double, 1, 2 * shifts>::Zero();
    for (Index j = 0; j < rows.cols(); ++j) {
      sum +=
          rows(i, j) * Eigen::Map<const Eigen::Matrix<double, 1, 2 * shifts>>(x + 2 * shifts * j);
    }
    all.row(i) = sum;
  }
  return all;
}

SceneSystems::Complexes SceneSystems::shifted_rows(const double* x) const {
  const Shifted moved = product(about_.r, x + 2 * shifts * scene_.dof()),
                turned = product(about_.e, x);
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
  const Index size = about_.x.cols();
  const auto or_none = [](const Vector& of) { return of.size() > 0 ? of.data() : nullptr; };
  Batch one = flow_.of(state_.data());
  one.moments = or_none(about_.moments);
  one.slopes = or_none(about_.slopes);
  chain.factorise(one, mu, factors_.data());
  for (Index s = 0; s < shifts; ++s) mu_[s] = {mu[s], mu[shifts + s]};
  responses_.assign(static_cast<std::size_t>(size), Matrix::Zero(state_.size(), 2 * shifts));
  Complexes systems[shifts];
  for (Complexes& system : systems) system = Complexes::Zero(size, size);
  for (Index z = 0; z < size; ++z) {
    Matrix& response = responses_[static_cast<std::size_t>(z)];
    response.bottomLeftCorner(scene_.dof(), shifts).colwise() = about_.x.col(z);
    chain.solve(flow_.u, factors_.data(), response.data());
    const Complexes column = shifted_rows(response.data());
    for (Index s = 0; s < shifts; ++s) systems[s].col(z) = column.col(s);
  }
  for (Index s = 0; s < shifts && size > 0; ++s) {
    systems[s].diagonal() += about_.compliance;
    systems_[s].compute(systems[s]);
  }
}

void SceneSystems::solve(double* b) {
  using Parts = Eigen::Array<double, 1, shifts>;
  const Index size = about_.x.cols();
  const Shifted wanted = product(about_.r, b + 2 * shifts * scene_.dof());
  scene_.chain().solve(flow_.u, factors_.data(), b);
  if (size == 0) return;
  Complexes z = -shifted_rows(b);
  for (Index s = 0; s < shifts; ++s) {
    for (Index i = 0; i < size; ++i) z(i, s) += Complex(wanted(i, s), wanted(i, shifts + s));
    z.col(s) = systems_[s].solve(z.col(s)).eval();
  }
  for (Index i = 0; i < size; ++i) {
    const Parts re = z.row(i).real(), im = z.row(i).imag();
    const double* from = responses_[static_cast<std::size_t>(i)].data();
    for (double *to = b, *end = b + 2 * shifts * state_.size(); to < end; to += 2 * shifts) {
      const Eigen::Map<const Parts> by_re(from), by_im(from + shifts);
      Eigen::Map<Parts> x_re(to), x_im(to + shifts);
      x_re += re * by_re - im * by_im;
      x_im += im * by_re + re * by_im;
      from += 2 * shifts;
    }
  }
}

}  // namespace pipedyn
