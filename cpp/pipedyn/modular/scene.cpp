// SPDX-License-Identifier: MIT
#include "pipedyn/modular/scene.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>

#include "pipedyn/vector/levels.hpp"

namespace pipedyn {

namespace {

/// Sine and cosine of every entry.
struct Turned {
  Matrix sine, cosine;

  explicit Turned(const Matrix& theta)
      : sine(theta.rows(), theta.cols()), cosine(theta.rows(), theta.cols()) {
    motion_kernel().sincos(theta.data(), theta.size(), sine.data(), cosine.data());
  }
};

void require(const char* name, Index size, Index expected) {
  if (size != expected) {
    throw std::invalid_argument(std::string(name) + " must have " + std::to_string(expected) +
                                " entries, got " + std::to_string(size));
  }
}

/// Whether the last segment turns without inertia: chains refuse one whose centre of mass and
/// radius of gyration are so near to its joint, in L, that its inertia is lost in the others'
/// rounding.
bool lacks_own_inertia(const Chain& chain, const Vector& length) {
  constexpr double least = 1e-8;
  const Index last = chain.dof() - 1;
  const Vector body = chain.bodies().row(last);
  return body[1] * length[last] + body[2] < least;
}

/// With a radius of gyration of its length for the last one.
Segments lend_inertia(Segments segments) {
  const Index last = segments.length.size() - 1;
  segments.gyration_radius[last] = segments.length[last];
  return segments;
}

/// Of one member: solves s mu = right by symmetric elimination, mu in place of right. Rows without
/// pivot among the first `positive` follow from others: these are returned, and mu is 0 there. NaN
/// where a later one has none.
std::vector<Index> solve_member(Matrix& s, Matrix& right, Index positive) {
  constexpr double redundant = 1e-12;  // of a pivot: rounding leaves 1e-16 of such a row's diagonal
  constexpr double smallest = 1e-20;   // and this against the largest diagonal
  constexpr double massless = 1e-10;   // of the inertia lent, which the diagonal is a share of
  const Index count = s.rows();
  const Vector diagonal = s.diagonal();
  const double least = smallest * diagonal.cwiseAbs().maxCoeff();
  std::vector<Index> order, left(static_cast<std::size_t>(count));
  for (Index i = 0; i < count; ++i) left[static_cast<std::size_t>(i)] = i;
  while (!left.empty()) {
    auto best = left.end();
    double most = 0.0;
    for (auto i = left.begin(); i != left.end() && *i < positive; ++i) {
      const double pivot = s(*i, *i);
      if (pivot > least && pivot > redundant * diagonal[*i] && pivot / diagonal[*i] > most) {
        most = pivot / diagonal[*i];
        best = i;
      }
    }
    // What is left of these follows from others.
    if (best == left.end()) best = std::lower_bound(left.begin(), left.end(), positive);
    if (best == left.end()) break;
    const Index row = *best;
    if (row >= positive && !(std::abs(s(row, row)) > massless)) {
      right.setConstant(std::numeric_limits<double>::quiet_NaN());
      return {};
    }
    left.erase(best);
    order.push_back(row);
    for (const Index other : left) {
      const double factor = s(other, row) / s(row, row);
      for (const Index column : left) s(other, column) -= factor * s(row, column);
      right.row(other) -= factor * right.row(row);
    }
  }
  for (const Index row : left) right.row(row).setZero();
  for (auto row = order.rbegin(); row != order.rend(); ++row) {
    for (auto later = order.rbegin(); later != row; ++later) {
      right.row(*row) -= s(*row, *later) * right.row(*later);
    }
    right.row(*row) /= s(*row, *row);
  }
  return left;
}

/// The same of several members, s of each in a column, by rows; what is idle of the last.
std::vector<Index> solve_rows(const Matrix& systems, Matrix& right, Index positive) {
  const Index size = right.rows();
  std::vector<Index> idle;
  for (Index k = 0; k < right.cols(); ++k) {
    Matrix system = systems.col(k).reshaped<Eigen::RowMajor>(size, size), column = right.col(k);
    idle = solve_member(system, column, positive);
    right.col(k) = column;
  }
  return idle;
}

/// Rows of numbers of some members, each `stride` after the one before.
struct Columns {
  const double* from;
  Index stride;

