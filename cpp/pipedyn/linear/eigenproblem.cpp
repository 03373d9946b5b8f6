// SPDX-License-Identifier: MIT
#include "pipedyn/linear/eigenproblem.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <numeric>
#include <tuple>

#include "pipedyn/linear/neutral.hpp"

namespace pipedyn {

namespace {

/// Largest relative residual |P x| / (|lambda^2 M x| + |lambda C x| + k |x|) of a good pair, where
/// k = 1 + |gamma| + a u^2, with what terms add, is the size of the elastic stiffness matrix:
/// measured, the twelve lowest pairs of 25 models at four speeds have at most 8e-12. The rounding
/// of M x, eps |lambda|^2, is added to it and limits high modes.
constexpr double tolerance = 1e-10;

/// Relative residual beyond which a pair is wrong, however high its mode is. After refinement,
/// pairs of 300 segments with damping 1e-3 (1e-5, before it 0.99) and of 200 Legendre functions
/// (4e-5) pass.
constexpr double largest_residual = 1e-4;

/// Error of a growth rate, in differences of the rates that its two vectors give. Measured on 228
/// high modes of 120 Legendre functions, 200 beam functions and 200 segments, against roots to 19
/// digits: with this factor the true error is smaller for 212. For the others, where both vectors
/// are off by the same, it is up to 18 times as large, which is far less than the error of lambda
/// itself.
constexpr double vector_error = 3.0;

/// Most steps of a refinement, which takes two or three from a good guess.
constexpr int most_refinements = 6;

/// Share of |lambda| below which the real part of a root of a conservative system is rounding.
constexpr double on_axis = 1e-10;

/// Greatest relative imaginary part of the squares of two conjugate speeds that count as a double
/// real one.
constexpr double same_square = 2.0 * same_speed;

/// Greatest relative difference of |lambda|^2 between roots that count as equally large.
constexpr double same_size = 1e-11;

/// Greatest |K x| of a unit vector x that counts as free of K.
constexpr double free_turn = 1e-11;

/// |y^H C x| of null vectors below which it is rounding.
constexpr double least_rate = 1e-9;

/// Rounding of Re d lambda / du, in units of that of lambda: measured on 80 segments with a tip
/// mass, it is at most 7 at u = 0.003 and less beyond, 0.1 at u = 3.
constexpr double slope_rounding = 10.0;

/// Whether a residual passes the check that allows all that rounding explains: for high modes this
/// is enough where low ones matter.
bool is_nearly_converged(Complex value, double residual) {
  return residual <= tolerance + eps * std::norm(value);
}

bool is_good(const Pairs& pairs, Index i, bool high) {
  return (high ? has_converged : is_nearly_converged)(pairs.values[i], pairs.residual[i]);
}

inline bool is_finite(Complex z) { return std::isfinite(z.real()) && std::isfinite(z.imag()); }

/// The largest residual, infinite where one is not a number.
double largest_residual_of(const Pairs& pairs) {
  double most = 0.0;
  for (const double residual : pairs.residual) {
    most = std::isnan(residual) ? infinite : std::max(most, residual);
  }
  return most;
}

/// Refines a pair near `value` by two-sided Rayleigh quotient iteration from a right vector, if it
/// is known. Returns the pair with its residual, which is infinite where the iteration fails.
/// `steps` is increased by the number of steps taken.
const Pair& refine(const DenseOperator& p, Complex value, const VectorRef& right,
                   Refinement& memory, int& steps) {
  auto& [last, best, row] = memory;
  last.value = value;
  last.residual = infinite;
  last.left = Eigen::VectorXd::LinSpaced(p.dof, 1.0, 0.5).cast<Complex>();
  last.right = last.left;
  if (right.size() > 0) last.right = right;
  best = last;
  for (int step = 0; step < most_refinements; ++step) {
    p.factor(last.value);
    ++steps;
    p.solve(last.right, false);
    p.solve(last.left, true);
    for (ComplexVector* const x : {&last.right, &last.left}) *x /= x->norm();
    if (!last.right.allFinite() || !last.left.allFinite()) break;
    const Products products = p.multiply(last.right);
    row.set(products, 0, last.value, p.size);
    const Complex correction = -last.left.dot(row.rest) / last.left.dot(row.rate);
    if (!is_finite(correction)) break;
    last.value += correction;
    row.set(products, 0, last.value, p.size);
    last.residual = row.rest.norm() / row.size;
    if (!(last.residual < best.residual)) break;
    best = last;
    if (std::abs(correction) <= 4e-16 * std::abs(last.value)) break;
  }
  if (std::isfinite(best.residual)) return best;
  last.residual = infinite;
  return last;
}

/// Work of an operator on vectors (dof, r) that oscillate with some frequencies.
void find_forms(const DenseOperator& p, const RealsRef& frequencies, const ColumnsRef& vectors,
                WorkMemory& memory, Rayleigh& found) {
  auto& [parts, sizes, table, x, by_velocity, by_place] = memory;
  // The parts of C and K that do work, and the sizes of the entries from whose rounding they
  // result.
  DenseOperator::Matrices& of_parts = parts.renewed(p.lapack, p.dof, p.size, p.lost);
  of_parts[1] = 0.5 * (p.velocity() + p.velocity().transpose());
  of_parts[2] = 0.5 * (p.stiffness() - p.stiffness().transpose());
  DenseOperator::Matrices& of_sizes = sizes.renewed(p.lapack, p.dof, p.size, p.lost);
  of_sizes[1] = (of_parts[1].array() == 0.0).select(0.0, p.velocity().cwiseAbs());
  of_sizes[2] = (of_parts[2].array() == 0.0).select(0.0, p.stiffness().cwiseAbs());
  const auto [mass, velocity, stiffness] = p.multiply(vectors);
  const auto [same, resisting, circulatory] = parts.multiply(vectors);
  auto lengths = room_in(table, p.dof, vectors.cols());
  lengths = vectors.cwiseAbs().cast<Complex>();
  const auto [none, velocity_sizes, stiffness_sizes] = sizes.multiply(lengths);
  found.reserve(vectors.cols());
  for (Index i = 0; i < vectors.cols(); ++i) {
    const double omega = std::abs(frequencies[i]);
    x = vectors.col(i).conjugate();
    by_velocity = x.cwiseProduct(resisting.col(i));
    by_place = x.cwiseProduct(p.is_hysteretic() ? stiffness.col(i) : circulatory.col(i));
    found.mass[i] = x.cwiseProduct(mass.col(i)).sum().real();
    found.gyroscopic[i] = x.cwiseProduct(velocity.col(i)).sum().imag();
    found.dissipative[i] = by_velocity.sum().real();
    found.circulatory[i] = by_place.sum().imag();
    // Rounding of two sums of dof terms, and rounding of the matrices.
    const double sums = omega * by_velocity.cwiseAbs().sum() + by_place.cwiseAbs().sum();
    const double entries = lengths.col(i)
                               .cwiseProduct(omega * velocity_sizes.col(i) + stiffness_sizes.col(i))
                               .cwiseAbs()
                               .sum();
    const double matrices = omega * p.lost.velocity + p.lost.stiffness;
    const double added = static_cast<double>(p.dof + 2) * eps * sums;
    found.error[i] = 2.0 * (added + p.lost.entries * entries) + matrices;
  }
}

/// Whether a root off the axis of a conservative system has a mirror image across the axis; all
/// such roots have, except those that only rounding moves off the axis.
bool is_mirrored(const Values& values, Index i) {
  const Complex mirrored = -std::conj(values[i]);
  const double reach = std::norm(values[i].real());
  return (values - mirrored).abs2().minCoeff() < reach;
}

}  // namespace

bool has_converged(Complex value, double residual) {
  return is_nearly_converged(value, residual) && residual <= largest_residual;
}

namespace {

constexpr ComplexTable Pairs::* tables[] = {&Pairs::right, &Pairs::left};
constexpr Values Pairs::* complexes[] = {&Pairs::values, &Pairs::slopes, &Pairs::by_left,
                                         &Pairs::by_right, &Pairs::corrections};
constexpr Reals Pairs::* reals[] = {&Pairs::residual, &Pairs::uncertain, &Pairs::noise,
                                    &Pairs::slope_noise, &Pairs::signatures};

}  // namespace

void Row::set(const Products& products, Index i, Complex value, double stiffness_size) {
  const auto& [mass, velocity, stiffness] = products;
  rate = value * mass.col(i) + velocity.col(i);
  rest = value * rate + stiffness.col(i);
  rate += value * mass.col(i);
  size = std::norm(value) * mass.col(i).norm() + std::abs(value) * velocity.col(i).norm() +
         stiffness_size;
}

std::vector<Index> by_size(const ValuesRef& values, std::vector<Index> order) {
  order.resize(values.size());
  std::iota(order.begin(), order.end(), Index{0});
  const auto size = [&](Index i) { return is_finite(values[i]) ? std::norm(values[i]) : infinite; };
  const auto sort = [](auto first, auto last, const auto& place) {  // mostly already sorted
    if (std::ranges::is_sorted(first, last, {}, place)) return;
    std::sort(first, last,
              [&](Index i, Index k) { return std::tuple(place(i), i) < std::tuple(place(k), k); });
  };
  sort(order.begin(), order.end(), size);
  // Opposite real roots and conjugate ones have one magnitude except for rounding.
  for (auto first = order.begin(); first != order.end();) {
    const auto last = std::find_if(first, order.end(), [&](Index i) {
      return size(i) > (1.0 + same_size) * size(*first) || size(i) == infinite;
    });
    const auto place = [&](Index i) {
      return std::tuple(values[i].real(), -std::abs(values[i].imag()), values[i].imag() < 0.0);
    };
    sort(first, last, place);
    first = last == first ? first + 1 : last;
  }
  return order;
}

int Divergence::change() const {
  const double rate = pair.by_value.real(), slope = pair.slope.real();
  if (multiplicity != 1 || !(std::abs(rate) > least_rate) || slope == 0.0) return 0;
  return slope / rate < 0.0 ? 1 : -1;
}

double Divergence::distance(double size) const {
  // A root next to zero obeys inertia lambda^2 + rate lambda + slope du = 0.
  const double slope = std::abs(pair.slope.real());
  if (pair.right.size() == 0 || slope == 0.0 || multiplicity > 1) return infinite;
  return (std::abs(inertia) * size + std::abs(pair.by_value.real())) * size / slope;
}

Pair Pairs::pair(Index i) const {
  return {values[i], right.col(i), left.col(i), residual[i], uncertain[i], slopes[i], by_left[i]};
}

void Pairs::make_room(Index count) {
  for (const auto of : complexes) room_in(this->*of, count);
  for (Reals* const of : {&residual, &uncertain}) room_in(*of, count);
}

void Pairs::put(Index k, const Pairs& others, Index i) {
  for (const auto of : tables) {
    if ((others.*of).cols() > 0) (this->*of).col(k) = (others.*of).col(i);
  }
  for (const auto of : complexes) {
    if ((others.*of).size() > 0) (this->*of)[k] = (others.*of)[i];
  }
  for (const auto of : reals) {
    if ((others.*of).size() > 0) (this->*of)[k] = (others.*of)[i];
  }
}

void Pairs::take(const std::vector<Index>& which, Pairs& to) const {
  const Index count = static_cast<Index>(which.size());
  for (const auto of : tables) {
    const ComplexTable& from = this->*of;
    (to.*of).resize(from.rows(), from.cols() > 0 ? count : 0);
    for (Index k = 0; k < (to.*of).cols(); ++k) (to.*of).col(k) = from.col(which[k]);
  }
  const auto take = [&](const auto& from, auto& into) {  // Eigen would copy the indices
    into.resize(from.size() > 0 ? count : 0);
    for (Index k = 0; k < into.size(); ++k) into[k] = from[which[k]];
  };
  for (const auto of : complexes) take(this->*of, to.*of);
  for (const auto of : reals) take(this->*of, to.*of);
}

const DenseOperator& Eigenproblem::at(double u) {
  if (u != latest_speed_) {
    at_(u, dense().latest);
    latest_speed_ = u;
  }
  return dense().latest;
}

void Eigenproblem::reuse(Spectrum& other) {
  auto* const same = dynamic_cast<Eigenproblem*>(&other);
  if (same == nullptr || same == this) return;
  Spectrum::reuse(other);
  std::swap(dense_, same->dense_);
  latest_speed_ = same->latest_speed_ = no_speed;
}

void Eigenproblem::lowest(double u, Index count, bool left, bool high, Pairs& found) {
  count = std::min(count, 2 * traits.dof);
  bool any = false;
  for (const double shift : shifts) {
    const Pairs& pairs = dense().pairs;
    if (!about(u, shift, count, left)) continue;
    mend(u, dense().pairs, left, high);
    bool good = true;
    for (Index i = 0; i < pairs.values.size(); ++i) good = good && is_good(pairs, i, high);
    if (!any || largest_residual_of(pairs) < largest_residual_of(found)) {
      found.values = pairs.values;
      found.right = pairs.right;
      found.left = pairs.left;
      found.residual = pairs.residual;
    }
    any = true;
    if (good) break;
  }
  if (any) return;
  const double none = std::numeric_limits<double>::quiet_NaN();
  found = {Values::Constant(count, {none, 0.0}), ComplexTable::Zero(traits.dof, count),
           ComplexTable::Zero(traits.dof, left ? count : 0), Reals::Constant(count, infinite)};
}

/// Finds the `count` lowest pairs by the inverse problem about a shift, in `dense().pairs`; returns
/// false if that fails.
bool Eigenproblem::about(double u, double shift, Index count, bool left) {
  const bool free = is_squared(u);
  const auto& [mu, right, lefts] = at(u).inverse(shift, free, left ? 'V' : 'N');
  factorised_ += 2;
  const Index size = mu.size();
  if (size == 0) return false;
  // Without a term in lambda, lambda^2 is real or one of a conjugate pair, and each vector serves
  // both signs of lambda.
  Values& roots = dense().roots;
  roots.resize(free ? 2 * size : size);
  for (Index i = 0; i < size; ++i) {
    const Complex inverse = 1.0 / mu[i];
    roots[i] = free ? std::sqrt(shift * shift + inverse) : shift + inverse;
    if (free) roots[size + i] = -roots[i];
  }
  std::vector<Index>& order = dense().order;
  order = by_size(roots, std::move(order));
  count = std::min(count, roots.size());
  Pairs& pairs = dense().pairs;
  pairs.values.resize(count);
  pairs.right.resize(traits.dof, count);
  pairs.left.resize(traits.dof, left ? count : 0);
  for (Index k = 0; k < count; ++k) {
    const Index i = order[k] % size;
    pairs.values[k] = roots[order[k]];
    pairs.right.col(k) = right.col(i);
    if (left) pairs.left.col(k) = lefts.col(i);
  }
  find_residuals(u, pairs);
  for (Index i = 0; i < count; ++i) {
    if (is_finite(pairs.values[i])) continue;
    pairs.values[i] = std::numeric_limits<double>::quiet_NaN();
    pairs.right.col(i).setZero();
    pairs.residual[i] = infinite;
  }
  return true;
}

/// Refines the pairs that failed the check of their residual, one by one (conjugates together).
void Eigenproblem::mend(double u, Pairs& pairs, bool left, bool high) {
  Values& before = dense().before;
  before = pairs.values;
  for (Index i = 0; i < before.size(); ++i) {
    const Complex value = before[i];
    if (!(value.imag() >= 0.0 || traits.is_hysteretic()) || !is_finite(value)) continue;
    if (is_good(pairs, i, high)) continue;
    const Pair& better = near(u, value, pairs.right.col(i));
    if (!(std::abs(better.value - value) <= 1e-3 * std::abs(value) + 1e-6)) continue;
    if (better.residual <= pairs.residual[i] || better.converged()) {
      pairs.values[i] = value.imag() == 0.0 ? better.value.real() : better.value;
      pairs.right.col(i) = better.right;
      pairs.residual[i] = better.residual;
    }
    if (left) pairs.left.col(i) = better.left;
    if (value.imag() == 0.0) continue;
    for (Index k = 0; k < before.size(); ++k) {
      if (before[k] != std::conj(value)) continue;
      pairs.values[k] = std::conj(pairs.values[i]);
      pairs.residual[k] = pairs.residual[i];
      pairs.right.col(k) = pairs.right.col(i).conjugate();
      if (left) pairs.left.col(k) = pairs.left.col(i).conjugate();
      break;
    }
  }
}

void Eigenproblem::find_residuals(double u, Pairs& pairs) {
  const DenseOperator& p = at(u);
  const Products products = p.multiply(pairs.right);
  Row& row = dense().refined.row;
  pairs.residual.resize(pairs.size());
  for (Index i = 0; i < pairs.size(); ++i) {
    row.set(products, i, pairs.values[i], p.size);
    pairs.residual[i] = row.rest.norm() / row.size;
  }
}

void Eigenproblem::assess(double u, Pairs& pairs) {
  if (pairs.residual.size() == 0) find_residuals(u, pairs);
  if (pairs.left.cols() == 0) return;
  const DenseOperator& p = at(u);
  const Index count = pairs.size();
  const Products products = p.multiply(pairs.right);
  const Reals& hidden = p.hidden(pairs.values, pairs.right, pairs.left);
  const Columns by_speed = p.by_speed(pairs.values, pairs.right);
  pairs.uncertain.resize(count);
  for (Values* const one : {&pairs.slopes, &pairs.by_left, &pairs.by_right}) one->resize(count);
  Row& row = dense().refined.row;
  for (Index i = 0; i < count; ++i) {
    const Complex value = pairs.values[i];
    row.set(products, i, value, p.size);
    const auto y = pairs.left.col(i);
    const Complex by_left = y.dot(row.rate);
    const double lost = pairs.residual[i] * row.size + eps * (row.size + hidden[i]);
    const double uncertain = lost / std::abs(by_left) + eps * std::abs(value);
    pairs.uncertain[i] = std::isfinite(uncertain) ? uncertain : infinite;
    pairs.slopes[i] = -y.dot(by_speed.col(i)) / by_left;
    pairs.by_left[i] = by_left;
    pairs.by_right[i] = pairs.right.col(i).dot(row.rate);
  }
}

void Eigenproblem::rayleigh(double u, const RealsRef& frequencies, const ColumnsRef& vectors,
                            Rayleigh& found) {
  find_forms(at(u), frequencies, vectors, dense().work, found);
}

/// Replaces Re lambda by that of its energy balance where rounding hides a slow growth: for high
/// modes without damping, for modes on which the flow does hardly any work, and at rest, where only
/// damping forms.
///
/// With lambda = sigma + i omega, the imaginary part of x^H P x = 0 is
///
///     sigma (2 omega x^H M x + Im x^H C x) = -omega Re x^H C x - Im x^H K x.
///
/// On the right only damping and the work at the ends are left, so that its rounding is small
/// against it, while the rounding of lambda is eps |lambda|^2. The left vector obeys the same
/// balance; the difference of the two results shows the error of the vectors.
void Eigenproblem::improve(double u, Pairs& pairs, Reals& uncertain) {
  std::vector<Index>& hidden = dense().hidden;
  hidden.clear();
  for (Index i = 0; i < pairs.values.size(); ++i) {
    const Complex value = pairs.values[i];
    if (value.imag() == 0.0 || !(std::abs(value.real()) < 1e3 * uncertain[i])) continue;
    if (!is_good(pairs, i, true)) continue;
    // Near a double root vectors are less accurate than values: there y^H P' x is far below x^H P'
    // x.
    if (std::abs(pairs.by_left[i]) > 0.1 * std::abs(pairs.by_right[i])) hidden.push_back(i);
  }
  if (hidden.empty()) return;
  const Index count = static_cast<Index>(hidden.size()), rows = pairs.right.rows();
  auto omega = room_in(dense().reals, count);
  auto x = room_in(dense().right, rows, count), y = room_in(dense().left, rows, count);
  for (Index k = 0; k < count; ++k) {
    omega[k] = pairs.values[hidden[k]].imag();
    x.col(k) = pairs.right.col(hidden[k]);
    y.col(k) = pairs.left.col(hidden[k]);
  }
  auto& [right, left] = dense().forms;
  rayleigh(u, omega, x, right);
  rayleigh(u, omega, y, left);
  for (Index k = 0; k < count; ++k) {
    const auto balance = [&](const Rayleigh& of) {
      return 2.0 * omega[k] * of.mass[k] + of.gyroscopic[k];
    };
    const auto rate = [&](const Rayleigh& of) {
      return -(omega[k] * of.dissipative[k] + of.circulatory[k]) / balance(of);
    };
    const double error = right.error[k] / std::abs(balance(right)) +
                         vector_error * std::abs(rate(right) - rate(left));
    const Index i = hidden[k];
    if (!(error < uncertain[i])) continue;
    pairs.values[i].real(rate(right) + 0.0);  // -0 is 0
    uncertain[i] = error;
  }
}

/// The larger of the rounding of the matrix and the error that the residual tells.
void Eigenproblem::find_noise(Pairs& pairs) {
  noise_of_residuals(pairs);
  rounding_about(pairs.values, shifts[0], true, dense().reals);
  pairs.noise = pairs.noise.max(dense().reals);
}

/// Errors of roots by their residuals. They are limited to the square root of rounding, by which
/// roots that meet scatter, unless a root fails the check of its residual.
void Eigenproblem::noise_of_residuals(Pairs& pairs) {
  pairs.noise = pairs.uncertain;
  for (Index i = 0; i < pairs.size(); ++i) {
    if (!has_converged(pairs.values[i], pairs.residual[i])) continue;
    pairs.noise[i] = std::min(pairs.noise[i], 1e-7 * (1.0 + magnitude(pairs.values[i])));
  }
}

/// Sets the slopes at rest of a pipe without damping. Its modes are real, and Re d lambda / du is
/// the work of the ends on a mode, -x^T C' x / (2 x^T M x). Right and left vectors differ by
/// rounding, which may hide this number in y^H C' x.
void Eigenproblem::leave_axis(Pairs& pairs) {
  const DenseOperator& p = at(0.0);
  if ((p.stiffness() - p.stiffness().transpose()).norm() > 2e-12 * p.size) return;
  const Matrix none = Matrix::Zero(p.dof, p.dof);
  const DenseOperator by_flow(p.lapack, {p.mass(), p.velocity_rate(), none}, p.size,
                              {.entries = p.lost.entries});
  Rayleigh& found = dense().forms[0];
  find_forms(by_flow, Reals::Ones(pairs.size()), pairs.right, dense().work, found);
  for (Index i = 0; i < pairs.size(); ++i) {
    if (pairs.values[i].imag() == 0.0) continue;
    pairs.slopes[i].real(-0.5 * found.dissipative[i] / found.mass[i]);
    pairs.slope_noise[i] = 0.5 * found.error[i] / found.mass[i];
  }
}

void Eigenproblem::sample(double u, Index count, Sample& pairs) {
  lowest(u, count, true, false, pairs);
  pairs.u = u;
  if (!pairs.values.isFinite().all()) {
    throw not_converged("an eigenvalue at u = %g is beyond double precision", u);
  }
  assess(u, pairs);
  const Index size = pairs.size();
  find_noise(pairs);
  for (Reals* const of : {&pairs.slope_noise, &pairs.signatures}) of->setZero(size);
  for (Index i = 0; i < size; ++i) {
    if (!is_finite(pairs.slopes[i])) pairs.slopes[i] = 0.0;
    if (!traits.conservative || traits.squared || pairs.values[i].imag() == 0.0) continue;
    const double off = std::abs(pairs.values[i].real());
    if (off > pairs.noise[i] + on_axis * magnitude(pairs.values[i]) && is_mirrored(pairs.values, i))
      continue;
    // A root on the axis is exactly there, and moves along the axis.
    pairs.values[i].real(0.0);
    pairs.slopes[i].real(0.0);
    // Sign of x^H (2 omega M - i G) x, the energy of a mode divided by its frequency.
    const double energy = pairs.by_right[i].imag();
    pairs.signatures[i] = (energy > 0.0) - (energy < 0.0);
  }
  if (!traits.conservative && !traits.squared) {
    pairs.slope_noise = pairs.noise;
    find_growth(u, pairs);
    for (Index i = 0; i < size; ++i) {  // this does not improve slopes
      double& before = pairs.slope_noise[i];
      before = pairs.noise[i] < before || u == 0.0 ? slope_rounding * before : 0.0;
    }
    if (u == 0.0 && !traits.damped && pairs.right.size() > 0) leave_axis(pairs);
  }
}

/// The root next to a guess, with vectors and residual.
const Pair& Eigenproblem::near(double u, Complex value, const VectorRef& right) {
  int steps = 0;
  const Pair& result = refine(at(u), value, right, dense().refined, steps);
  factorised_ += steps;
  return result;
}

Pair Eigenproblem::refined(double u, const Pair& guess, bool) {
  const Pair& found = near(u, guess.value, guess.right);
  Pairs& pairs = dense().one;
  pairs.values.setConstant(1, found.value);
  pairs.right = found.right;
  pairs.left = found.left;
  pairs.residual.setConstant(1, found.residual);
  assess(u, pairs);
  improve(u, pairs, pairs.uncertain);
  return pairs.pair(0);
}

Reals Eigenproblem::quotients(double u, const Pairs& pairs) {
  if (is_squared(u) || pairs.right.size() == 0) return -pairs.values.square().real();
  const auto [mass, velocity, stiffness] = at(u).multiply(pairs.right);
  const auto form = [&](const Columns& product) -> Reals {
    return pairs.right.conjugate().cwiseProduct(product).colwise().sum().real().transpose().array();
  };
  return form(stiffness) / form(mass);
}

/// Null vectors of K(u), or the vectors of its least singular value, by inverse iteration from the
/// vectors of another pair. Result: value is y^H K x, slope y^H (dK/du) x, uncertain the rounding
/// of the value, inertia y^H M x.
Pair Eigenproblem::null_pair(double u, const Pair& near, double& inertia) {
  const DenseOperator& p = at(u);
  p.factor(0.0);
  ++factorised_;
  Pair result{0.0, near.right};
  const int steps = near.right.size() == 0 ? 3 : 1;
  if (steps > 1) result.right = Eigen::VectorXd::LinSpaced(traits.dof, 1.0, 0.5).cast<Complex>();
  for (int step = 0; step < steps; ++step) {
    result.left = result.right;
    p.solve(result.left, true);
    result.left /= result.left.norm();
    result.right = result.left;
    p.solve(result.right, false);
    result.right /= result.right.norm();
  }
  const auto [mass, velocity, stiffness] = p.multiply(result.right);
  result.value = result.left.dot(stiffness.col(0));
  result.residual = stiffness.col(0).norm() / p.size;
  result.uncertain = (result.residual + eps) * p.size;
  result.slope = result.left.dot(p.by_speed(Values::Zero(1), result.right).col(0));
  result.by_value = result.left.dot(velocity.col(0));
  inertia = result.left.dot(mass.col(0)).real();
  return result;
}

/// The divergence next to a guess, by Newton's method with the null vectors of each iterate
/// (two-sided Rayleigh quotients); none within `reach` of the guess.
std::optional<Divergence> Eigenproblem::divergence_near(double guess, double reach) {
  Pair pair;
  double u = guess, last = infinite, inertia = 0.0;
  for (int step = 0; step < most_refinements; ++step) {
    pair = null_pair(u, pair, inertia);
    const double change = -(pair.value / pair.slope).real(), size = std::abs(change);
    if (!(std::abs(u + change - guess) <= reach)) return {};
    if (size <= 4e-16 * u || size >= last) break;
    last = size;
    u += change;
  }
  if (!pair.converged()) return {};
  const double error = pair.uncertain / std::abs(pair.slope) + 4e-16 * (1.0 + u);
  pair.value = 0.0;
  return Divergence{u, error, std::move(pair), 1, inertia};
}

const std::optional<Modes>& Eigenproblem::modes_at_rest() {
  if (!modes_at_rest_) modes_at_rest_ = at(0.0).undamped_modes();
  return *modes_at_rest_;
}

Divergences Eigenproblem::divergences(double max_speed, bool) {
  const DenseOperator& one = at(1.0);
  const Matrix flux = 0.5 * one.stiffness_rate(), at_rest = one.stiffness() - flux;
  const auto asymmetry = [](const Matrix& a) { return (a - a.transpose()).cwiseAbs().maxCoeff(); };
  const bool symmetric = asymmetry(at_rest) + asymmetry(flux) <= 1e-10 * one.size;
  Divergences result;
  factorised_ += 2;
  if (symmetric) result.negative_at_rest = negative_eigenvalues(one.lapack, at_rest);
  if (flux.isZero(0.0)) return result;
  const auto before = [](const Divergence& a, const Divergence& b) { return a.speed < b.speed; };
  if (free_turns().cols() > 0) {
    result.all = divergences_beside(free_turns(), max_speed);
    return result;
  }
  const Values squares = singular_squares(one, at_rest, flux, symmetric);
  std::vector<Divergence> found;  // before refinement
  for (const Complex square : squares) {
    const double u = std::sqrt(std::max(square.real(), 0.0));
    const bool is_real = std::abs(square.imag()) <= same_square * square.real();
    if (is_real && u > least_speed && u <= max_speed) found.push_back({u, 0.0});
  }
  std::sort(found.begin(), found.end(), before);
  for (std::size_t i = 0; i < found.size();) {
    std::size_t next = i + 1;
    const double u = found[i].speed, near = same_speed * (1.0 + u);
    while (next < found.size() && found[next].speed - found[next - 1].speed < near) ++next;
    double reach = 1e-3 * (1.0 + u);
    if (i > 0) reach = std::min(reach, 0.4 * (u - found[i - 1].speed));
    if (next < found.size()) reach = std::min(reach, 0.4 * (found[next].speed - u));
    const int multiplicity = static_cast<int>(next - i);
    const double spread = found[next - 1].speed - u;
    auto refined = divergence_near(u, std::max(reach, near));
    if (!refined && multiplicity > 1) refined = Divergence{u, near};
    if (!refined)
      throw not_converged("rounding hides whether the stiffness is singular near u = %.6g", u);
    refined->multiplicity = multiplicity;
    refined->error += spread;
    result.all.push_back(std::move(*refined));
    i = next;
  }
  std::sort(result.all.begin(), result.all.end(), before);
  return result;
}

/// Unit vectors that K does not hold at any speed, (dof, k): a pipe on a hinge turns freely.
const Matrix& Eigenproblem::free_turns() {
  if (free_turns_) return *free_turns_;
  const DenseOperator& one = at(1.0);
  const Matrix flux = 0.5 * one.stiffness_rate(), at_rest = one.stiffness() - flux;
  Eigen::FullPivLU<Eigen::MatrixXd> lu(Eigen::MatrixXd(at_rest + shifts[0] * flux));
  lu.setThreshold(free_turn);
  free_turns_ = Matrix(traits.dof, 0);
  if (lu.isInvertible()) return *free_turns_;
  const Matrix turns = lu.kernel().colwise().normalized();
  if ((at_rest * turns).norm() + (flux * turns).norm() <= free_turn) free_turns_ = turns;
  return *free_turns_;
}

/// Divergences where K leaves k turns r free. The roots of these turns are zero at every speed, and
/// det P / lambda^k tends to the determinant of K with k of its columns replaced by C r. The error
/// of a speed is the difference between the results of two shifts.
std::vector<Divergence> Eigenproblem::divergences_beside(const Matrix& turns, double max_speed) {
  const DenseOperator& one = at(1.0);
  Matrix flux = 0.5 * one.stiffness_rate(), at_rest = one.stiffness() - flux;
  Matrix velocity = Matrix::Zero(traits.dof, traits.dof);
  const Matrix by_speed = one.velocity_rate() * turns, steady = one.velocity() * turns - by_speed;
  Eigen::MatrixXd left = turns;
  for (Index k = 0; k < turns.cols(); ++k) {  // columns that the turns move most, one for each turn
    Index row = 0;
    left.col(k).cwiseAbs().maxCoeff(&row);
    for (Index j = k + 1; j < turns.cols(); ++j) {
      left.col(j) -= left(row, j) / left(row, k) * left.col(k);
    }
    const bool is_resisted = by_speed.col(k).norm() + steady.col(k).norm() > free_turn;
    velocity.col(row) = by_speed.col(k);
    at_rest.col(row) = is_resisted ? steady.col(k) : Vector(one.mass() * turns.col(k));
    flux.col(row).setZero();
  }
  const DenseOperator problem = one.with(flux, velocity, at_rest);
  std::vector<Divergence> found;
  Values others;
  for (const double shift : shifts) {
    const Values mu = problem.roots(shift, false);
    if (mu.size() == 0) continue;
    const Values speeds = shift + 1.0 / mu;
    if (others.size() == 0) {
      others = speeds;
      continue;
    }
    for (const Complex speed : speeds) {
      const bool is_real = std::abs(speed.imag()) <= same_speed * speed.real();
      if (!is_real || !(speed.real() > least_speed && speed.real() <= max_speed)) continue;
      const double error = (others - speed).abs().minCoeff() + 4e-16 * (1.0 + speed.real());
      found.push_back({speed.real(), error});
    }
    break;
  }
  std::ranges::sort(found, {}, &Divergence::speed);
  for (std::size_t i = 1; i < found.size();) {  // where a root only touches zero, it has two
    const double apart = found[i].speed - found[i - 1].speed;
    if (!(apart < same_speed * (1.0 + found[i].speed))) {
      ++i;
      continue;
    }
    found[i - 1].error += apart;
    ++found[i - 1].multiplicity;
    found.erase(found.begin() + static_cast<std::ptrdiff_t>(i));
  }
  return found;
}

/// Squares s of the speeds at which K_0 + s A is singular; not all of them are real.
Values Eigenproblem::singular_squares(const DenseOperator& one, const Matrix& at_rest,
                                      const Matrix& flux, bool symmetric) const {
  for (double s = 1.0; symmetric && s < 1e9; s *= 10.0) {  // s at which tension makes K definite
    const auto found = symmetric_pairs(one.lapack, flux, at_rest - s * flux, false, 1e-6);
    if (found) return (-s - 1.0 / found->values).cast<Complex>();
  }
  Matrix zero = Matrix::Zero(traits.dof, traits.dof);
  for (const double shift : shifts) {
    const Values mu = one.with(flux, zero, at_rest).roots(shift, true);
    if (mu.size() > 0) return shift * shift + 1.0 / mu;
  }
  throw NotConverged("the stiffness is singular at every flow speed");
}

}  // namespace pipedyn
