// SPDX-License-Identifier: MIT
#include "pipedyn/modular/scene.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <stdexcept>
#include <string>
#include <utility>

#include "pipedyn/vector/levels.hpp"

namespace pipedyn {

namespace {

/// Sines and cosines of angles, with more rows as room for whole packs.
void turn(const Matrix& theta, Matrix& sine, Matrix& cosine) {
  sine.setZero(theta.rows() + 7, theta.cols());
  sine.topRows(theta.rows()) = theta;
  cosine.resizeLike(sine);
  motion_kernel().sincos(sine.data(), theta.size(), sine.data(), cosine.data());
}

void require(const char* name, Index size, Index expected) {
  if (size != expected) {
    throw std::invalid_argument(std::string(name) + " must have " + std::to_string(expected) +
                                " entries, got " + std::to_string(size));
  }
}

constexpr double no_flow = 0.0;

/// Solves s mu = right for one member by symmetric elimination and replaces right by mu. Rows
/// without a pivot depend on others: they are returned, and their mu is 0.
std::vector<Index> solve_member(Matrix& s, Matrix& right) {
  // Smallest pivots: relative to a row's own diagonal, a share 1e-16 of which rounding leaves in a
  // dependent row; and relative to the largest diagonal.
  constexpr double redundant = 1e-12;
  constexpr double smallest = 1e-20;
  const Index count = s.rows();
  thread_local Vector diagonal;
  thread_local std::vector<Index> order;  // eliminated rows, then from `left` on the others
  diagonal = s.diagonal();
  const double least = smallest * diagonal.cwiseAbs().maxCoeff();
  order.resize(static_cast<std::size_t>(count));
  std::iota(order.begin(), order.end(), 0);
  auto left = order.begin();
  for (; left != order.end(); ++left) {
    auto best = order.end();
    double most = 0.0;
    for (auto i = left; i != order.end(); ++i) {
      const double pivot = s(*i, *i);
      if (pivot > least && pivot > redundant * diagonal[*i] && pivot / diagonal[*i] > most) {
        most = pivot / diagonal[*i];
        best = i;
      }
    }
    if (best == order.end()) break;  // the remaining rows depend on others
    const Index row = *best;
    std::rotate(left, best, best + 1);
    for (auto i = left + 1; i != order.end(); ++i) {
      const double factor = s(*i, row) / s(row, row);
      for (auto j = left + 1; j != order.end(); ++j) s(*i, *j) -= factor * s(row, *j);
      right.row(*i) -= factor * right.row(row);
    }
  }
  for (auto row = left; row != order.end(); ++row) right.row(*row).setZero();
  for (auto row = left; row-- != order.begin();) {
    for (auto later = row + 1; later != left; ++later) {
      right.row(*row) -= s(*row, *later) * right.row(*later);
    }
    right.row(*row) /= s(*row, *row);
  }
  return {left, order.end()};
}

}  // namespace

Scene::Scene(const Pipe& pipe, const Segments& segments, const std::vector<Index>& held,
             const Vector& value, const Matrix& inertia, CustomForces customs)
    : length_(segments.length),
      base_(segments.base),
      customs_(std::move(customs)),
      chain_(pipe, segments),
      value_(value),
      compliance_(Vector::Zero(value.size() + inertia.rows())) {
  const Index count = row_count();
  if (count > 0 || customs_) inertia_ = chain_.without_forces();
  compliance_.tail(inertia.rows()).setOnes();
  Matrix weights = Matrix::Zero(count, coordinates());
  for (Index row = 0; row < value.size(); ++row) weights(row, held.at(row)) = 1.0;
  if (inertia.rows() > 0) weights.bottomRows(inertia.rows()) = inertia;
  across_ = along_ = joints_ = Matrix::Zero(count, dof());
  // Sums of the weights of the nodes beyond, and weights of the joint beyond.
  Vector x = Vector::Zero(count), y = x, angle = x;
  for (Index j = dof() - 1; j >= 0; --j) {
    x += weights.col(3 * j);
    y += weights.col(3 * j + 1);
    across_.col(j) = length_[j] * x;
    along_.col(j) = length_[j] * y;
    joints_.col(j) = weights.col(3 * j + 2) - angle;
    angle = weights.col(3 * j + 2);
  }
  origin_ = base_ * y;
}

// --------------------------------------------------------------------------------- coordinates

Matrix Scene::redundant(const Matrix& theta, const Matrix& omega) const {
  const Index n = dof(), size = coordinates(), members = theta.cols();
  Matrix sine, cosine;
  turn(theta, sine, cosine);
  Matrix states(2 * size, members);
  for (Index k = 0; k < members; ++k) {
    double x = 0.0, y = base_, vx = 0.0, vy = 0.0;
    for (Index j = 0; j < n; ++j) {
      const double l = length_[j], step = l * omega(j, k);
      states(3 * j, k) = x += l * sine(j, k);
      states(3 * j + 1, k) = y += l * cosine(j, k);
      states(3 * j + 2, k) = theta(j, k) - (j > 0 ? theta(j - 1, k) : 0.0);
      states(size + 3 * j, k) = vx += step * cosine(j, k);
      states(size + 3 * j + 1, k) = vy -= step * sine(j, k);
      states(size + 3 * j + 2, k) = omega(j, k) - (j > 0 ? omega(j - 1, k) : 0.0);
    }
  }
  return states;
}

Matrix Scene::angles(const Batch& states) const {
  const Index n = dof(), members = states.members;
  const Eigen::Map<const Matrix> y(states.y, 6 * n, members);
  Matrix made(2 * n, members);
  for (Index j = 0; j < 2 * n; ++j) {
    made.row(j) = y.row(3 * j + 2);
    if (j % n != 0) made.row(j) += made.row(j - 1);
  }
  return made;
}

void Scene::set_rows(const Matrix& theta, Rows& rows) const {
  const Index n = dof(), members = theta.cols(), count = row_count();
  turn(theta, rows.sine, rows.cosine);
  rows.by_angles.resize(n, count * members);
  rows.turning.resize(n, count * members);
  for (Index j = 0; j < n; ++j) {
    const double* const sine = rows.sine.data() + j * members;
    const double* const cosine = rows.cosine.data() + j * members;
    for (Index i = 0; i < count; ++i) {
      const double x = across_(i, j), y = along_(i, j), own = joints_(i, j);
      double* const by_angle = rows.by_angles.data() + (j * count + i) * members;
      double* const turning = rows.turning.data() + (j * count + i) * members;
      for (Index k = 0; k < members; ++k) {
        turning[k] = -x * sine[k] - y * cosine[k];
        by_angle[k] = own + x * cosine[k] - y * sine[k];
      }
    }
  }
}

// -------------------------------------------------------------------------------------- motion

Matrix Scene::custom(const char* what, const Batch& batch) const {
  const Eigen::Map<const Matrix> y(batch.y, 2 * dof(), batch.members);
  return customs_(what, redundant(y.topRows(dof()), y.bottomRows(dof())));
}

Batch Scene::loaded(Batch batch, Matrix& moments) const {
  if (customs_) {
    moments = custom("moments", batch);
    batch.moments = moments.data();
  }
  return batch;
}

std::vector<Index> Scene::enforce(const Matrix& theta, Rows& rows, double rate, const double* omega,
                                  double* acceleration, Index stride) const {
  const Index n = dof(), members = theta.cols(), count = row_count();
  const Index columns = count * members;
  set_rows(theta, rows);
  rows.still.setZero(2 * n, columns);
  rows.still.topRows(n) = theta.replicate(1, count);
  rows.response.resize(2 * n, columns);
  inertia_->rhs({rows.still.data(), &no_flow, columns, 0, rows.by_angles.data()},
                rows.response.data());
  using Rates = Eigen::Map<Matrix, 0, Eigen::OuterStride<>>;
  const Eigen::Map<const Matrix, 0, Eigen::OuterStride<>> w(omega, n, members, {stride});
  Rates rates(acceleration, n, members, {stride});
  const auto of = [&](const Matrix& all, Index row) {
    return all.bottomRows(n).middleCols(row * members, members).array();
  };
  rows.products.resize(count * count, members);
  rows.forces.resize(count, members);
  for (Index i = 0; i < count; ++i) {
    const bool held = i < value_.size();
    const double k = held ? rate : 0.0;
    const double place = held ? k * k * (value_[i] - origin_[i]) : 0.0;
    const auto own = of(rows.by_angles, i), turning = of(rows.turning, i);
    const auto change =
        own * (rates.array() + 2.0 * k * w.array()) + turning * (w.array().square() - k * k);
    rows.forces.row(i) = place - change.colwise().sum();
    for (Index other = 0; other <= i; ++other) {
      auto product = rows.products.row(i * count + other);
      product = (own * of(rows.response, other)).colwise().sum();
      rows.products.row(other * count + i) = product;
    }
    rows.products.row(i * count + i).array() += compliance_[i];
  }
  std::vector<Index> idle;
  thread_local Matrix system, forces;
  for (Index m = 0; m < members; ++m) {
    system = rows.products.col(m).reshaped<Eigen::RowMajor>(count, count);
    forces = rows.forces.col(m);
    idle = solve_member(system, forces);
    rows.forces.col(m) = forces;
  }
  for (Index i = 0; i < count; ++i) {
    rates.array() += of(rows.response, i).rowwise() * rows.forces.row(i).array();
  }
  return idle;
}

void Scene::add_rows(const Batch& batch, double rate, double* rates) const {
  const Index n = dof(), members = batch.members, count = row_count();
  if (count == 0) return;
  constexpr Index most = 64;  // columns of X at once: whole packs, and small enough for the cache
  const Index block = std::max<Index>(1, most / count), below = n * members;
  const Eigen::Map<const Matrix> angles(batch.y, n, members);
  thread_local Matrix theta;
  thread_local Rows rows;
  for (Index first = 0; first < members; first += block) {
    theta = angles.middleCols(first, std::min(block, members - first));
    enforce(theta, rows, rate, batch.y + below + first, rates + below + first, members);
  }
}

void Scene::rhs(const Batch& batch, double* rates) const {
  Matrix moments;
  chain_.rhs(loaded(batch, moments), rates);
  add_rows(batch, return_rate, rates);
}

void Scene::rhs_and_power(const Batch& batch, double* rates) const {
  Matrix moments;
  chain_.rhs_and_power(loaded(batch, moments), rates);
  if (customs_) {
    Eigen::Map<Vector>(rates + 2 * dof() * batch.members, batch.members) +=
        custom("work", batch).reshaped();
  }
  add_rows(batch, return_rate, rates);
}

void Scene::redundant_rhs(const Batch& states, double* rates) const {
  const Index n = dof(), size = coordinates(), members = states.members;
  const Matrix y = angles(states);
  Matrix turning(2 * n, members), moments;
  Batch batch = states;
  batch.y = y.data();
  chain_.rhs(loaded(batch, moments), turning.data());
  add_rows(batch, 0.0, turning.data());
  // Along a segment, theta'^2 accelerates as theta'' does across it: turned by a right angle.
  const Matrix across = redundant(y.topRows(n), turning.bottomRows(n));
  const Matrix squares = redundant(y.topRows(n), y.bottomRows(n).cwiseAbs2());
  Eigen::Map<Matrix> out(rates, 2 * size, members);
  out.topRows(size) = Eigen::Map<const Matrix>(states.y, 2 * size, members).bottomRows(size);
  out.bottomRows(size) = across.bottomRows(size);
  for (Index x = size; x < 2 * size; x += 3) {
    out.row(x) += squares.row(x + 1);
    out.row(x + 1) -= squares.row(x);
  }
}

void Scene::energy(const Batch& batch, double* out) const {
  chain_.energy(batch, out);
  if (customs_) Eigen::Map<Vector>(out, batch.members) += custom("energy", batch).reshaped();
  const Index n = dof();
  const Eigen::Map<const Matrix> y(batch.y, 2 * n, batch.members);
  if (compliance_.isZero(0.0)) return;
  Rows rows;
  set_rows(y.topRows(n), rows);
  for (Index row = 0; row < compliance_.size(); ++row) {
    if (compliance_[row] == 0.0) continue;
    const auto by_angles = rows.by_angles.middleCols(row * batch.members, batch.members);
    const Vector rates = by_angles.cwiseProduct(y.bottomRows(n)).colwise().sum();
    Eigen::Map<Vector>(out, batch.members) += 0.5 / compliance_[row] * rates.cwiseAbs2();
  }
}

void Scene::power(const Batch& batch, double* out) const {
  chain_.power(batch, out);
  if (!customs_) return;
  constexpr Index others = 3;
  Eigen::Map<Matrix>(out, 5, batch.members).row(others) +=
      custom("work", batch).reshaped().transpose();
}

Matrix Scene::solve(const Matrix& theta, const Matrix& moments) const {
  const Index n = dof(), columns = theta.cols();
  Matrix still = Matrix::Zero(2 * n, columns), found(2 * n, columns);
  still.topRows(n) = theta;
  inertia_->rhs({still.data(), &no_flow, columns, 0, moments.data()}, found.data());
  return found.bottomRows(n);
}

// ---------------------------------------------------------------------------------- derivative

Scene::Linear Scene::linearised(const Batch& one, double rate) const {
  const Index n = dof(), count = row_count();
  Linear made;
  Matrix moments;
  const Batch all = loaded(one, moments);
  if (customs_) made.moments = moments.col(0);
  if (count == 0) return made;
  const Eigen::Map<const Vector> theta(one.y, n), omega(one.y + n, n);
  Vector rates(2 * n);
  chain_.rhs(all, rates.data());
  Rows rows;
  const std::vector<Index> idle = enforce(theta, rows, rate, omega.data(), rates.data() + n, 1);
  const auto acceleration = rates.tail(n);
  if (made.moments.size() == 0) made.moments = Vector::Zero(n);
  made.moments += rows.by_angles.lazyProduct(rows.forces);
  made.slopes = rows.turning.lazyProduct(rows.forces);

  const Index size = count - static_cast<Index>(idle.size());
  made.r = Matrix(size, n);
  made.e = Matrix(size, 2 * n);
  made.x = Matrix(n, size);
  made.compliance = Vector(size);
  Index z = 0;
  for (Index i = 0; i < count; ++i) {
    if (std::find(idle.begin(), idle.end(), i) != idle.end()) continue;
    const double k = i < value_.size() ? rate : 0.0;
    const Vector own = rows.by_angles.col(i), turning = rows.turning.col(i);
    const Vector curved = joints_.row(i).transpose() - own;
    made.r.row(z) = own;
    made.e.row(z) << (turning.cwiseProduct(acceleration + 2.0 * k * omega) +
                      curved.cwiseProduct(omega.cwiseAbs2()) + k * k * own)
                         .transpose(),
        (2.0 * (turning.cwiseProduct(omega) + k * own)).transpose();
    made.x.col(z) = rows.response.col(i).tail(n);
    made.compliance[z] = compliance_[i];
    ++z;
  }
  return made;
}

void Scene::linearise(const Batch& batch, double* out) const {
  const Index rows = 2 * dof(), members = batch.members;
  Vector speeds(members), steps(members);
  for (Index k = 0; k < members; ++k) {
    speeds[k] = batch.u[k * batch.u_step];
    steps[k] = speeds[k] > 0.0 ? 0.5 * speeds[k] : 1.0;
  }
  std::array<Matrix, 3> rates;
  Batch faster = batch;
  faster.u = speeds.data();
  faster.u_step = 1;
  for (Matrix& of : rates) {
    of.resize(rows, members);
    rhs(faster, of.data());
    speeds += steps;
  }
  Matrix slopes(members * rows, rows);
  jacobian(batch, slopes.data());
  for (Index k = 0; k < members; ++k) {
    Eigen::Map<Matrix> own(out + k * (2 + rows) * rows, 2 + rows, rows);
    own.row(0) = rates[0].col(k).transpose();
    // The rates are of second degree in the speed.
    own.row(1) =
        (2.0 * rates[1].col(k) - 0.5 * rates[2].col(k) - 1.5 * rates[0].col(k)).transpose();
    own.row(1) /= steps[k];
    own.bottomRows(rows) = slopes.middleRows(k * rows, rows);
  }
}

void Scene::derivative(const Batch& batch, double rate, double* out) const {
  if (row_count() == 0 && !customs_) return chain_.jacobian(batch, out);
  const Index n = dof(), rows = 2 * n, members = batch.members;
  const auto column = [members](const double* of, Index size, Index k) -> Vector {
    return Eigen::Map<const Matrix>(of, size, members).col(k);
  };
  for (Index k = 0; k < members; ++k) {
    const Vector y = column(batch.y, rows, k);
    Vector drive;
    if (batch.drive != nullptr) drive = column(batch.drive, batch.drive_rows, k);
    const auto or_none = [](const Vector& of) { return of.size() > 0 ? of.data() : nullptr; };
    Batch one{y.data(), batch.u + k * batch.u_step, 1, 0};
    one.drive = or_none(drive);
    one.drive_rows = batch.drive_rows;
    const Linear about = linearised(one, rate);
    one.moments = or_none(about.moments);
    one.slopes = or_none(about.slopes);
    Eigen::Map<Matrix> whole(out + k * rows * rows, rows, rows);
    chain_.jacobian(one, whole.data());
    auto accelerations = whole.bottomRows(n);
    if (customs_) accelerations += solve(y.head(n).replicate(1, rows), custom("slopes", one));
    if (row_count() == 0) continue;
    Matrix system = about.r * about.x;
    system.diagonal() += about.compliance;
    const Matrix free = accelerations;
    Matrix z = about.r * free;
    z += about.e;
    solve_member(system, z);
    const Matrix held = about.x * z;
    accelerations -= held;
  }
}

// ------------------------------------------------------------------------------- guides and pins

double Scene::project_one(Vector& theta, Vector& omega) const {
  constexpr double longest = 0.5;  // largest turn in a step, rad, so that no segment turns over
  constexpr int most_steps = 100;
  const Index held = value_.size();
  Vector closest = theta;
  double least_missed = std::numeric_limits<double>::infinity();
  Rows rows;
  for (int step = 0; step < most_steps; ++step) {
    set_rows(theta, rows);
    const auto by_angles = rows.by_angles.leftCols(held);
    Matrix system = by_angles.transpose().lazyProduct(by_angles);
    Matrix lacking(held, 2);  // distance of each held coordinate from its value, and its rate
    lacking << origin_.head(held) - value_ -
                   rows.turning.leftCols(held).colwise().sum().transpose(),
        by_angles.transpose().lazyProduct(omega);
    const double missed = lacking.col(0).cwiseAbs().maxCoeff();
    if (missed < least_missed) {
      least_missed = missed;
      closest = theta;
    }
    solve_member(system, lacking);
    const Matrix change = by_angles.lazyProduct(lacking);  // the change of least norm
    if (missed <= met) {
      omega -= change.col(1);
      break;
    }
    const double turn = change.col(0).cwiseAbs().maxCoeff();
    if (!(turn > 0.0)) break;
    theta -= std::min(1.0, longest / turn) * change.col(0);
  }
  theta = closest;
  return least_missed;
}

Vector Scene::project(Matrix& theta, Matrix& omega) const {
  require("theta", theta.rows(), dof());
  require("omega", omega.rows(), dof());
  require("a row of omega", omega.cols(), theta.cols());
  Vector missed = Vector::Zero(theta.cols());
  for (Index k = 0; k < theta.cols() && value_.size() > 0; ++k) {
    Vector angles = theta.col(k), rates = omega.col(k);
    missed[k] = project_one(angles, rates);
    theta.col(k) = angles;
    omega.col(k) = rates;
  }
  return missed;
}

}  // namespace pipedyn