  explicit Columns(const Matrix& all, Index row = 0, Index members = 0)
      : from(all.data() + row * members), stride(all.cols()) {}
  const double* operator[](Index j) const { return from + j * stride; }
};

/// Adds factor times the sums over n rows of products, for so many members from `first` on.
template <Index count>
void add_some_products(const Columns& a, const Columns& b, double factor, Index n, Index first,
                       double* sums) {
  double own[count] = {};
  for (Index j = 0; j < n; ++j) {
    const double *x = a[j] + first, *y = b[j] + first;
    for (Index k = 0; k < count; ++k) own[k] += x[k] * y[k];
  }
  for (Index k = 0; k < count; ++k) sums[first + k] += factor * own[k];
}

void add_products(const Columns& a, const Columns& b, double factor, Index n, Index members,
                  double* sums) {
  constexpr Index some = 8;
  Index k = 0;
  for (; k + some <= members; k += some) add_some_products<some>(a, b, factor, n, k, sums);
  for (; k < members; ++k) add_some_products<1>(a, b, factor, n, k, sums);
}

/// Adds to each member its column of a, so many times.
void add_column(const Columns& a, const double* times, double factor, Matrix& sum) {
  for (Index j = 0; j < sum.rows(); ++j) {
    double* const row = sum.data() + j * sum.cols();
    for (Index k = 0; k < sum.cols(); ++k) row[k] += factor * times[k] * a[j][k];
  }
}

}  // namespace

Scene::Scene(const Pipe& pipe, const Segments& segments, const Matrix& inertia,
             const std::vector<Index>& held, const Vector& value)
    : length_(segments.length),
      base_(segments.base),
      lends_(lacks_own_inertia(Chain(pipe, segments), segments.length)),
      chain_(pipe, lends_ ? lend_inertia(segments) : segments),
      inertia_(chain_.without_forces()),
      held_from_(inertia.rows()),
      value_(value) {
  if (!(length_.minCoeff() > 0.0)) throw std::invalid_argument("length must be positive");
  require("value", value.size(), static_cast<Index>(held.size()));
  if (held_from_ > 0) require("a row of inertia", inertia.cols(), coordinates());
  const Index count = held_from_ + value.size() + (lends_ ? 1 : 0);
  weights_ = Matrix::Zero(count, coordinates());
  compliance_ = Vector::Zero(count);
  compliance_.head(held_from_).setOnes();
  if (held_from_ > 0) weights_.topRows(held_from_) = inertia;
  Index row = held_from_;
  for (const Index coordinate : held) {
    if (coordinate < 0 || coordinate >= coordinates() || coordinate % 3 == 2) {
      throw std::invalid_argument("what is held must be nodes' coordinates");
    }
    weights_(row++, coordinate) = 1.0;
  }
  if (lends_) {  // w . q is the angle, the sum of the joints'
    const double last = length_[dof() - 1];
    for (Index j = 0; j < dof(); ++j) weights_(row, 3 * j + 2) = std::sqrt(last * last * last);
    compliance_[row] = -1.0;
  }
  origin_ = Vector::Zero(count);
  across_ = along_ = joints_ = Matrix::Zero(count, dof());
  Vector x = Vector::Zero(count), y = x, angle = x;  // weights of nodes beyond, of the joint beyond
  for (Index j = dof() - 1; j >= 0; --j) {
    x += weights_.col(3 * j);
    y += weights_.col(3 * j + 1);
    across_.col(j) = length_[j] * x;
    along_.col(j) = length_[j] * y;
    joints_.col(j) = weights_.col(3 * j + 2) - angle;
    angle = weights_.col(3 * j + 2);
  }
  origin_ = base_ * y;
}

Matrix Scene::bodies() const {
  Matrix made = chain_.bodies();
  if (lends_) made(dof() - 1, 2) = 0.0;
  return made;
}

// --------------------------------------------------------------------------------- coordinates

Matrix Scene::redundant(const Matrix& theta, const Matrix& omega) const {
  const Index n = dof(), size = coordinates(), members = theta.cols();
  require("theta", theta.rows(), n);
  require("omega", omega.rows(), n);
  require("a row of omega", omega.cols(), members);
  const auto [sine, cosine] = Turned(theta);
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

Scene::Rows Scene::rows_at(const Matrix& theta) const {
  const auto [sine, cosine] = Turned(theta);
  const Index n = dof(), members = theta.cols(), count = compliance_.size();
  Rows made{Matrix(n, count * members), Matrix(n, count * members)};
  for (Index j = 0; j < n; ++j) {
    for (Index i = 0; i < count; ++i) {
      const double x = across_(i, j), y = along_(i, j), own = joints_(i, j);
      for (Index k = 0; k < members; ++k) {
        const double s = sine(j, k), c = cosine(j, k);
        made.turning(j, i * members + k) = -x * s - y * c;
        made.by_angles(j, i * members + k) = own + x * c - y * s;
      }
    }
  }
  return made;
}

// -------------------------------------------------------------------------------------- motion

Scene::Forces Scene::enforce(const Rows& rows, const Matrix& response, bool returns, Matrix& omega,
                             Matrix& acceleration) const {
  const Index n = dof(), members = omega.cols(), held = returns ? value_.size() : 0;
  const Index count = compliance_.size();
  const auto of = [&](const Matrix& all, Index row) { return Columns(all, row, members); };
  const auto own = [&](Index row) { return of(rows.by_angles, row); };
  const auto at = [&](Matrix& sums, Index row) { return sums.data() + row * members; };
  Forces found{Matrix::Zero(held, members), Matrix::Zero(count, members)};
  const Matrix given = omega;
  if (held > 0) {
    Matrix products = Matrix::Zero(held * held, members);
    for (Index i = 0; i < held; ++i) {
      const Index row = held_from_ + i;
      add_products(own(row), Columns(given), 1.0, n, members, at(found.lambda, i));
      found.mu.row(row) = -return_rate * found.lambda.row(i);
      found.lambda.row(i).array() += return_rate * (origin_[row] - value_[i]);
      found.lambda.row(i) -=
          return_rate * rows.turning.middleCols(row * members, members).colwise().sum();
      for (Index k = 0; k <= i; ++k) {
        add_products(own(row), own(held_from_ + k), 1.0, n, members, at(products, i * held + k));
        products.row(k * held + i) = products.row(i * held + k);
      }
    }
    found.idle_lambda = solve_rows(products, found.lambda, held);
    for (Index i = 0; i < held; ++i) {
      add_column(own(held_from_ + i), at(found.lambda, i), -1.0, omega);
    }
  }
  const Matrix turn = given.cwiseProduct(omega);
  Matrix products = Matrix::Zero(count * count, members);
  for (Index i = 0; i < count; ++i) {
    add_products(own(i), Columns(acceleration), -1.0, n, members, at(found.mu, i));
    add_products(of(rows.turning, i), Columns(turn), -1.0, n, members, at(found.mu, i));
    for (Index k = 0; k <= i; ++k) {
      add_products(own(i), of(response, k), 1.0, n, members, at(products, i * count + k));
      products.row(k * count + i) = products.row(i * count + k);
    }
    products.row(i * count + i).array() += compliance_[i];
  }
  found.idle_mu = solve_rows(products, found.mu, count - (lends_ ? 1 : 0));
  for (Index i = 0; i < count; ++i) add_column(of(response, i), at(found.mu, i), 1.0, acceleration);
  return found;
}

void Scene::add_rows(const Batch& batch, bool returns, double* rates) const {
  const Index n = dof(), members = batch.members, count = compliance_.size();
  if (count == 0) return;
  constexpr Index most = 64;  // columns of X at once: whole packs, and what they need is cached
  const Index block = std::max<Index>(1, most / count);
  const Eigen::Map<const Matrix> y(batch.y, 2 * n, members);
  Eigen::Map<Matrix> out(rates, 2 * n, members);
  for (Index first = 0; first < members; first += block) {
    const Index here = std::min(block, members - first);
    const Matrix theta = y.block(0, first, n, here);
    Matrix omega = y.block(n, first, n, here), acceleration = out.block(n, first, n, here);
    const Rows rows = rows_at(theta);
    enforce(rows, solve(theta.replicate(1, count), rows.by_angles), returns, omega, acceleration);
    out.block(0, first, n, here) = omega;
    out.block(n, first, n, here) = acceleration;
  }
}

void Scene::rhs(const Batch& batch, double* rates) const {
  chain_.rhs(batch, rates);
  add_rows(batch, false, rates);
}

void Scene::returning_rhs(const Batch& batch, double* rates) const {
  chain_.rhs(batch, rates);
  add_rows(batch, true, rates);
}

void Scene::rhs_and_power(const Batch& batch, double* rates) const {
  chain_.rhs_and_power(batch, rates);
  add_rows(batch, true, rates);
}

void Scene::redundant_rhs(const Batch& states, double* rates) const {
  const Index n = dof(), size = coordinates(), members = states.members;
  const Matrix y = angles(states);
  Matrix turning(2 * n, members);
  rhs({y.data(), states.u, members, states.u_step, states.moments}, turning.data());
  const auto [sine, cosine] = Turned(y.topRows(n));
  Eigen::Map<Matrix> out(rates, 2 * size, members);
  out.topRows(size) = Eigen::Map<const Matrix>(states.y, 2 * size, members).bottomRows(size);
  for (Index k = 0; k < members; ++k) {
    double x = 0.0, down = 0.0;
    for (Index j = 0; j < n; ++j) {
      const double l = length_[j], w = y(n + j, k), acceleration = turning(n + j, k);
      x += l * (acceleration * cosine(j, k) - w * w * sine(j, k));
      down -= l * (acceleration * sine(j, k) + w * w * cosine(j, k));
      out(size + 3 * j, k) = x;
      out(size + 3 * j + 1, k) = down;
      out(size + 3 * j + 2, k) = acceleration - (j > 0 ? turning(n + j - 1, k) : 0.0);
    }
  }
}

void Scene::energy(const Batch& batch, double* out) const {
  chain_.energy(batch, out);
  const Index n = dof();
  const Eigen::Map<const Matrix> y(batch.y, 2 * n, batch.members);
  if (compliance_.isZero(0.0)) return;
  const Matrix by_angles = rows_at(y.topRows(n)).by_angles, omega = y.bottomRows(n);
  for (Index row = 0; row < compliance_.size(); ++row) {
    if (compliance_[row] == 0.0) continue;
    Vector rates = Vector::Zero(batch.members);
    add_products(Columns(by_angles, row, batch.members), Columns(omega), 1.0, n, batch.members,
                 rates.data());
    Eigen::Map<Vector>(out, batch.members) += 0.5 / compliance_[row] * rates.cwiseAbs2();
  }
}

Matrix Scene::solve(const Matrix& theta, const Matrix& moments) const {
  const Index n = dof(), columns = theta.cols();
  require("theta", theta.rows(), n);
  require("moments", moments.rows(), n);
  require("a row of moments", moments.cols(), columns);
  Matrix still = Matrix::Zero(2 * n, columns), found(2 * n, columns);
  still.topRows(n) = theta;
  const double no_flow = 0.0;
  inertia_.rhs({still.data(), &no_flow, columns, 0, moments.data()}, found.data());
  return found.bottomRows(n);
}

// ---------------------------------------------------------------------------------- derivative

Scene::Linear Scene::linearised(const Batch& one, bool returns) const {
  const Index n = dof(), count = compliance_.size(), held = returns ? value_.size() : 0;
  Linear made;
  if (one.moments != nullptr) made.moments = Eigen::Map<const Vector>(one.moments, n);
  if (count == 0) return made;
  const Eigen::Map<const Vector> theta(one.y, n), omega(one.y + n, n);
  Matrix rates(2 * n, 1), turned = omega;
  chain_.rhs(one, rates.data());
  const Rows rows = rows_at(theta);
  const Matrix response = solve(theta.replicate(1, count), rows.by_angles);
  Matrix acceleration = rates.bottomRows(n);
  const Forces forces = enforce(rows, response, returns, turned, acceleration);
  if (made.moments.size() == 0) made.moments = Vector::Zero(n);
  made.moments += rows.by_angles.lazyProduct(forces.mu);
  made.slopes = rows.turning.lazyProduct(forces.mu);
  made.slowed = rows.turning.middleCols(held_from_, held).lazyProduct(forces.lambda);

  std::vector<bool> idle(static_cast<std::size_t>(held + count), false);
  for (const Index row : forces.idle_lambda) idle[static_cast<std::size_t>(row)] = true;
  for (const Index row : forces.idle_mu) idle[static_cast<std::size_t>(held + row)] = true;
  const Index size = std::count(idle.begin(), idle.end(), false);
  made.c = made.e = Matrix::Zero(size, 2 * n);
  made.b = Matrix::Zero(2 * n, size);
  made.compliance = Vector::Zero(size);
  Index z = 0;
  for (Index i = 0; i < held + count; ++i) {
    if (idle[static_cast<std::size_t>(i)]) continue;
    const bool of_place = i < held;
    const Index row = of_place ? held_from_ + i : i - held;
    const Vector own = rows.by_angles.col(row), turning = rows.turning.col(row);
    const Vector curved = joints_.row(row).transpose() - own;
    auto c = made.c.row(z).transpose(), e = made.e.row(z).transpose();
    if (of_place) {
      c.head(n) = own;
      e.head(n) = turning.cwiseProduct(turned);
      made.b.col(z).head(n) = own;
    } else {
      c << turning.cwiseProduct(omega), own;
      e.head(n) =
          turning.cwiseProduct(acceleration) + curved.cwiseProduct(turned.cwiseProduct(omega));
      e.tail(n) = turning.cwiseProduct(turned);
      made.b.col(z).tail(n) = response.col(row);
      made.compliance[z] = compliance_[row];
    }
    if (row >= held_from_ && row < held_from_ + held) e += return_rate * c;
    ++z;
  }
  return made;
}

void Scene::jacobian(const Batch& batch, bool returns, const Matrix& by_state, double* out) const {
  const Index n = dof(), rows = 2 * n, members = batch.members;
  const auto column = [members](const double* of, Index size, Index k) -> Vector {
    return Eigen::Map<const Matrix>(of, size, members).col(k);
  };
  for (Index k = 0; k < members; ++k) {
    const Vector y = column(batch.y, rows, k);
    Vector moments;
    if (batch.moments != nullptr) moments = column(batch.moments, n, k);
    const auto or_none = [](const Vector& of) { return of.size() > 0 ? of.data() : nullptr; };
    Batch one{y.data(), batch.u + k * batch.u_step, 1, 0, or_none(moments)};
    const Linear about = linearised(one, returns);
    one.moments = or_none(about.moments);
    one.slopes = or_none(about.slopes);
    Eigen::Map<Matrix> whole(out + k * rows * rows, rows, rows);
    chain_.jacobian(one, whole.data());
    if (by_state.size() > 0) {
      whole.bottomRows(n) += solve(y.head(n).replicate(1, rows), by_state);
    }
    if (compliance_.size() == 0) continue;
    whole.diagonal().head(n) -= about.slowed;
    Matrix system = about.c * about.b;
    system.diagonal() += about.compliance;
    const Matrix missing = about.c * whole + about.e;
    whole -= about.b * system.partialPivLu().solve(missing);
  }
}

// ------------------------------------------------------------------------------- guides and pins

double Scene::project_one(Vector& theta, Vector& omega) const {
  constexpr double longest = 0.5;  // rad a step, so that segments do not turn over
  constexpr int most_steps = 100;
  const Index held = value_.size();
  Vector closest = theta;
  double least_missed = std::numeric_limits<double>::infinity();
  for (int step = 0; step < most_steps; ++step) {
    const Rows rows = rows_at(theta);
    const auto by_angles = rows.by_angles.middleCols(held_from_, held);
    Matrix system = by_angles.transpose().lazyProduct(by_angles);
    Matrix lacking(held, 2);  // how far each coordinate is off its place, and its rate
    lacking << origin_.segment(held_from_, held) - value_ -
                   rows.turning.middleCols(held_from_, held).colwise().sum().transpose(),
        by_angles.transpose().lazyProduct(omega);
    const double missed = lacking.col(0).cwiseAbs().maxCoeff();
    if (missed < least_missed) {
      least_missed = missed;
      closest = theta;
    }
    solve_member(system, lacking, held);
    const Matrix change = by_angles.lazyProduct(lacking);  // the least that does it
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
