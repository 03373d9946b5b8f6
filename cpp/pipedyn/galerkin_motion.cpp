// SPDX-License-Identifier: MIT
#include "pipedyn/galerkin_motion.hpp"

#include <Eigen/Cholesky>
#include <cstdint>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>

namespace pipedyn {

namespace {

using Map = Eigen::Map<const Vector>;
using Strided = Eigen::Map<const Vector, 0, Eigen::InnerStride<>>;

/// Scratch of a block's states and of the kernel, grown when needed.
class Scratch {
 public:
  double* ensure(std::size_t count) {
    if (memory_.size() < count + 8) memory_.resize(count + 8);
    const auto address = reinterpret_cast<std::uintptr_t>(memory_.data());
    return memory_.data() + (64 - address % 64) % 64 / sizeof(double);
  }

 private:
  std::vector<double> memory_;
};

std::size_t size_of(Index count) { return static_cast<std::size_t>((count + 7) / 8 * 8); }

/// Angle, rate and the frame t, n at a level's points.
struct Frame {
  Vector omega, sine, cosine;
  Matrix velocity;  // (points, 2)
  Vector normal;    // v_n
  Vector weight;    // signed weights, (nodes,)
  Matrix turning;   // n omega at the nodes
  Vector scratch;

  template <class Amplitudes, class Rates>
  void set(const Level& level, const Amplitudes& q, const Rates& rate) {
    sine.noalias() = level.slope() * q;
    omega.noalias() = level.slope() * rate;
    cosine = sine.array().cos();
    sine = sine.array().sin();
  }

  void set_velocity(const Level& level) {
    const Index nodes = level.nodes();
    turning.resize(nodes, 2);
    turning.col(0) = cosine.head(nodes).cwiseProduct(omega.head(nodes));
    turning.col(1) = -sine.head(nodes).cwiseProduct(omega.head(nodes));
    velocity.noalias() = level.integral() * turning;
  }

