// SPDX-License-Identifier: MIT
#include "pipedyn/chain/chain.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <utility>

#include "pipedyn/chain/places.hpp"
#include "pipedyn/chain/stations.hpp"
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
  place_terms();
  const Vector& l = segments_.length;
  mass_beyond_.resize(n);
  double beyond = 0.0;
  for (Index k = n - 1; k >= 0; --k) {
    mass_beyond_[k] = beyond;
    beyond += mass_[k];
  }
  first_moment_ = l.array() * (mass_beyond_.array() + mass_.array() * segments_.center.array());
  links_.reserve(static_cast<std::size_t>(n));
  for (Index j = 0; j < n; ++j) {
    const double mass = mass_[j], arm = segments_.center[j] * l[j],
                 eta = segments_.gyration_radius[j];
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
  linearise_loads();
}

void Chain::place_terms() {
  mass_ = segments_.length;
  for_each_place(pipe_.terms, segments_.length, segments_.base,
                 [&](const auto& law, const Term& term, Index j, double arm, double weight) {
                   if (law.mass() != 0.0) add_mass(j, arm, weight * law.mass());
                   if (law.loads) loads_.push_back({j, arm, weight, term});
                 });
  std::stable_sort(
      loads_.begin(), loads_.end(),
      [](const SegmentTerm& one, const SegmentTerm& other) { return one.segment < other.segment; });
}

void Chain::linearise_loads() {
  if (loads_.empty()) return;
  const Index n = dof();
  const Vector& l = segments_.length;
  const Vector straight = Vector::Zero(n), one = Vector::Ones(n);
  std::vector<LoadMoments> sums(static_cast<std::size_t>(n));
  load_moments(motion(), straight.data(), one.data(), nullptr, sums.data());
  linear_loads_.resize(sums.size());
  double tension = 0.0;
  for (Index j = n - 1; j >= 0; --j) {
    const auto& [load, slopes] = sums[static_cast<std::size_t>(j)];
    const auto moments = [&](double (Slopes::*by)[2][2]) {
      return Moments{-(slopes[0].*by)[0][0], -(slopes[1].*by)[0][0], -(slopes[2].*by)[0][0]};
    };
    linear_loads_[static_cast<std::size_t>(j)] = {
        .stiffness = moments(&Slopes::by_position),
        .damping = moments(&Slopes::by_velocity),
        .turned = {-slopes[0].by_angle[0], -slopes[1].by_angle[0]},
        .held = l[j] * tension + load[1][1]};
    tension += load[0][1];
  }
}

void Chain::add_mass(Index segment, double arm, double mass) {
  const double l = segments_.length[segment];
  double &own = mass_[segment], &chi = segments_.center[segment];
  double& eta = segments_.gyration_radius[segment];
  const double total = own + mass, share = mass / total, apart = arm - chi * l;
  eta = std::sqrt(own / total * (eta * eta + share * apart * apart));
  chi += share * apart / l;
  own = total;
}

void Moments::before(double l, const Moments& own) {
  second += 2.0 * l * first + l * l * zeroth + own.second;
  first += l * zeroth + own.first;
  zeroth += own.zeroth;
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
    ops.mass(k, k) = l[k] * l[k] * mass_beyond_[k] + mass_[k] * (arm * arm + eta[k] * eta[k]);
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
  if (!loads_.empty()) add_loads(sine, cosine, ops);
  return ops;
}

