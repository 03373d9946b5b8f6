// SPDX-License-Identifier: MIT
#include "pipedyn/modular/scene.hpp"

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

/// Solves s mu = right by symmetric elimination, mu in place of right. Rows without pivot among the
/// first `positive` follow from others, and mu is 0 there; false where a later one has none.
bool solve_rows(Matrix& s, Matrix& right, Index positive) {
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
    if (row >= positive && !(std::abs(s(row, row)) > massless)) return false;
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
  return true;
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

/// Of one row: w . q, where w weighs nodes, and D.
struct Scene::Reached {
  double place = 0.0, drift = 0.0;
};

/// Adds R to by_angles, of which each entry is `stride` after the one before.
Scene::Reached Scene::reach(Index row, const double* sine, const double* cosine,
                            const double* omega, double* by_angles, Index stride) const {
  Reached sum;
  for (Index i = 0; i < coordinates(); ++i) {
    const Index node = i / 3, axis = i % 3;
    const double weight = weights_(row, i);
    if (weight == 0.0) continue;
    if (axis == 2) {
      by_angles[node * stride] += weight;
      if (node > 0) by_angles[(node - 1) * stride] -= weight;
      continue;
    }
    if (axis == 1) sum.place += weight * base_;
    for (Index j = 0; j <= node; ++j) {
      const double step = weight * length_[j];
      const double along = axis == 0 ? sine[j] : cosine[j];
      by_angles[j * stride] += step * (axis == 0 ? cosine[j] : -sine[j]);
      sum.place += step * along;
      sum.drift -= step * along * omega[j] * omega[j];
    }
  }
  return sum;
}

// -------------------------------------------------------------------------------------- motion

void Scene::rhs(const Batch& batch, double* rates, double* multipliers) const {
  chain_.rhs(batch, rates);
  add_rows(batch, rates, multipliers);
}

void Scene::add_rows(const Batch& batch, double* rates, double* multipliers) const {
  const Index n = dof(), members = batch.members, count = compliance_.size();
  if (count == 0) return;
  constexpr Index most = 64;  // columns of X at once: whole packs, and what they need is cached
  const Index block = std::max<Index>(1, most / count);
  const Eigen::Map<const Matrix> y(batch.y, 2 * n, members);
  Eigen::Map<Matrix> out(rates, 2 * n, members);
  const Index positive = count - (lends_ ? 1 : 0);
  for (Index first = 0; first < members; first += block) {
    const Index here = std::min(block, members - first), columns = here * count;
    Matrix theta(n, columns), by_angles = Matrix::Zero(n, columns), drift(count, here);
    for (Index k = 0; k < here; ++k) {
      const Matrix state = y.col(first + k);
      const auto [sine, cosine] = Turned(state.topRows(n));
      for (Index i = 0; i < count; ++i) {
        const Index column = k * count + i;
        theta.col(column) = state.col(0).head(n);
        drift(i, k) = reach(i, sine.data(), cosine.data(), state.data() + n,
                            by_angles.data() + column, columns)
                          .drift;
      }
    }
    const Matrix response = solve(theta, by_angles);
    for (Index k = 0; k < here; ++k) {
      const auto own = by_angles.middleCols(k * count, count);
      const auto x = response.middleCols(k * count, count);
      auto acceleration = out.col(first + k).tail(n);
      Matrix system(count, count), mu(count, 1);
      for (Index i = 0; i < count; ++i) {
        mu(i) = -drift(i, k) - own.col(i).dot(acceleration);
        for (Index m = 0; m <= i; ++m) system(i, m) = system(m, i) = own.col(i).dot(x.col(m));
        system(i, i) += compliance_[i];
      }
      if (!solve_rows(system, mu, positive)) {
        mu.setConstant(std::numeric_limits<double>::quiet_NaN());
      }
      for (Index i = 0; i < count; ++i) acceleration += mu(i) * x.col(i);
      if (multipliers == nullptr) continue;
      Eigen::Map<Matrix>(multipliers, count, members).col(first + k) = mu.col(0);
    }
  }
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

void Scene::rhs_and_power(const Batch& batch, double* rates) const {
  const Index n = dof(), members = batch.members;
  const Eigen::Map<const Matrix> y(batch.y, 2 * n, members);
  Batch moved = batch;
  Matrix met;
  if (value_.size() > 0) {
    Matrix theta = y.topRows(n), omega = y.bottomRows(n);
    const Vector missed = project(theta, omega);
    met.resize(2 * n, members);
    met << theta, omega;
    for (Index k = 0; k < members; ++k) {
      if (!(missed[k] <= Scene::met)) met.col(k).setConstant(std::nan(""));
    }
    moved.y = met.data();
  }
  chain_.rhs_and_power(moved, rates);
  add_rows(moved, rates, nullptr);
  if (value_.size() > 0) {
    Eigen::Map<Matrix>(rates, 2 * n, members) -= return_rate * (y - met);
  }
}

void Scene::energy(const Batch& batch, double* out) const {
  chain_.energy(batch, out);
  const Index n = dof();
  const Eigen::Map<const Matrix> y(batch.y, 2 * n, batch.members);
  for (Index k = 0; k < batch.members && compliance_.size() > 0; ++k) {
    const Matrix state = y.col(k);
    const auto [sine, cosine] = Turned(state.topRows(n));
    for (Index row = 0; row < compliance_.size(); ++row) {
      if (compliance_[row] == 0.0) continue;
      Vector by_angles = Vector::Zero(n);
      reach(row, sine.data(), cosine.data(), state.data() + n, by_angles.data(), 1);
      const double rate = by_angles.dot(state.col(0).tail(n));
      out[k] += 0.5 * rate * rate / compliance_[row];
    }
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

// ------------------------------------------------------------------------------- guides and pins

double Scene::project_one(Vector& theta, Vector& omega) const {
  constexpr double longest = 0.5;  // rad a step, so that segments do not turn over
  constexpr int most_steps = 100;
  const Index n = dof(), held = value_.size();
  Vector closest = theta;
  double least_missed = std::numeric_limits<double>::infinity();
  for (int step = 0; step < most_steps; ++step) {
    const auto [sine, cosine] = Turned(theta);
    Matrix by_angles = Matrix::Zero(held, n), system(held, held);
    Matrix lacking(held, 2);  // how far each coordinate is off its place, and its rate
    for (Index i = 0; i < held; ++i) {
      auto own = by_angles.row(i);
      const Reached at =
          reach(held_from_ + i, sine.data(), cosine.data(), omega.data(), own.data(), 1);
      lacking(i, 0) = at.place - value_[i];
      lacking(i, 1) = own.dot(omega);
      for (Index k = 0; k <= i; ++k) system(i, k) = system(k, i) = own.dot(by_angles.row(k));
    }
    const double missed = lacking.col(0).cwiseAbs().maxCoeff();
    if (missed < least_missed) {
      least_missed = missed;
      closest = theta;
    }
    solve_rows(system, lacking, held);
    const Matrix change = by_angles.transpose().lazyProduct(lacking);  // the least that does it
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