  void set_drag(const Level& level) {
    normal = cosine.cwiseProduct(velocity.col(0)) - sine.cwiseProduct(velocity.col(1));
    weight.resize(level.nodes());
    scratch.resize(3 * level.nodes());
    signed_weights(level.tables(), normal.data(), 1, scratch.data(), weight.data());
  }
};

/// Derivatives of the position, integral of n Theta_i, at a level's points, by component; slopes
/// (points, m) holds the Theta_i.
template <class Slopes>
void set_position_derivatives(const Level& level, const Frame& frame, const Slopes& slopes,
                              Matrix& integrand, Matrix& x, Matrix& y) {
  const Index nodes = level.nodes();
  const auto slope = slopes.topRows(nodes);
  integrand.noalias() = frame.cosine.head(nodes).asDiagonal() * slope;
  x.noalias() = level.integral() * integrand;
  integrand.noalias() = -(frame.sine.head(nodes).asDiagonal() * slope);
  y.noalias() = level.integral() * integrand;
}

}  // namespace

GalerkinMotion::GalerkinMotion(const Pipe& pipe, Basis basis, Index least_nodes)
    : pipe_(pipe), levels_(std::move(basis), pipe.drag != 0.0, least_nodes) {}

MotionEffects GalerkinMotion::effects() const {
  return {.coriolis = 2.0 * pipe_.direction() * pipe_.sqrt_beta(),
          .centrifugal = pipe_.centrifugal(),
          .gamma = pipe_.gamma,
          .drag = pipe_.drag,
          .damping = pipe_.damping};
}

Index GalerkinMotion::nodes(const Vector& q) const {
  return levels_[levels_.choose(q.data(), 1)].nodes();
}

void GalerkinMotion::rhs(Index members, const double* y, const double* u, Index u_stride,
                         double* out) const {
  static thread_local Scratch scratch;
  static thread_local std::vector<Index> level_of, chosen;
  const Index m = dof();
  const MotionEffects effects = this->effects();
  std::copy(y + m * members, y + 2 * m * members, out);
  if (members == 1) {
    const Level& level = levels_[levels_.choose(y, 1)];
    double* work = scratch.ensure(size_of(work_size(level.tables(), 1)));
    accelerations(level.tables(), effects, 1, y, y + m, u, work, out + m);
    return;
  }
  level_of.resize(static_cast<std::size_t>(members));
  Index lowest = levels_.count(), highest = 0;
  for (Index k = 0; k < members; ++k) {
    const Index number = levels_.choose(y + k, members);
    level_of[static_cast<std::size_t>(k)] = number;
    lowest = std::min(lowest, number);
    highest = std::max(highest, number);
  }
  constexpr Index width = block_width;
  for (Index number = lowest; number <= highest; ++number) {
    chosen.clear();
    for (Index k = 0; k < members; ++k) {
      if (level_of[static_cast<std::size_t>(k)] == number) chosen.push_back(k);
    }
    if (chosen.empty()) continue;
    const Level& level = levels_[number];
    const std::size_t block = size_of(m * width);
    double* q =
        scratch.ensure(3 * block + size_of(width) + size_of(work_size(level.tables(), width)));
    double *rate = q + block, *acceleration = rate + block, *speed = acceleration + block;
    double* work = speed + size_of(width);
    const Index count = static_cast<Index>(chosen.size());
    for (Index first = 0; first < count; first += width) {
      Index member[width];  // those beyond the last repeat it
      for (Index b = 0; b < width; ++b) {
        member[b] = chosen[static_cast<std::size_t>(std::min(first + b, count - 1))];
        speed[b] = u[member[b] * u_stride];
      }
      for (Index i = 0; i < m; ++i) {
        const double *amplitudes = y + i * members, *rates = y + (m + i) * members;
        for (Index b = 0; b < width; ++b) {
          q[i * width + b] = amplitudes[member[b]];
          rate[i * width + b] = rates[member[b]];
        }
      }
      accelerations(level.tables(), effects, width, q, rate, speed, work, acceleration);
      for (Index i = 0; i < m; ++i) {
        double* row = out + (m + i) * members;
        for (Index b = 0; b < width; ++b) row[member[b]] = acceleration[i * width + b];
      }
    }
  }
}

void GalerkinMotion::jacobian(const double* y, double u, double* out) const {
  struct Workspace {  // each of one shape, so that it is allocated once
    Scratch kernel;
    Frame frame;
    Matrix integrand, x, y, along, across, sum_x, sum_y, sum_along, sum_across;
    Matrix by_angle, by_rate, by_drag, turn, weighted, force, mass, elastic, dragged, system;
    Vector acceleration, spin, pressure, factor;
    Eigen::LLT<Matrix> factors;
  };
  static thread_local Workspace work;
  auto& [kernel, frame, integrand, jx, jy, along, across, sum_x, sum_y, sum_along, sum_across,
         by_angle, by_rate, by_drag, turn, weighted, force, mass, elastic, dragged, system,
         acceleration, spin, pressure, factor, factors] = work;
  const Index m = dof();
  const Map q(y, m), rate(y + m, m);
  const Level& level = levels_[levels_.choose(y, 1)];
  const Index nodes = level.nodes(), points = nodes + 1;
  const Matrix& slope = level.slope();
  const Vector& weight = level.rule().weight;
  const MotionEffects effects = this->effects();
  const double coriolis = effects.coriolis * u, thrust = effects.centrifugal * u * u;
  const bool drags = effects.drag != 0.0;

  acceleration.resize(m);
  accelerations(level.tables(), effects, 1, y, y + m, &u,
                kernel.ensure(size_of(work_size(level.tables(), 1))), acceleration.data());
  frame.set(level, q, rate);
  const auto orthonormal = level.orthonormal().leftCols(m);
  set_position_derivatives(level, frame, orthonormal, integrand, jx, jy);
  const auto s = frame.sine.array(), c = frame.cosine.array(), omega = frame.omega.array();
  spin.noalias() = slope * acceleration;  // second derivative of the angle

  // Load per node, times its weight: inertia less the forces; at the end the follower force.
  turn.resize(nodes, 2);
  turn.col(0) = (c * spin.array() - s * omega.square()).head(nodes);
  turn.col(1) = (-s * spin.array() - c * omega.square()).head(nodes);
  force.noalias() = level.integral() * turn;
  if (coriolis != 0.0) {
    force.col(0).array() += coriolis * omega * c;
    force.col(1).array() -= coriolis * omega * s;
  }
  if (effects.gamma != 0.0) force.col(1).array() -= effects.gamma;
  force.topRows(nodes).array().colwise() *= weight.array();
  if (drags) {
    frame.set_velocity(level);
    frame.set_drag(level);
    pressure = effects.drag * frame.weight.array() * frame.normal.head(nodes).array().square();
    force.topRows(nodes).col(0).array() += pressure.array() * c.head(nodes);
    force.topRows(nodes).col(1).array() -= pressure.array() * s.head(nodes);
  }
  force(nodes, 0) = thrust * s[nodes];
  force(nodes, 1) = thrust * c[nodes];
  weighted.noalias() = level.integral().transpose() * force;  // sum of the loads beyond, weighted

  // Virtual displacements along t and n, and what is beyond of them.
  along = jx.array().colwise() * s + jy.array().colwise() * c;
  across = jx.array().colwise() * c - jy.array().colwise() * s;
  const auto within = level.integral().topRows(nodes).transpose();
  integrand.noalias() = weight.asDiagonal() * jx.topRows(nodes);
  sum_x.noalias() = within * integrand;
  mass.noalias() = integrand.transpose() * jx.topRows(nodes);
  integrand.noalias() = weight.asDiagonal() * jy.topRows(nodes);
  sum_y.noalias() = within * integrand;
  mass.noalias() += integrand.transpose() * jy.topRows(nodes);
  const auto s_in = s.head(nodes), c_in = c.head(nodes), omega_in = omega.head(nodes);
  sum_along = sum_x.array().colwise() * s_in + sum_y.array().colwise() * c_in;
  sum_across = sum_x.array().colwise() * c_in - sum_y.array().colwise() * s_in;

  // Row i of the derivatives is the sum over points of these times Theta_j.
  const auto times = [&factor = factor](const auto& expression) {  // no temporary in a broadcast
    factor = expression;
    return factor.array();
  };
  by_angle.resize(points, m);
  by_angle.row(nodes) = thrust * across.row(nodes);
  auto angle = by_angle.topRows(nodes).array();
  angle = orthonormal.topRows(nodes).array().colwise() *
          times(-s_in * weighted.col(0).array() - c_in * weighted.col(1).array());
  angle -= sum_along.array().colwise() * spin.head(nodes).array();
  angle -= sum_across.array().colwise() * times(omega_in.square());
  by_rate = sum_along.array().colwise() * times(-2.0 * omega_in);
  if (coriolis != 0.0) {
    angle -= along.topRows(nodes).array().colwise() * times(coriolis * weight.array() * omega_in);
    by_rate.array() += across.topRows(nodes).array().colwise() * times(coriolis * weight.array());
  }
  system.resize(m, 2 * m);
  if (drags) {
    const auto v_n = frame.normal.head(nodes).array();
    const auto v_t =
        (s * frame.velocity.col(0).array() + c * frame.velocity.col(1).array()).head(nodes);
    by_drag = across.topRows(nodes).array().colwise() *
              times(2.0 * effects.drag * frame.weight.array() * v_n);
    angle -= by_drag.array().colwise() * times(v_t);
    angle -= along.topRows(nodes).array().colwise() * pressure.array();
    integrand = by_drag.array().colwise() * c_in;
    sum_x.noalias() = within * integrand;
    integrand = by_drag.array().colwise() * times(-s_in);
    sum_y.noalias() = within * integrand;
    angle -= sum_x.array().colwise() * times(s_in * omega_in);
    angle -= sum_y.array().colwise() * times(c_in * omega_in);
  }
  system.leftCols(m).noalias() = -by_angle.transpose() * slope;
  system.rightCols(m).noalias() = -by_rate.transpose() * slope.topRows(nodes);
  // Rows belong to orthonormal coordinates, columns to the basis.
  const Orthonormal& functions = levels_.orthonormal();
  const auto to_basis = functions.to_basis.triangularView<Eigen::Upper>();
  if (drags) {
    dragged.noalias() = by_drag.transpose() * across.topRows(nodes);
    system.rightCols(m).noalias() -= dragged * functions.inverse;
  }
  const Map stiffness(level.tables().stiffness, m);
  elastic.noalias() = functions.to_basis.transpose() * stiffness.asDiagonal();
  system.leftCols(m) -= elastic;
  if (effects.damping != 0.0) system.rightCols(m) -= effects.damping * elastic;
  factors.compute(mass);
  factors.solveInPlace(system);
  Eigen::Map<Matrix> result(out, 2 * m, 2 * m);
  result.topLeftCorner(m, m).setZero();
  result.topRightCorner(m, m).setIdentity();
  result.bottomRows(m).noalias() = to_basis * system;
  if (factors.info() != Eigen::Success) {
    result.bottomRows(m).setConstant(std::numeric_limits<double>::quiet_NaN());
  }
}

void GalerkinMotion::energy(Index members, const double* y, double* out) const {
  static thread_local Frame frame;
  const Index m = dof();
  for (Index k = 0; k < members; ++k) {
    const Strided q(y + k, m, Eigen::InnerStride<>(members));
    const Strided rate(y + m * members + k, m, Eigen::InnerStride<>(members));
    const Level& level = levels_[levels_.choose(y + k, members)];
    const Vector& weight = level.rule().weight;
    const Index nodes = level.nodes();
    frame.set(level, q, rate);
    frame.set_velocity(level);
    double energy = 0.5 * weight.dot(frame.velocity.topRows(nodes).rowwise().squaredNorm());
    energy += 0.5 * Map(level.tables().stiffness, m).dot(q.cwiseAbs2());
    if (pipe_.gamma != 0.0) {
      // s - y(s) integrated by parts; 1 - cos theta is written so that it keeps its digits.
      double height = 0.0;
      for (Index p = 0; p < nodes; ++p) {
        const double s = frame.sine[p], c = frame.cosine[p];
        const double rise = c > 0.0 ? s * s / (1.0 + c) : 1.0 - c;
        height += weight[p] * (1.0 - level.rule().node[p]) * rise;
      }
      energy += pipe_.gamma * height;
    }
    out[k] = energy;
  }
}

void GalerkinMotion::power(Index members, const double* y, const double* u, Index u_stride,
                           const PowerParts& out) const {
  static thread_local Frame frame;
  const Index m = dof();
  for (Index k = 0; k < members; ++k) {
    const Strided q(y + k, m, Eigen::InnerStride<>(members));
    const Strided rate(y + m * members + k, m, Eigen::InnerStride<>(members));
    const Level& level = levels_[levels_.choose(y + k, members)];
    const Index nodes = level.nodes();
    const double speed = u[k * u_stride];
    frame.set(level, q, rate);
    frame.set_velocity(level);
    const auto end = frame.velocity.row(nodes);
    out.flow[k] = -pipe_.direction() * pipe_.sqrt_beta() * speed * end.squaredNorm() -
                  pipe_.centrifugal() * speed * speed *
                      (frame.sine[nodes] * end[0] + frame.cosine[nodes] * end[1]);
    out.joints[k] = 0.0;
    if (pipe_.damping != 0.0) {
      out.joints[k] = -pipe_.damping * Map(level.tables().stiffness, m).dot(rate.cwiseAbs2());
    }
    out.drag[k] = 0.0;
    if (pipe_.drag != 0.0) {
      frame.set_drag(level);
      const auto normal = frame.normal.head(nodes).array();
      out.drag[k] = -pipe_.drag * (frame.weight.array() * normal.cube()).sum();
    }
  }
}

Operators GalerkinMotion::operators(const Vector& q) const {
  const Index m = dof();
  if (q.size() != m) {
    throw std::invalid_argument("q must have " + std::to_string(m) + " entries, got " +
                                std::to_string(q.size()));
  }
  const Level& level = levels_[levels_.choose(q.data(), 1)];
  const Index nodes = level.nodes();
  const auto weight = level.rule().weight.asDiagonal();
  const Matrix& slope = level.slope();
  const auto slope_in = slope.topRows(nodes);
  const Map stiffness(level.tables().stiffness, m);
  Frame frame;
  Matrix integrand, x, y;
  frame.set(level, q, Vector(Vector::Zero(m)));
  set_position_derivatives(level, frame, slope, integrand, x, y);
  const auto x_in = x.topRows(nodes), y_in = y.topRows(nodes);
  const auto s = frame.sine.head(nodes).array(), c = frame.cosine.head(nodes).array();
  Operators ops(m);
  ops.mass = x_in.transpose() * weight * x_in + y_in.transpose() * weight * y_in;
  const Matrix across = (x_in.array().colwise() * c - y_in.array().colwise() * s).matrix();
  const Matrix coriolis = across.transpose() * weight * slope_in;
  ops.gyroscopic = pipe_.sqrt_beta() * (coriolis - coriolis.transpose());
  const auto end_x = x.row(nodes), end_y = y.row(nodes);
  ops.end_flux = pipe_.sqrt_beta() * (end_x.transpose() * end_x + end_y.transpose() * end_y);
  const double end_s = frame.sine[nodes], end_c = frame.cosine[nodes];
  // J_i turns by -t Theta_i Theta_j: its projection on the end's tangent is that of two tangents.
  const Vector shortening = -(level.rule().weight.array() * (end_s * s + end_c * c)).matrix();
  ops.flux = (end_c * end_x - end_s * end_y).transpose() * slope.row(nodes) +
             slope_in.transpose() * shortening.asDiagonal() * slope_in;
  ops.damping.diagonal() = pipe_.damping * stiffness;
  if (pipe_.gamma != 0.0) {
    const Vector tension =
        pipe_.gamma * level.rule().weight.array() * (1.0 - level.rule().node.array()) * c;
    ops.stiffness = slope_in.transpose() * tension.asDiagonal() * slope_in;
  }
  ops.stiffness.diagonal() += stiffness;
  return ops;
}

}  // namespace pipedyn