void Chain::add_loads(const Vector& sine, const Vector& cosine, Operators& ops) const {
  using Plane = Eigen::Vector2d;
  using Block = Eigen::Matrix<double, 2, 2, Eigen::RowMajor>;
  const Index n = dof();
  const Vector& l = segments_.length;
  std::vector<LoadMoments> sums(static_cast<std::size_t>(n));
  load_moments(motion(), sine.data(), cosine.data(), nullptr, sums.data());
  const auto block = [](const double (&rows)[2][2]) { return Block(&rows[0][0]); };
  const auto normal = [&](Index k) { return Plane(cosine[k], -sine[k]); };
  Block position = Block::Zero(), velocity = Block::Zero();  // slopes beyond segment i
  Plane load = Plane::Zero();
  for (Index i = n - 1; i >= 0; --i) {
    const auto& [loads, slopes] = sums[static_cast<std::size_t>(i)];
    const Plane across = normal(i), along(sine[i], cosine[i]);
    const Block by_position = l[i] * position + block(slopes[1].by_position);
    const Block by_velocity = l[i] * velocity + block(slopes[1].by_velocity);
    const Plane turned = by_position * across + Plane(slopes[0].by_angle);
    const Plane moved = by_velocity * across;
    for (Index k = 0; k < i; ++k) {
      const Plane other = l[k] * normal(k);
      ops.stiffness(k, i) -= other.dot(turned);
      ops.stiffness(i, k) -= across.dot(by_position * other);
      ops.damping(k, i) -= other.dot(moved);
      ops.damping(i, k) -= across.dot(by_velocity * other);
    }
    const Block own_position = l[i] * l[i] * position + block(slopes[2].by_position);
    const Block own_velocity = l[i] * l[i] * velocity + block(slopes[2].by_velocity);
    ops.stiffness(i, i) -= across.dot(own_position * across + Plane(slopes[1].by_angle));
    ops.stiffness(i, i) += along.dot(l[i] * load + Plane(loads[1]));
    ops.damping(i, i) -= across.dot(own_velocity * across);
    position += block(slopes[0].by_position);
    velocity += block(slopes[0].by_velocity);
    load += Plane(loads[0]);
  }
}

