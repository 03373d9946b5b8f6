// SPDX-License-Identifier: MIT
#include "pipedyn/galerkin/grid.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <numbers>
#include <stdexcept>
#include <string>
#include <utility>

#include "pipedyn/products.hpp"

namespace pipedyn {

namespace {

/// Logarithm of an integrand's relative tolerance; the powers of G counted; nodes at least.
struct Demand {
  double log_tolerance, growths;
  Index least_nodes;
};
constexpr Demand smooth{25.0, 2.5, 7}, with_drag{33.0, 3.5, 31};

Index whole_points(Index count) { return whole(count, GridTables::multiple); }

}  // namespace

Matrix slope_series(const Basis& basis, double low, double high) {
  const Index count = 2 * basis.most_on_a_panel() + 60;
  const Vector angle =
      (Vector::LinSpaced(count, 0.0, static_cast<double>(count - 1)).array() + 0.5) *
      (std::numbers::pi / static_cast<double>(count));
  const Vector s = low + (high - low) * (0.5 * (1.0 + angle.array().cos()));
  Matrix transform(count, count);
  for (Index k = 0; k < count; ++k) {
    transform.row(k) = (2.0 / static_cast<double>(count)) *
                       (static_cast<double>(k) * angle.transpose().array()).cos();
  }
  transform.row(0) *= 0.5;
  Matrix coefficient = (transform * basis.evaluate(s, 1)).cwiseAbs();
  for (Index i = 0; i < basis.size(); ++i) {
    const double floor = 1e-13 * coefficient.col(i).maxCoeff();
    for (Index k = 0; k < count; ++k) {
      if (coefficient(k, i) < floor) coefficient(k, i) = 0.0;
    }
  }
  return coefficient;
}

std::vector<NodeTest> node_tests(const Matrix& series, Index nodes, bool drag) {
  const Demand& demand = drag ? with_drag : smooth;
  const Vector order =
      Vector::LinSpaced(series.rows(), 0.0, static_cast<double>(series.rows() - 1));
  const Eigen::ArrayXd total = series.colwise().sum().transpose();
  std::vector<NodeTest> tests;
  for (double eta = std::min(0.05, 2.0 / static_cast<double>(series.cols())); eta < 3.0;
       eta *= 1.5) {
    const Vector size = (order * eta).array().cosh();
    // Of functions that are 0 on the interval nothing grows.
    const Eigen::ArrayXd growth =
        (total > 0.0).select((size.transpose() * series).transpose().array() / total, 1.0);
    const double budget = 2.0 * static_cast<double>(nodes) * eta - demand.log_tolerance -
                          demand.growths * std::log(growth.maxCoeff());
    if (!(budget > 0.0)) continue;
    const Vector slant = (order * eta).array().sinh();
    tests.push_back({budget, 2.0 * series.transpose() * slant});
  }
  return tests;
}

bool passes(const std::vector<NodeTest>& tests, const double* q, Index stride) {
  for (const NodeTest& test : tests) {
    double cost = 0.0;
    for (Index i = 0; i < test.cost.size(); ++i) cost += std::abs(q[i * stride]) * test.cost[i];
    if (cost <= test.budget) return true;
  }
  return false;
}

Index least_nodes(bool drag) { return (drag ? with_drag : smooth).least_nodes; }

void require_amplitudes(Index entries, Index m) {
  if (entries != m) {
    throw std::invalid_argument("q must have " + std::to_string(m) + " entries, got " +
                                std::to_string(entries));
  }
}

Orthonormal::Orthonormal(const Basis& basis) : identity(basis.family() == Family::beam) {
  const Index m = basis.size();
  to_basis = inverse = Matrix::Identity(m, m);
  if (identity) return;
  Matrix mass = Matrix::Zero(m, m);
  const Quadrature rule(basis.most_on_a_panel() + 3);
  for (Index panel = 0; panel + 1 < basis.ends().size(); ++panel) {
    const double low = basis.ends()[panel], length = basis.ends()[panel + 1] - low;
    const Matrix value = basis.evaluate(low + length * rule.node.array(), 0);
    mass += inner(value, length * rule.weight, value);
  }
  const Eigen::LLT<Matrix> factors(mass);
  if (factors.info() != Eigen::Success) {
    throw std::invalid_argument("m must be smaller for a motion: the mass matrix of " +
                                std::to_string(m) + " functions is singular to rounding");
  }
  inverse = factors.matrixU();
  factors.matrixU().solveInPlace(to_basis);
}

Grid::Grid(const Basis& basis, const Orthonormal& orthonormal, Index nodes)
    : rule_(nodes), stiffness_(basis.stiffness()) {
  const Index m = basis.size(), points = nodes + 1, half = points / 2, middle = half - 1;
  const Index stride = whole(points, GridTables::widest);
  arc_.resize(points);
  arc_ << rule_.node, 1.0;
  slope_ = basis.evaluate(arc_, 1);
  orthonormal_ = Matrix::Zero(points, whole(m, GridTables::multiple));
  orthonormal_.leftCols(m) = slope_ * orthonormal.to_basis;
  slope_by_function_ = Matrix::Zero(m, stride);
  slope_by_function_.leftCols(points) = slope_.transpose();
  const Vector& weight = rule_.weight;
  const Matrix integral = rule_.integral_to(rule_.node);
  from_sums_ = from_differences_ = Matrix::Zero(half, half);
  for (Index p = 0; p < half; ++p) {
    const auto here = integral.row(p), mirrored = integral.row(nodes - 1 - p);
    if (p < middle) from_sums_.row(p) = 0.5 * (here - mirrored).head(half);
    from_differences_.row(p) = 0.5 * (here + mirrored - weight.transpose()).head(half);
  }
  from_sums_.row(middle) = 0.5 * weight.head(half).transpose();
  from_differences_.col(middle).setOnes();
  folded_weight_.resize(nodes);
  folded_weight_ << 2.0 * weight.head(middle), weight[middle], 2.0 * weight.head(middle);
  expansion_ = Matrix::Zero(nodes, stride);
  expansion_.leftCols(nodes) = rule_.expansion;
  recurrence_ = legendre_recurrence(nodes);
  tables_ = {.functions = m,
             .padded = orthonormal_.cols(),
             .nodes = nodes,
             .stride = stride,
             .slope_by_function = slope_by_function_.data(),
             .orthonormal = orthonormal_.data(),
             .to_basis = orthonormal.identity ? nullptr : orthonormal.to_basis.data(),
             .from_sums = from_sums_.data(),
             .from_differences = from_differences_.data(),
             .weight = rule_.weight.data(),
             .folded_weight = folded_weight_.data(),
             .arc = arc_.data(),
             .expansion = expansion_.data(),
             .recurrence = recurrence_.data(),
             .stiffness = stiffness_.data()};
}

Grids::Grids(Basis basis, bool drag, Index least_nodes)
    : basis_(std::move(basis)), orthonormal_(basis_) {
  const Matrix series = slope_series(basis_);
  const Index m = basis_.size();
  const Index largest = std::min<Index>(64 * m + 96, std::max<Index>(4095, 4 * m));  // of 0.1 GB
  // Points, the nodes and the end, come in whole multiples.
  for (Index points = whole_points(std::max({m, least_nodes, pipedyn::least_nodes(drag)}) + 1);;
       points = whole_points(points + std::max<Index>(4, points / 6))) {
    std::vector<NodeTest> tests = node_tests(series, points - 1, drag);
    const bool last = points - 1 >= std::max(largest, least_nodes);
    if (tests.empty() && !last) continue;
    Slot& slot = slots_.emplace_back();
    slot.nodes = points - 1;
    slot.tests = std::move(tests);
    if (last) break;
  }
}

Index Grids::choose(const double* q, Index stride) const {
  const Index last = count() - 1;
  for (Index number = 0; number < last; ++number) {
    if (passes(slots_[static_cast<std::size_t>(number)].tests, q, stride)) return number;
  }
  return last;
}

bool Grids::resolves(Index number, const double* q, Index stride) const {
  if (number + 1 < count()) return true;
  const std::vector<NodeTest>& tests = slots_.back().tests;
  return tests.empty() || passes(tests, q, stride);
}

const Grid& Grids::operator[](Index number) const {
  Slot& slot = slots_[static_cast<std::size_t>(number)];
  std::call_once(slot.built,
                 [&] { slot.grid = std::make_unique<Grid>(basis_, orthonormal_, slot.nodes); });
  return *slot.grid;
}

}  // namespace pipedyn
