// SPDX-License-Identifier: MIT
#include "pipedyn/modular/systems.hpp"

#include <utility>

#include "pipedyn/vector/levels.hpp"

namespace pipedyn {

SceneSystems::SceneSystems(const Scene& scene, FlowAt flow)
    : scene_(scene),
      chain_(scene.chain()),
      flow_at_(std::move(flow)),
      factors_(static_cast<std::size_t>(chain_.factor_numbers())) {}

void SceneSystems::linearise(double t, const double* y, Index member) {
  state_ = Eigen::Map<const Vector>(y, 2 * chain_.dof());
  flow_ = flow_at_(t, member);
  about_ = scene_.linearised(flow_.of(state_.data()), Scene::return_rate);
}

SceneSystems::Shifted SceneSystems::product(const Matrix& rows, const double* x) {
  return rows.lazyProduct(Eigen::Map<const Shifted>(x, rows.cols(), 2 * shifts).matrix());
}

SceneSystems::Shifted SceneSystems::shifted_rows(const double* x) const {
  const Shifted moved = product(about_.r, x + 2 * shifts * chain_.dof());
  Shifted all = product(about_.e, x);
  for (Index i = 0; i < all.rows(); ++i) {
    const Parts re = moved.row(i).head<shifts>(), im = moved.row(i).tail<shifts>();
    all.row(i).head<shifts>() += mu_re_ * re - mu_im_ * im;
    all.row(i).tail<shifts>() += mu_re_ * im + mu_im_ * re;
  }
  return all;
}

void SceneSystems::factorise(const double* mu) {
  const Index size = about_.x.cols();
  const auto or_none = [](const Vector& of) { return of.size() > 0 ? of.data() : nullptr; };
  Batch one = flow_.of(state_.data());
  one.moments = or_none(about_.moments);
  one.slopes = or_none(about_.slopes);
  chain_.factorise(one, mu, factors_.data());
  mu_re_ = Eigen::Map<const Parts>(mu);
  mu_im_ = Eigen::Map<const Parts>(mu + shifts);
  responses_.resize(static_cast<std::size_t>(size));
  systems_.resize(size * size, 2 * shifts);
  pivots_.resize(static_cast<std::size_t>(shifts * size));
  for (Index z = 0; z < size; ++z) {
    Matrix& response = responses_[static_cast<std::size_t>(z)];
    response.setZero(state_.size(), 2 * shifts);
    response.bottomLeftCorner(chain_.dof(), shifts).colwise() = about_.x.col(z);
    chain_.solve(factors_.data(), response.data());
    const Shifted column = shifted_rows(response.data());
    for (Index i = 0; i < size; ++i) systems_.row(i * size + z) = column.row(i);
    systems_.row(z * size + z).head<shifts>() += about_.compliance[z];
  }
  motion_kernel().factorise_dense(systems_.data(), size, pivots_.data());
}

void SceneSystems::solve(double* b) {
  const Index size = about_.x.cols();
  const Shifted wanted = product(about_.r, b + 2 * shifts * chain_.dof());
  chain_.solve(factors_.data(), b);
  if (size == 0) return;
  Shifted z = wanted - shifted_rows(b);
  motion_kernel().solve_dense(systems_.data(), pivots_.data(), size, z.data());
  Eigen::Map<Shifted> x(b, state_.size(), 2 * shifts);
  for (Index i = 0; i < size; ++i) {
    const Parts re = z.row(i).head<shifts>(), im = z.row(i).tail<shifts>();
    const auto response = responses_[static_cast<std::size_t>(i)].array();
    const auto by_re = response.leftCols<shifts>(), by_im = response.rightCols<shifts>();
    x.leftCols<shifts>() += by_re.rowwise() * re - by_im.rowwise() * im;
    x.rightCols<shifts>() += by_re.rowwise() * im + by_im.rowwise() * re;
  }
}

}  // namespace pipedyn
