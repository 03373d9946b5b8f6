// SPDX-License-Identifier: MIT
#include "pipedyn/linear/determinant.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <tuple>

#include "pipedyn/terms/dual.hpp"

namespace pipedyn {

namespace {

/// Relative rounding of an entry of P, including what products with it add.
constexpr double entry_rounding = 8.0 * eps;
/// Largest |lambda| of vectors that elastic coordinates represent well enough: they lose eps
/// |lambda|^2, 2e-13 here.
constexpr double slow = 30.0;

/// Writes real parts of values, followed by their imaginary parts; returns the end of these.
double* split(const ValuesRef& values, double* to) {
  const Index count = values.size();
  for (Index i = 0; i < count; ++i) {
    to[i] = values[i].real();
    to[count + i] = values[i].imag();
  }
  return to + 2 * count;
}

Reals parts_of(const ValuesRef& values) {
  Reals parts(2 * values.size());
  split(values, parts.data());
  return parts;
}

/// Values from their real parts, followed by their imaginary parts.
Values from_parts(const double* parts, Index count) {
  Values values(count);
  for (Index i = 0; i < count; ++i) values[i] = {parts[i], parts[count + i]};
  return values;
}

}  // namespace

/// Room for so many numbers, until the next call.
double* Determinant::room(Index count) const {
  if (room_.size() < static_cast<std::size_t>(count)) room_.resize(count);
  return room_.data();
}

void Determinant::log_derivatives(double u, const ValuesRef& at, const ValuesRef& known,
                                  Eigen::Ref<Values> found) const {
  const Index count = at.size();
  double *const parts = room(4 * count + 2 * known.size()), *const roots = split(at, parts),
                *const out = split(known, roots);
  evaluate(Points{u, count, parts, parts + count, known.size(), roots, roots + known.size()}, out);
  for (Index i = 0; i < count; ++i) found[i] = {out[i], out[count + i]};
}

void Determinant::pairs(double u, const ValuesRef& values, bool vectors, bool own, bool loaded,
                        Pairs& found, const std::vector<Index>& places) const {
  const Index count = values.size(), n = vectors ? size() : 0;
  double *const parts = room((13 + 4 * n) * count), *const numbers = split(values, parts),
                *const columns = numbers + 11 * count;
  for (Index i = 0; i < count; ++i) {
    if (values[i] == 0.0) parts[i] = beside_zero;
  }
  const auto part = [&](Index k) { return numbers + k * count; };
  double *const right = vectors ? columns : nullptr, *const left = columns + 2 * n * count;
  evaluate(Points{u, count, parts, parts + count},
           PairsAsked{part(0), part(2), part(4), own ? part(6) : nullptr, part(8), part(9),
                      part(10), right, vectors ? left : nullptr, loaded});
  const auto place = [&](Index i) { return places.empty() ? i : places[i]; };
  if (places.empty()) found.make_room(count);
  const auto read_columns = [&](double* of, double sign, ComplexTable& to) {
    if (!vectors) {
      to.resize(0, std::max(to.cols(), count));
      return;
    }
    const Eigen::Map<Matrix> columns = project({of, n, 2 * count}, projected_);
    if (to.rows() != columns.rows() || to.cols() < count) to.resize(columns.rows(), count);
    for (Index i = 0; i < count; ++i) {
      to.col(place(i)).real() = columns.col(i);
      to.col(place(i)).imag() = sign * columns.col(count + i);
    }
  };
  read_columns(right, 1.0, found.right);
  read_columns(left, -1.0, found.left);
  for (Index i = 0; i < count; ++i) {
    const Index to = place(i);
    const double length = vectors ? found.right.col(to).norm() : 1.0;
    const double dual = vectors ? found.left.col(to).norm() : 1.0, both = length * dual;
    found.right.col(to) /= length;
    found.left.col(to) /= dual;
    const auto out = [&](Index k) { return part(k)[i]; };
    const auto number = [&](Index k) { return Complex(out(k), out(k + 1)); };
    const auto known = [](double x) { return std::isfinite(x) ? x : infinite; };
    // by_lambda is exactly 0 where two roots are zero. divergence_at multiplies by it again what is
    // divided by it here.
    const Complex by_lambda = number(0) == 0.0 ? beside_zero : number(0) / both;
    const Complex value = number(2) / both;
    const double rest = out(8) / both, size = (out(9) + out(10)) / both;
    const double rounding = (entry_rounding * out(9) + eps * out(10)) / both;
    found.values[to] = values[i];
    found.residual[to] = known(rest / size);
    found.uncertain[to] = known((rest + rounding) / magnitude(by_lambda));
    found.slopes[to] = -number(4) / both / by_lambda;
    found.by_left[to] = u == 0.0 || magnitude(values[i]) <= slow ? by_lambda : 0.0;
    found.by_right[to] = own ? number(6) / (length * length) : 0.0;
    found.corrections[to] = magnitude(value) > rounding ? -value / by_lambda : 0.0;
  }
}

Pencil Determinant::matrices(double stiffness_size) const {
  const LinearPart parts[] = {{.mass = 1.0},      {.velocity = 1.0}, {.damping = 1.0},
                              {.stiffness = 1.0}, {.flux = 1.0},     {.by_damping = hysteresis()}};
  DenseOperator::Matrices made;
  std::array<double, 6> lost{};
  for (std::size_t k = 0; k < (hysteresis() > 0.0 ? 6 : 5); ++k) {
    std::tie(made[k], lost[k]) = matrix(parts[k]);
    lost[k] *= 4.0 * eps * static_cast<double>(held());
  }
  return {lapack, std::move(made), thrust(), stiffness_size, lost, entries_lost()};
}

ComplexTable Determinant::lifted(const ComplexTable& x) const {
  return mapped([this](const Matrix& part) { return lifted(part); }, x);
}

Values Determinant::inner(const ComplexTable& y, const ComplexTable& x,
                          const LinearPart& part) const {
  const ComplexTable z = mapped([&](const Matrix& of) { return times(of, part); }, x);
  return y.conjugate().cwiseProduct(z).colwise().sum().transpose();
}

Forms Determinant::forms(const Pair& pair) const {
  const ComplexTable x = lifted(ComplexTable(pair.right)), y = lifted(ComplexTable(pair.left));
  const auto form = [&](const LinearPart& part) { return inner(y, x, part)[0]; };
  return Forms{.mass = form({.mass = 1.0}),
               .velocity = form({.velocity = 1.0}),
               .damping = form({.damping = 1.0}),
               .flux = form({.flux = 1.0}),
               .gravity = form({.gravity = 1.0}),
               .by_damping = form({.by_damping = 1.0}),
               .springs = has_joints() ? y.conjugate().cwiseProduct(x).col(0) : ComplexVector()};
}

Values Determinant::by_lambda(double u, const Pairs& pairs) const {
  const ComplexTable x = lifted(pairs.right), y = lifted(pairs.left);
  return 2.0 * pairs.values * inner(y, x, {.mass = 1.0}) +
         inner(y, x, {.damping = 1.0, .velocity = u});
}

Reals Determinant::quotients(double u, const ComplexTable& vectors) const {
  const ComplexTable x = lifted(vectors);
  return inner(x, x, {.stiffness = 1.0, .flux = thrust() * u * u}).real() /
         inner(x, x, {.mass = 1.0}).real();
}

// ---------------------------------------------------------------------------------------- chains

namespace {

/// A number with its derivative by the flow speed.
using Number = Dual<Complex, 1>;

/// Calls visit with each of the pivots of P(0, u), whose product is its determinant, at a real or
/// complex speed, the last segment's first, and with its reciprocal. They are those of the
/// recursion of chain/dynamic_stiffness.hpp at lambda = `beside_zero`.
template <class Visit>
void for_each_static_pivot(const ChainModel& model, Complex speed, const Visit& visit) {
  const auto near_zero = [](const StiffnessParts& of) {
    return of.stiffness + beside_zero * (of.damping + beside_zero * of.mass);
  };
  const Number u{speed, {1.0}}, thrust = model.thrust[0] * u * u;
  const Number coriolis = (model.coriolis * beside_zero) * u;
  Number a = (-model.entry * beside_zero) * u, b = model.guided ? -thrust : Number{}, c{}, d{};
  for (Index j = model.size - 1; j >= 0; --j) {
    const StiffnessSegment& at = model.dynamic_stiffnesses[j];
    const double l = at.length, k = near_zero(at.joint);
    const Number moment = near_zero(at.moment) + l * l * coriolis, g = l * a + b;
    const Number turned = near_zero(at.turned) + 2.0 * l * coriolis;
    if (at.held) {
      const Number force = near_zero(at.across) + turned + thrust;
      a = (1.0 / (l * l)) * (k + d + moment - l * force) + near_zero(at.force);
      b = k / l - thrust;
      c = {k / l, {}};
      d = {k, {}};
      continue;
    }
    const Number r = moment + d + l * (c + g), w = near_zero(at.across) + c + l * a;
    const Number h = g + turned, p = k + r;
    const Complex share = std::conj(p.value) / std::norm(p.value);
    visit(p, share);
    const Number inverse{share, {-p.slope(0) * share * share}};
    a = a + near_zero(at.force) - (h + thrust) * w * inverse;
    b = (h * k - thrust * r) * inverse;
    c = w * k * inverse;
    d = r * k * inverse;
  }
}

}  // namespace

Index ChainDeterminant::enough_for(Index roots) const {
  // With four segments for each span, the lowest modes of spans are known.
  return std::max<Index>(10, roots + 4) + 4 * held();
}

std::unique_ptr<Determinant> ChainDeterminant::coarser(Index size) const {
  auto coarse = std::make_shared<const Chain>(chain_->coarser(size));
  Complement free(coarse->held_rows(coarse->elastic_scale()));
  return std::make_unique<ChainDeterminant>(std::move(coarse), std::move(free), lapack);
}

std::pair<Matrix, double> ChainDeterminant::matrix(const LinearPart& part) const {
  const Matrix columns = scale_.asDiagonal();
  const Matrix every = columns * times(columns, part);
  if (held() == 0) return {every, 0.0};
  return {complement_.projected(complement_.projected(every).transpose()).transpose(),
          every.norm()};
}

std::vector<double> ChainDeterminant::numbers() const {
  const ChainModel model = chain_->model();
  std::vector<double> found{model.coriolis, model.entry, model.thrust[0], model.guided ? 1.0 : 0.0};
  found.reserve(64);
  for (std::ptrdiff_t j = 0; j < model.size; ++j) {
    const StiffnessSegment& at = model.dynamic_stiffnesses[j];
    found.push_back(at.repeats ? 1.0 : 0.0);
    if (at.repeats) continue;
    for (const StiffnessParts& of : {at.joint, at.force, at.across, at.turned, at.moment}) {
      found.insert(found.end(), {of.stiffness, of.damping, of.mass});
    }
    found.insert(found.end(), {at.length, at.joint_hysteresis, at.moment_hysteresis,
                               at.held ? 1.0 : 0.0, at.loaded ? 1.0 : 0.0});
  }
  return found;
}

StaticDeterminants ChainDeterminant::static_determinants(const Values& u) const {
  const Index count = u.size();
  StaticDeterminants found{Values::Zero(count), Reals::Ones(count)};
  for (Index i = 0; i < count; ++i) {
    for_each_static_pivot(chain_->model(), u[i], [&](const Number& pivot, Complex share) {
      if (pivot.value.real() < 0.0) found.sign[i] = -found.sign[i];
      found.slope[i] += pivot.slope(0) * share;
    });
  }
  return found;
}

int ChainDeterminant::negative_at_rest() const {
  int negative = 0;
  for_each_static_pivot(chain_->model(), 0.0, [&](const Number& pivot, Complex) {
    negative += pivot.value.real() < 0.0 ? 1 : 0;
  });
  return negative;
}

// ---------------------------------------------------------------------------------------- panels

Index PanelDeterminant::enough_for(Index roots) const {
  // Two thirds of the functions represent modes, besides four for each joint.
  return std::max<Index>(12, (3 * roots) / 4 + 6) + 4 * pencil_->panels();
}

std::unique_ptr<Determinant> PanelDeterminant::coarser(Index size) const {
  auto coarse = std::make_shared<const PanelPencil>(pencil_->coarser(size));
  const Complement free(coarse->held().transpose());
  const Index dof = free.dof();
  const Matrix lift = free.lifted(Matrix::Identity(dof, dof));
  return std::make_unique<PanelDeterminant>(std::move(coarse), lapack, lift, lift.transpose());
}

const PanelPencil::At& PanelDeterminant::at(double u) const {
  if (u != latest_speed_) {
    pencil_->at(u, latest_);
    latest_speed_ = u;
  }
  return latest_;
}

std::pair<Matrix, double> PanelDeterminant::matrix(const LinearPart& part) const {
  Matrix of = lift_.transpose() * times(Matrix(lift_), part);
  const double norm = of.norm();
  return {std::move(of), norm};
}

double PanelDeterminant::entries_lost() const {
  // Each entry is a sum over the nonzero entries of a column of `lift`.
  std::vector<Index> entries(lift_.cols(), 0);
  for (Index k = 0; k < lift_.nonZeros(); ++k) ++entries[lift_.innerIndexPtr()[k]];
  return static_cast<double>(*std::ranges::max_element(entries)) * eps;
}

std::optional<Rayleigh> PanelDeterminant::rayleigh(double u, const Reals& frequencies,
                                                   const ComplexTable& vectors) const {
  if (!pencil_->works_at_ends()) return {};
  Matrix parts(vectors.rows(), 2 * vectors.cols());
  parts << vectors.real(), vectors.imag();
  return pencil_->rayleigh(u, frequencies, lifted(parts));
}

const EliminationModel& PanelDeterminant::stiffness() const {
  if (!static_) static_ = pencil_->by_squared_speed();
  return static_->model;
}

StaticDeterminants PanelDeterminant::static_determinants(const Values& u) const {
  const Index count = u.size();
  const Reals squares = parts_of(u.square());
  Reals slopes(2 * count), signs(2 * count);
  motion_kernel().elimination->log_derivative(stiffness(),
                                              {0.0, count, squares.data(), squares.data() + count},
                                              slopes.data(), signs.data());
  return {2.0 * u * from_parts(slopes.data(), count), signs.head(count)};
}

int PanelDeterminant::negative_at_rest() const {
  return negative_eigenvalues(lapack, matrix({.stiffness = 1.0}).first);
}

}  // namespace pipedyn
