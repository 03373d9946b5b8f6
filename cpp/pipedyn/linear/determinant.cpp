// SPDX-License-Identifier: MIT
#include "pipedyn/linear/determinant.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "pipedyn/vector/levels.hpp"

namespace pipedyn {

namespace {

/// Relative rounding of an entry of P, including what products with it add.
constexpr double entry_rounding = 8.0 * eps;
/// Largest |lambda| of vectors that elastic coordinates represent well enough: they lose eps
/// |lambda|^2, 2e-13 here.
constexpr double slow = 30.0;

/// Real parts of values, followed by their imaginary parts.
Reals parts_of(const Values& values) {
  Reals parts(2 * values.size());
  parts << values.real(), values.imag();
  return parts;
}

/// Real parts, then imaginary parts, of values in which `beside_zero` replaces 0.
Reals parts_beside_zero(const Values& values) {
  Reals parts = parts_of(values);
  for (Index i = 0; i < values.size(); ++i) {
    if (values[i] == 0.0) parts[i] = beside_zero;
  }
  return parts;
}

Values log_derivatives_by(const std::function<void(const Points&, double* out)>& evaluate, double u,
                          const Values& at, const Values& known) {
  const Index count = at.size();
  const Reals parts = parts_of(at), roots = parts_of(known);
  Reals out(2 * count);
  evaluate(Points{u, count, parts.data(), parts.data() + count, known.size(), roots.data(),
                  roots.data() + known.size()},
           out.data());
  Values result(count);
  result.real() = out.head(count);
  result.imag() = out.tail(count);
  return result;
}

/// Pairs made of what `evaluate` computes for roots, with vectors in n coordinates. elastic: takes
/// right or left vectors to elastic coordinates.
Pairs pairs_by(const std::function<void(const Points&, const PairsAsked&)>& evaluate,
               const std::function<ComplexTable(const ComplexTable&)>& elastic, double u,
               const Values& values, Index n, bool vectors, bool own, bool loaded) {
  const Index count = values.size();
  n = vectors ? n : 0;
  const Reals parts = parts_beside_zero(values);
  Eigen::ArrayXXd out(count, 11);
  std::vector<double> columns(4 * n * count);
  const auto part = [&](Index k) { return out.col(k).data(); };
  double *const right = vectors ? columns.data() : nullptr, *const left = right + 2 * n * count;
  evaluate(Points{u, count, parts.data(), parts.data() + count},
           PairsAsked{part(0), part(2), part(4), own ? part(6) : nullptr, part(8), part(9),
                      part(10), right, vectors ? left : nullptr, loaded});
  Pairs found{values,        ComplexTable(n, count), ComplexTable(n, count),
              Reals(count),  Reals(count),           Values(count),
              Values(count), Values(count),          Values(count)};
  for (Index i = 0; i < count; ++i) {
    for (Index j = 0; j < n; ++j) {
      const double *const x = right + 2 * j * count + i, *const y = left + 2 * j * count + i;
      found.right(j, i) = Complex(x[0], x[count]);
      found.left(j, i) = Complex(y[0], -y[count]);
    }
  }
  if (vectors) {
    found.right = elastic(found.right);
    found.left = elastic(found.left);
  }
  for (Index i = 0; i < count; ++i) {
    const double length = vectors ? found.right.col(i).norm() : 1.0;
    const double dual = vectors ? found.left.col(i).norm() : 1.0, both = length * dual;
    found.right.col(i) /= length;
    found.left.col(i) /= dual;
    const auto number = [&](Index k) { return Complex(out(i, k), out(i, k + 1)); };
    const auto known = [](double x) { return std::isfinite(x) ? x : infinite; };
    // by_lambda is exactly 0 where two roots are zero. divergence_at multiplies by it again what is
    // divided by it here.
    const Complex by_lambda = number(0) == 0.0 ? beside_zero : number(0) / both;
    const Complex value = number(2) / both;
    const double rest = out(i, 8) / both, size = (out(i, 9) + out(i, 10)) / both;
    const double rounding = (entry_rounding * out(i, 9) + eps * out(i, 10)) / both;
    found.residual[i] = known(rest / size);
    found.uncertain[i] = known((rest + rounding) / std::abs(by_lambda));
    found.slopes[i] = -number(4) / both / by_lambda;
    found.by_left[i] = u == 0.0 || magnitude(values[i]) <= slow ? by_lambda : 0.0;
    found.by_right[i] = own ? number(6) / (length * length) : 0.0;
    found.corrections[i] = std::abs(value) > rounding ? -value / by_lambda : 0.0;
  }
  return found;
}

/// The real parts of the columns of x, followed by the imaginary parts.
Matrix real_columns(const ComplexTable& x) {
  Matrix parts(x.rows(), 2 * x.cols());
  parts << x.real(), x.imag();
  return parts;
}

/// Products conj(y_j) z_j of two complex columns, each given by its real and imaginary part (n, 2).
ComplexVector conjugate_products(const Matrix& y, const Matrix& z) {
  const auto a = y.col(0).array(), b = y.col(1).array();
  const auto c = z.col(0).array(), d = z.col(1).array();
  ComplexVector products(y.rows());
  products.real() = (a * c + b * d).matrix();
  products.imag() = (a * d - b * c).matrix();
  return products;
}

}  // namespace

Forms Determinant::forms(const Pair& pair) const {
  const Matrix x = spread(real_columns(ComplexTable(pair.right)));
  const Matrix y = spread(real_columns(ComplexTable(pair.left)));
  const auto form = [&](const LinearPart& part) {
    return conjugate_products(y, times(x, part)).sum();
  };
  return Forms{.mass = form({.mass = 1.0}),
               .velocity = form({.velocity = 1.0}),
               .damping = form({.damping = 1.0}),
               .flux = form({.flux = 1.0}),
               .gravity = form({.gravity = 1.0}),
               .by_damping = form({.by_damping = 1.0}),
               .springs = has_joints() ? conjugate_products(y, x) : ComplexVector()};
}

Values Determinant::by_lambda(double u, const Pairs& pairs) const {
  const Matrix x = spread(real_columns(pairs.right)), y = spread(real_columns(pairs.left));
  const Index count = pairs.size();
  const auto form = [&](const LinearPart& part) {
    const Matrix z = times(x, part);
    const auto inner = [&](Index of_y, Index of_z) -> Reals {
      return y.middleCols(of_y, count)
          .cwiseProduct(z.middleCols(of_z, count))
          .colwise()
          .sum()
          .transpose();
    };
    Values found(count);
    found.real() = inner(0, 0) + inner(count, count);
    found.imag() = inner(0, count) - inner(count, 0);
    return found;
  };
  return 2.0 * pairs.values * form({.mass = 1.0}) + form({.damping = 1.0, .velocity = u});
}

std::pair<Reals, Reals> Determinant::energies(double u, const ComplexTable& x) const {
  const Matrix parts = spread(real_columns(x));
  const Index count = x.cols();
  const auto energy = [&](const LinearPart& part) -> Reals {
    const Vector sums = parts.cwiseProduct(times(parts, part)).colwise().sum();
    return (sums.head(count) + sums.tail(count)).array();
  };
  return {energy({.stiffness = 1.0, .flux = thrust() * u * u}), energy({.mass = 1.0})};
}

// ---------------------------------------------------------------------------------------- chains

namespace {

/// A number with its derivative by the flow speed.
template <class Part>
struct Dual {
  Part value, slope = 0.0;

