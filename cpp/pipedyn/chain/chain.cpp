// SPDX-License-Identifier: MIT
#include "pipedyn/chain/chain.hpp"

#include <stdexcept>
#include <string>
#include <utility>

#include "pipedyn/vector/levels.hpp"
#include "pipedyn/vector/scratch.hpp"

namespace pipedyn {

namespace {

void require_rows(Index rows, Index dof) {
  if (rows != dof) {
    throw std::invalid_argument("expected one row a segment, " + std::to_string(dof) + ", got " +
                                std::to_string(rows));
  }
}

}  // namespace

Chain::Chain(const Pipe& pipe, Segments segments) : pipe_(pipe), segments_(std::move(segments)) {
  const Index n = dof();
  if (n < 1 || segments_.center.size() != n || segments_.gyration_radius.size() != n ||
      segments_.spring.size() != n || segments_.drag_point.size() != n) {
    throw std::invalid_argument("segments must have one entry a segment in every array");
  }
  const Vector& l = segments_.length;
  mass_beyond_.resize(n);
  double beyond = 0.0;
  for (Index k = n - 1; k >= 0; --k) {
    mass_beyond_[k] = beyond;
    beyond += l[k];
  }
  first_moment_ = l.array() * (mass_beyond_.array() + segments_.center.array() * l.array());
  links_.reserve(static_cast<std::size_t>(n));
  for (Index j = 0; j < n; ++j) {
    const double mass = l[j], arm = segments_.center[j] * l[j], eta = segments_.gyration_radius[j];
    const double inertia = mass * (arm * arm + eta * eta), rest = l[j] - arm;
    links_.push_back({.length = l[j],
                      .length_square = l[j] * l[j],
                      .mass = mass,
                      .first_moment = mass * arm,
                      .inertia = inertia,
                      .end_inertia = mass * (rest * rest + eta * eta),
                      .own_inertia = mass * mass * eta * eta,
                      .exchange = mass * (eta * eta - arm * rest),
                      .spring = segments_.spring[j],
                      .drag_arm = segments_.drag_point[j] * l[j],
                      .drag = pipe_.drag * l[j],
                      .weight = pipe_.gamma * first_moment_[j]});
  }
}

Operators Chain::operators() const { return operators(Vector::Zero(dof())); }

Operators Chain::operators(const Vector& angles) const {
  const Index n = dof();
  require_rows(angles.size(), n);
  const Vector sine = angles.array().sin(), cosine = angles.array().cos();
  const auto cosine_between = [&](Index k, Index i) {
    return cosine[k] * cosine[i] + sine[k] * sine[i];
  };
  const auto& [l, chi, eta, spring, xi, base] = segments_;
  const double sqrt_beta = pipe_.sqrt_beta();
  Operators ops(n);
  for (Index k = 0; k < n; ++k) {
    const double arm = chi[k] * l[k];
    ops.mass(k, k) = l[k] * l[k] * mass_beyond_[k] + l[k] * (arm * arm + eta[k] * eta[k]);
    ops.end_flux(k, k) = sqrt_beta * l[k] * l[k];
    for (Index i = k + 1; i < n; ++i) {
      const double turned = cosine_between(k, i);
      const double product = sqrt_beta * l[k] * l[i] * turned;
      ops.mass(k, i) = ops.mass(i, k) = l[k] * first_moment_[i] * turned;
      ops.end_flux(k, i) = ops.end_flux(i, k) = product;
      ops.gyroscopic(k, i) = product;
      ops.gyroscopic(i, k) = -product;
    }
    const double thrust = l[k] * cosine_between(k, n - 1);
    ops.flux(k, k) -= thrust;
    ops.flux(k, n - 1) += thrust;
    ops.stiffness(k, k) = spring[k];
    if (k + 1 < n) {
      ops.stiffness(k, k) += spring[k + 1];
      ops.stiffness(k, k + 1) = ops.stiffness(k + 1, k) = -spring[k + 1];
    }
  }
  ops.damping = pipe_.damping * ops.stiffness;
  ops.stiffness.diagonal() += pipe_.gamma * first_moment_.cwiseProduct(cosine);
  return ops;
}

Operators Chain::joint_operators(const Vector& scale) const {
  const Index n = dof();
  require_rows(scale.size(), n);
  const auto& [l, chi, eta, spring, xi, base] = segments_;
  const double sqrt_beta = pipe_.sqrt_beta();
  Operators ops(n);
  double mass = 0.0, first = 0.0, second = 0.0;  // of all beyond joint j, about joint j
  for (Index j = n - 1; j >= 0; --j) {
    const double arm = chi[j] * l[j];
    second += 2.0 * l[j] * first + l[j] * l[j] * mass + l[j] * (arm * arm + eta[j] * eta[j]);
    first += l[j] * mass + l[j] * arm;
    mass += l[j];
    double distance = 0.0;  // from joint i to joint j
    for (Index i = j; i >= 0; --i) {
      if (i < j) distance += l[i];
      const double s = scale[i] * scale[j];
      ops.mass(i, j) = ops.mass(j, i) = s * (second + distance * first);
      ops.gyroscopic(i, j) = s * sqrt_beta * distance * mass;
      ops.gyroscopic(j, i) = -ops.gyroscopic(i, j);
      ops.end_flux(i, j) = ops.end_flux(j, i) = s * sqrt_beta * (distance + mass) * mass;
      ops.flux(i, j) = s * distance;
      ops.stiffness(i, j) = ops.stiffness(j, i) = s * pipe_.gamma * first;
    }
    const double elastic = spring[j] * scale[j] * scale[j];
    ops.stiffness(j, j) += elastic;
    ops.damping(j, j) = pipe_.damping * elastic;
  }
  return ops;
}

Matrix Chain::mass_times(const Matrix& x) const {
  const Index n = dof();
  require_rows(x.rows(), n);
  const auto& [l, chi, eta, spring, xi, base] = segments_;
  Matrix out(n, x.cols());
  Eigen::RowVectorXd carry = Eigen::RowVectorXd::Zero(x.cols());  // acceleration of node k - 1
  for (Index k = 0; k < n; ++k) {
    out.row(k) = l[k] * (carry + chi[k] * l[k] * x.row(k));  // inertia force of segment k
    carry += l[k] * x.row(k);
  }
  carry.setZero();  // inertia force of all beyond segment k
  Eigen::RowVectorXd force(x.cols());
  for (Index k = n - 1; k >= 0; --k) {
    force = out.row(k);
    out.row(k) = l[k] * carry + chi[k] * l[k] * force + l[k] * eta[k] * eta[k] * x.row(k);
    carry += force;
  }
  return out;
}

Matrix Chain::velocity_times(const Matrix& x, bool transposed) const {
  const Index n = dof();
  require_rows(x.rows(), n);
  const Vector& l = segments_.length;
  const double sqrt_beta = pipe_.sqrt_beta();
  Matrix out(n, x.cols());
  Eigen::RowVectorXd sum = Eigen::RowVectorXd::Zero(x.cols());  // over i > k; transposed: i < k
  for (Index step = 0; step < n; ++step) {
    const Index k = transposed ? step : n - 1 - step;
    out.row(k) = sqrt_beta * l[k] * (l[k] * x.row(k) + 2.0 * sum);
    sum += l[k] * x.row(k);
  }
  return out;
}

Matrix Chain::flux_times(const Matrix& x, bool transposed) const {
  const Index n = dof();
  require_rows(x.rows(), n);
  const Vector& l = segments_.length;
  Matrix out = -(l.asDiagonal() * x);
  if (transposed) {
    out.row(n - 1) += l.transpose() * x;
  } else {
    out += l * x.row(n - 1);
  }
  return out;
}

Matrix Chain::gravity_times(const Matrix& x) const {
  require_rows(x.rows(), dof());
  return first_moment_.asDiagonal() * x;
}

Matrix Chain::springs_times(const Matrix& joint_angles) const {
  const Index n = dof();
  require_rows(joint_angles.rows(), n);
  Matrix out = segments_.spring.asDiagonal() * joint_angles;
  out.topRows(n - 1) -= out.bottomRows(n - 1).eval();
  return out;
}

Chain::ComplexMatrix Chain::band(std::complex<double> lambda, double u) const {
  using Complex = std::complex<double>;
  const Index n = dof();
  const auto& [l, chi, eta, spring, xi, base] = segments_;
  const Complex inertia = lambda * lambda;
  const Complex coriolis = pipe_.sqrt_beta() * pipe_.direction() * u * lambda;
  const Complex elastic = 1.0 + pipe_.damping * lambda;
  const double thrust = pipe_.centrifugal * u * u;
  ComplexMatrix band = ComplexMatrix::Zero(3 * band_width + 1, 4 * n);
  const auto at = [&band](Index row, Index column) -> Complex& {
    return band(2 * band_width + row - column, column);
  };
  for (Index j = 0; j < n; ++j) {
    const Index phi = 4 * j, theta = phi + 1, w = phi + 2, force = phi + 3;
    const Index angle_row = phi, node_row = phi + 1, moment_row = phi + 2, force_row = phi + 3;
    const double arm = chi[j] * l[j];
    at(angle_row, theta) = 1.0;
    at(angle_row, phi) = -1.0;
    at(node_row, w) = 1.0;
    at(node_row, theta) = -l[j];
    at(moment_row, phi) = elastic * spring[j];
    at(moment_row, theta) = inertia * l[j] * (arm * arm + eta[j] * eta[j]) +
                            coriolis * l[j] * l[j] - thrust * l[j] + pipe_.gamma * first_moment_[j];
    at(moment_row, force) = l[j];
    at(force_row, force) = 1.0;
    if (j > 0) {
      at(angle_row, theta - 4) = -1.0;
      at(node_row, w - 4) = -1.0;
      at(moment_row, w - 4) = inertia * l[j] * arm;
    }
    if (j + 1 < n) {
      at(moment_row, phi + 4) = -elastic * spring[j + 1];
      at(force_row, force + 4) = -1.0;
      at(force_row, w) = -inertia * l[j + 1];
      at(force_row, theta + 4) =
          -inertia * chi[j + 1] * l[j + 1] * l[j + 1] - 2.0 * coriolis * l[j + 1];
    } else {
      at(force_row, theta) = -thrust;
    }
  }
  return band;
}

MotionModel Chain::motion() const {
  return {.links = links_.data(),
          .size = dof(),
          .gravity = pipe_.gamma,
          .damping = pipe_.damping,
          .coriolis = pipe_.direction() * pipe_.sqrt_beta(),
          .centrifugal = pipe_.centrifugal,
          .drag = pipe_.drag != 0.0};
}

void Chain::rhs(const Batch& batch, double* rates) const {
  const MotionKernel& kernel = motion_kernel();
  kernel.rhs(motion(), batch, rates, scratch(kernel.scratch_size(dof(), batch.members)));
}

void Chain::jacobian(const double* y, double u, double* out) const {
  const MotionKernel& kernel = motion_kernel();
  kernel.jacobian(motion(), y, u, out, scratch(kernel.jacobian_scratch_size(dof())));
}

void Chain::energy(const Batch& batch, double* out) const {
  const MotionKernel& kernel = motion_kernel();
  kernel.energy(motion(), batch, out, scratch(kernel.scratch_size(dof(), batch.members)));
}

void Chain::power(const Batch& batch, const PowerParts& out) const {
  const MotionKernel& kernel = motion_kernel();
  kernel.power(motion(), batch, out, scratch(kernel.scratch_size(dof(), batch.members)));
}

}  // namespace pipedyn