Operators Chain::joint_operators(const Vector& scale) const {
  const Index n = dof();
  require_rows(scale.size(), n);
  const auto& [l, chi, eta, spring, xi, base] = segments_;
  const double sqrt_beta = pipe_.sqrt_beta();
  Operators ops(n);
  Moments mass, stiffness, damping;  // of all beyond joint j, about joint j
  double beyond = 0.0, held = 0.0, turned = 0.0, turning = 0.0;
  for (Index j = n - 1; j >= 0; --j) {
    const double arm = chi[j] * l[j];
    mass.before(l[j], {mass_[j], mass_[j] * arm, mass_[j] * (arm * arm + eta[j] * eta[j])});
    beyond += l[j];
    const bool loaded = !loads_.empty();
    if (loaded) {
      const LinearLoads& own = linear_loads_[static_cast<std::size_t>(j)];
      stiffness.before(l[j], own.stiffness);
      damping.before(l[j], own.damping);
      held += own.held;
      turning += l[j] * turned + own.turned[1];
      turned += own.turned[0];
    }
    double distance = 0.0;  // from joint i to joint j
    for (Index i = j; i >= 0; --i) {
      if (i < j) distance += l[i];
      const double s = scale[i] * scale[j];
      ops.mass(i, j) = ops.mass(j, i) = s * (mass.second + distance * mass.first);
      ops.gyroscopic(i, j) = s * sqrt_beta * distance * beyond;
      ops.gyroscopic(j, i) = -ops.gyroscopic(i, j);
      ops.end_flux(i, j) = ops.end_flux(j, i) = s * sqrt_beta * (distance + beyond) * beyond;
      ops.flux(i, j) = s * distance;
      double moment = s * pipe_.gamma * mass.first;
      if (loaded) {
        moment += s * (stiffness.second + distance * stiffness.first + held + turning);
        ops.damping(i, j) = ops.damping(j, i) = s * (damping.second + distance * damping.first);
      }
      ops.stiffness(i, j) = ops.stiffness(j, i) = moment;
      if (loaded && i < j) ops.stiffness(i, j) += s * distance * turned;
    }
    const double elastic = spring[j] * scale[j] * scale[j];
    ops.stiffness(j, j) += elastic;
    ops.damping(j, j) += pipe_.damping * elastic;
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
    out.row(k) = mass_[k] * (carry + chi[k] * l[k] * x.row(k));  // inertia force of segment k
    carry += l[k] * x.row(k);
  }
  carry.setZero();  // inertia force of all beyond segment k
  Eigen::RowVectorXd force(x.cols());
  for (Index k = n - 1; k >= 0; --k) {
    force = out.row(k);
    out.row(k) = l[k] * carry + chi[k] * l[k] * force + mass_[k] * eta[k] * eta[k] * x.row(k);
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

Matrix Chain::terms_stiffness_times(const Matrix& x) const { return loads_times(x, true); }

Matrix Chain::terms_damping_times(const Matrix& x) const { return loads_times(x, false); }

Matrix Chain::loads_times(const Matrix& x, bool by_position) const {
  const Index n = dof();
  require_rows(x.rows(), n);
  Matrix out = Matrix::Zero(n, x.cols());
  if (loads_.empty()) return out;
  const Vector& l = segments_.length;
  Matrix force(n, x.cols());
  Eigen::RowVectorXd carry = Eigen::RowVectorXd::Zero(x.cols());  // displacement of joint k
  for (Index k = 0; k < n; ++k) {
    const auto& [stiffness, damping, turned, held] = linear_loads_[static_cast<std::size_t>(k)];
    const Moments& own = by_position ? stiffness : damping;
    force.row(k) = own.zeroth * carry + own.first * x.row(k);
    out.row(k) = own.first * carry + own.second * x.row(k);
    if (by_position) {
      force.row(k) += turned[0] * x.row(k);
      out.row(k) += (turned[1] + held) * x.row(k);
    }
    carry += l[k] * x.row(k);
  }
  carry.setZero();  // force on all beyond segment k
  for (Index k = n - 1; k >= 0; --k) {
    out.row(k) += l[k] * carry;
    carry += force.row(k);
  }
  return out;
}

Matrix Chain::bodies() const {
  Matrix out(dof(), 3);
  out << mass_, segments_.center, segments_.gyration_radius;
  return out;
}

Matrix Chain::resistances() const {
  Matrix out = Matrix::Zero(dof(), 7);
  for (std::size_t j = 0; j < linear_loads_.size(); ++j) {
    const auto& [k, c, turned, held] = linear_loads_[j];
    out.row(static_cast<Index>(j)) << k.zeroth, k.first, k.second, c.zeroth, c.first, c.second,
        turned[1] + held;
  }
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
    at(moment_row, theta) = inertia * mass_[j] * (arm * arm + eta[j] * eta[j]) +
                            coriolis * l[j] * l[j] - thrust * l[j] + pipe_.gamma * first_moment_[j];
    at(moment_row, force) = l[j];
    at(force_row, force) = 1.0;
    if (j > 0) {
      at(angle_row, theta - 4) = -1.0;
      at(node_row, w - 4) = -1.0;
      at(moment_row, w - 4) = inertia * mass_[j] * arm;
    }
    if (j + 1 < n) {
      at(moment_row, phi + 4) = -elastic * spring[j + 1];
      at(force_row, force + 4) = -1.0;
      at(force_row, w) = -inertia * mass_[j + 1];
      at(force_row, theta + 4) =
          -inertia * chi[j + 1] * l[j + 1] * mass_[j + 1] - 2.0 * coriolis * l[j + 1];
    } else {
      at(force_row, theta) = -thrust;
    }
    if (loads_.empty()) continue;
    const auto& [k, c, turned, held] = linear_loads_[static_cast<std::size_t>(j)];
    at(moment_row, theta) += k.second + lambda * c.second + turned[1] + held;
    if (j == 0) continue;  // the first joint stands still, and so does the force beyond nothing
    at(moment_row, w - 4) += k.first + lambda * c.first;
    at(force_row - 4, w - 4) -= k.zeroth + lambda * c.zeroth;
    at(force_row - 4, theta) -= k.first + lambda * c.first + turned[0];
  }
  return band;
}

MotionModel Chain::motion() const {
  return {.links = links_.data(),
          .size = dof(),
          .base = segments_.base,
          .gravity = pipe_.gamma,
          .damping = pipe_.damping,
          .coriolis = pipe_.direction() * pipe_.sqrt_beta(),
          .centrifugal = pipe_.centrifugal,
          .drag = pipe_.drag != 0.0,
          .loads = loads_.data(),
          .load_count = static_cast<std::ptrdiff_t>(loads_.size())};
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