  friend Dual operator+(Dual a, Dual b) { return {a.value + b.value, a.slope + b.slope}; }
  friend Dual operator-(Dual a, Dual b) { return {a.value - b.value, a.slope - b.slope}; }
  friend Dual operator*(Dual a, Dual b) {
    return {a.value * b.value, a.slope * b.value + a.value * b.slope};
  }
  friend Dual operator/(Dual a, Dual b) {
    const Part ratio = a.value / b.value;
    return {ratio, (a.slope - ratio * b.slope) / b.value};
  }
};

/// Calls `visit` with each of the pivots of P(0, u), whose product is its determinant, at a real or
/// complex speed. They are those of the recursion of chain/impedance.hpp at lambda = `beside_zero`.
template <class Number, class Visit>
void static_pivots(const ImpedanceModel& model, Number u, const Visit& visit) {
  const auto number = [](double value) { return Number{value}; };
  const auto near_zero = [&](const ImpedanceParts& of) {
    return number(of.stiffness + beside_zero * (of.damping + beside_zero * of.mass));
  };
  const Number thrust = number(model.thrust) * u * u;
  const Number coriolis = number(model.coriolis * beside_zero) * u;
  Number a = number(-model.entry * beside_zero) * u;
  Number b = model.guided ? number(0.0) - thrust : number(0.0), c = number(0.0), d = number(0.0);
  for (Index j = model.size - 1; j >= 0; --j) {
    const ImpedanceSegment& at = model.segments[j];
    const Number l = number(at.length), k = near_zero(at.joint), g = l * a + b;
    if (at.held) {
      const Number moment = near_zero(at.moment) + l * l * coriolis;
      const Number force =
          near_zero(at.across) + near_zero(at.turned) + number(2.0) * l * coriolis + thrust;
      a = ((k + d + moment) / l - force) / l + near_zero(at.force);
      b = k / l - thrust;
      c = k / l;
      d = k;
      continue;
    }
    const Number r = near_zero(at.moment) + l * l * coriolis + d + l * (c + g);
    const Number w = near_zero(at.across) + c + l * a, p = k + r;
    const Number h = g + near_zero(at.turned) + number(2.0) * l * coriolis;
    visit(p);
    const Number inverse = number(1.0) / p;
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
  const Vector& k = coarse->springs();
  const Vector scale = k.cwiseMax(1e-3 * k.mean() + 1e-300).cwiseSqrt().cwiseInverse();
  auto complement = std::make_shared<const Complement>(coarse->held_rows(scale));
  return std::make_unique<ChainDeterminant>(std::move(coarse), std::move(complement), lapack,
                                            scale);
}

Values ChainDeterminant::log_derivatives(double u, const Values& at, const Values& known) const {
  return log_derivatives_by(
      [&](const Points& points, double* out) {
        motion_kernel().impedance->log_derivative(chain_->impedance(), points, out);
      },
      u, at, known);
}

Pairs ChainDeterminant::pairs(double u, const Values& values, bool vectors, bool own,
                              bool loaded) const {
  return pairs_by(
      [&](const Points& points, const PairsAsked& asked) {
        motion_kernel().impedance->pairs(chain_->impedance(), points, asked);
      },
      [&](const ComplexTable& angles) -> ComplexTable {
        return complement_->gathered(ComplexTable(scale_.cwiseInverse().asDiagonal() * angles));
      },
      u, values, chain_->dof(), vectors, own, loaded);
}

Pencil ChainDeterminant::matrices(double stiffness_size) const {
  Operators ops = chain_->joint_operators(scale_);
  const double sign = chain_->pipe().direction();
  DenseOperator::Matrices made{std::move(ops.mass), sign * (ops.gyroscopic + ops.end_flux),
                               std::move(ops.damping), std::move(ops.stiffness),
                               std::move(ops.flux)};
  if (has_loss()) {
    const Matrix columns = scale_.asDiagonal();
    made[5] =
        chain_->pipe().hysteresis * (columns * chain_->joint_times(columns, {.by_damping = 1.0}));
  }
  std::array<double, 6> lost{};
  for (std::size_t k = 0; held() > 0 && k < made.size(); ++k) {
    Matrix& of = made[k];
    if (of.size() == 0) continue;
    lost[k] = 4.0 * eps * static_cast<double>(held()) * of.norm();
    const Matrix columns = complement_->gathered(of).transpose();
    of = complement_->gathered(columns).transpose();
  }
  return {lapack, std::move(made), chain_->pipe().end_coefficient, stiffness_size, lost};
}

Values ChainDeterminant::static_slopes(const Values& u) const {
  Values slopes = Values::Zero(u.size());
  for (Index i = 0; i < u.size(); ++i) {
    static_pivots(chain_->impedance(), Dual<Complex>{u[i], 1.0},
                  [&](const auto& pivot) { slopes[i] += pivot.slope / pivot.value; });
  }
  return slopes;
}

StaticDeterminants ChainDeterminant::static_determinants(const Reals& u) const {
  StaticDeterminants found{Reals::Ones(u.size()), Reals::Zero(u.size()), Reals::Zero(u.size())};
  for (Index i = 0; i < u.size(); ++i) {
    static_pivots(chain_->impedance(), Dual<double>{u[i], 1.0}, [&](const auto& pivot) {
      if (pivot.value < 0.0) found.sign[i] = -found.sign[i];
      found.logarithm[i] += std::log(std::abs(pivot.value));
      found.slope[i] += pivot.slope / pivot.value;
    });
  }
  return found;
}

int ChainDeterminant::negative_at_rest() const {
  int count = 0;
  static_pivots(chain_->impedance(), 0.0, [&](double pivot) { count += pivot < 0.0; });
  return count;
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
  const Matrix spread = free.spread(Matrix::Identity(dof, dof));
  return std::make_unique<PanelDeterminant>(std::move(coarse), lapack, spread, spread.transpose());
}

const PanelPencil::At& PanelDeterminant::at(double u) const {
  if (u != latest_speed_) {
    latest_ = pencil_->at(u);
    latest_speed_ = u;
  }
  return latest_;
}

Values PanelDeterminant::log_derivatives(double u, const Values& at, const Values& known) const {
  return log_derivatives_by(
      [&](const Points& points, double* out) {
        motion_kernel().elimination->log_derivative(this->at(u).model, points, out, nullptr);
      },
      u, at, known);
}

Pairs PanelDeterminant::pairs(double u, const Values& values, bool vectors, bool own,
                              bool loaded) const {
  return pairs_by(
      [&](const Points& points, const PairsAsked& asked) {
        motion_kernel().elimination->pairs(at(u).model, points, asked);
      },
      [&](const ComplexTable& x) -> ComplexTable {
        ComplexTable found(gathered_.rows(), x.cols());
        found.real() = gathered_ * x.real();
        found.imag() = gathered_ * x.imag();
        return found;
      },
      u, values, size(), vectors, own, loaded);
}

Pencil PanelDeterminant::matrices(double stiffness_size) const {
  const auto part = [&](const LinearPart& of) -> Matrix {
    return spread_.transpose() * times(Matrix(spread_), of);
  };
  DenseOperator::Matrices made{part({.mass = 1.0}), part({.velocity = 1.0}), part({.damping = 1.0}),
                               part({.stiffness = 1.0}), part({.flux = 1.0})};
  if (has_loss()) made[5] = pencil_->pipe().hysteresis * part({.by_damping = 1.0});
  std::array<double, 6> lost{};
  for (std::size_t k = 0; held() > 0 && k < made.size(); ++k) {
    lost[k] = 4.0 * eps * static_cast<double>(held()) * made[k].norm();
  }
  // Each entry is a sum over the nonzero entries of a column of `spread`.
  std::vector<Index> entries(spread_.cols(), 0);
  for (Index k = 0; k < spread_.nonZeros(); ++k) ++entries[spread_.innerIndexPtr()[k]];
  const double summed = static_cast<double>(*std::ranges::max_element(entries));
  return {lapack, std::move(made), thrust(), stiffness_size, lost, summed * eps};
}

std::optional<Works> PanelDeterminant::works(double u, const Reals& frequencies,
                                             const ComplexTable& vectors) const {
  return pencil_->works(u, frequencies, spread(real_columns(vectors)));
}

const EliminationModel& PanelDeterminant::stiffness() const {
  if (!static_) static_ = pencil_->by_squared_speed();
  return static_->model;
}

Values PanelDeterminant::static_slopes(const Values& u) const {
  return 2.0 * u *
         log_derivatives_by(
             [&](const Points& points, double* out) {
               motion_kernel().elimination->log_derivative(stiffness(), points, out, nullptr);
             },
             0.0, u.square(), {});
}

StaticDeterminants PanelDeterminant::static_determinants(const Reals& u) const {
  const Index count = u.size();
  const Reals squares = u.square(), none = Reals::Zero(count);
  Reals slopes(2 * count), signs(2 * count);
  motion_kernel().elimination->log_derivative(
      stiffness(), {0.0, count, squares.data(), none.data()}, slopes.data(), signs.data());
  return {signs.head(count), signs.tail(count), 2.0 * u * slopes.head(count)};
}

int PanelDeterminant::negative_at_rest() const {
  return negative_eigenvalues(lapack,
                              spread_.transpose() * times(Matrix(spread_), {.stiffness = 1.0}));
}

}  // namespace pipedyn
