// SPDX-License-Identifier: MIT
#include "pipedyn/galerkin_level.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <numbers>
#include <stdexcept>
#include <string>
#include <utility>

namespace pipedyn {

namespace {

/// Logarithm of an integrand's relative tolerance; the powers of G counted; nodes at least.
struct Demand {
  double log_tolerance, growths;
  Index least_nodes;
};
constexpr Demand smooth{25.0, 2.5, 7}, with_drag{33.0, 3.5, 31};

Index padded(Index count) {
  return (count + LevelTables::multiple - 1) / LevelTables::multiple * LevelTables::multiple;
}

// Absolute Chebyshev coefficients of the slopes, (count, m); those of rounding's size are dropped.
Matrix chebyshev(const Basis& basis) {
  const Index count = 2 * basis.size() + 60;
  const Vector angle =
      (Vector::LinSpaced(count, 0.0, static_cast<double>(count - 1)).array() + 0.5) *
      (std::numbers::pi / static_cast<double>(count));
  const Vector s = 0.5 * (1.0 + angle.array().cos());
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

// Zero of the cubic through (x[k], v[k]), k < 4, between `low` and `high`, where it changes sign.
double cubic_zero(const std::array<double, 4>& x, const double* v, ptrdiff_t stride, double low,
                  double high) {
  std::array<double, 4> d{v[0], v[stride], v[2 * stride], v[3 * stride]};
  for (int order = 1; order < 4; ++order) {
    for (int k = 3; k >= order; --k) d[k] = (d[k] - d[k - 1]) / (x[k] - x[k - order]);
  }
  const auto value = [&](double s) {
    return d[0] + (s - x[0]) * (d[1] + (s - x[1]) * (d[2] + (s - x[2]) * d[3]));
  };
  double at_low = value(low), at_high = value(high);
  double zero = low;
  for (int step = 0; step < 12 && high - low > 1e-9; ++step) {  // false position, Illinois variant
    zero = (low * at_high - high * at_low) / (at_high - at_low);
    const double here = value(zero);
    if (std::abs(here) <= 1e-9 * std::abs(at_high - at_low)) break;
    if ((here > 0.0) == (at_high > 0.0)) {
      high = zero;
      at_high = here;
      at_low *= 0.5;
    } else {
      low = zero;
      at_low = here;
      at_high *= 0.5;
    }
  }
  return zero;
}

}  // namespace

void signed_weights(const LevelTables& level, const double* v, ptrdiff_t stride, double* scratch,
                    double* weights) {
  const ptrdiff_t nodes = level.nodes;
  const double* weight = level.integral + nodes * nodes;
  double *turned = scratch, *integrals = scratch + nodes, *sum = scratch + 2 * nodes;
  double sign = v[0] < 0.0 ? -1.0 : 1.0;
  bool turns = false;
  // From a zero on, twice the integral up to it less twice the whole turns the sign.
  for (ptrdiff_t p = 0; p < nodes; ++p) {
    if (!(sign * v[(p + 1) * stride] < 0.0)) continue;
    if (!turns) std::fill(turned, turned + nodes, 0.0);
    turns = true;
    const ptrdiff_t first = std::clamp<ptrdiff_t>(p - 1, 0, nodes - 3);
    const double* arc = level.arc + first;
    const double zero = cubic_zero({arc[0], arc[1], arc[2], arc[3]}, v + first * stride, stride,
                                   level.arc[p], level.arc[p + 1]);
    legendre_integrals(zero, nodes, integrals);
    for (ptrdiff_t k = 0; k < nodes; ++k) turned[k] += 2.0 * sign * integrals[k];
    sign = -sign;
  }
  for (ptrdiff_t p = 0; p < nodes; ++p) sum[p] = sign * weight[p];
  if (turns) {
    for (ptrdiff_t k = 0; k < nodes; ++k) {
      const double* expansion = level.expansion + k * nodes;
      for (ptrdiff_t p = 0; p < nodes; ++p) sum[p] += turned[k] * expansion[p];
    }
  }
  for (ptrdiff_t p = 0; p < nodes; ++p) weights[p * stride] = sum[p];
}

Orthonormal::Orthonormal(const Basis& basis) : identity(basis.family() == Family::beam) {
  const Index m = basis.size();
  to_basis = inverse = Matrix::Identity(m, m);
  if (identity) return;
  const Quadrature rule(m + 3);
  const Matrix value = basis.evaluate(rule.node, 0);
  const Matrix mass = value.transpose() * rule.weight.asDiagonal() * value;
  const Eigen::LLT<Matrix> factors(mass);
  if (factors.info() != Eigen::Success) {
    throw std::invalid_argument("m must be smaller for a motion: the mass matrix of " +
                                std::to_string(m) + " functions is singular to rounding");
  }
  inverse = factors.matrixU();
  factors.matrixU().solveInPlace(to_basis);
}

Level::Level(const Basis& basis, const Orthonormal& orthonormal, Index nodes)
    : rule_(nodes), stiffness_(basis.stiffness()) {
  arc_.resize(nodes + 1);
  arc_ << rule_.node, 1.0;
  slope_ = basis.evaluate(arc_, 1);
  orthonormal_ = Matrix::Zero(nodes + 1, padded(basis.size()));
  orthonormal_.leftCols(basis.size()) = slope_ * orthonormal.to_basis;
  slope_by_function_ = slope_.transpose();
  integral_ = rule_.integral_to(arc_);
  integral_.bottomRows(1) = rule_.weight.transpose();
  tables_ = {.functions = basis.size(),
             .padded = orthonormal_.cols(),
             .nodes = nodes,
             .slope_by_function = slope_by_function_.data(),
             .orthonormal = orthonormal_.data(),
             .to_basis = orthonormal.identity ? nullptr : orthonormal.to_basis.data(),
             .integral = integral_.data(),
             .arc = arc_.data(),
             .expansion = rule_.expansion.data(),
             .stiffness = stiffness_.data()};
}

Levels::Levels(Basis basis, bool drag, Index least_nodes)
    : basis_(std::move(basis)), orthonormal_(basis_) {
  const Demand& demand = drag ? with_drag : smooth;
  const Matrix coefficient = chebyshev(basis_);
  const Vector order =
      Vector::LinSpaced(coefficient.rows(), 0.0, static_cast<double>(coefficient.rows() - 1));
  const Index m = basis_.size();
  const Index largest = 16 * m + 96;
  // Points, the nodes and the end, come in whole multiples.
  for (Index points = padded(std::max({m, least_nodes, demand.least_nodes}) + 1);;
       points = padded(points + std::max<Index>(4, points / 6))) {
    std::vector<Test> tests;
    for (double eta = std::min(0.05, 2.0 / static_cast<double>(m)); eta < 3.0; eta *= 1.5) {
      const Vector size = (order * eta).array().cosh();
      const Eigen::ArrayXd growth = (size.transpose() * coefficient).transpose().array() /
                                    coefficient.colwise().sum().transpose().array();
      const double budget = 2.0 * static_cast<double>(points - 1) * eta - demand.log_tolerance -
                            demand.growths * std::log(growth.maxCoeff());
      if (!(budget > 0.0)) continue;
      const Vector slant = (order * eta).array().sinh();
      tests.push_back({budget, 2.0 * coefficient.transpose() * slant});
    }
    const bool last = points - 1 >= std::max(largest, least_nodes);
    if (tests.empty() && !last) continue;
    Slot& slot = slots_.emplace_back();
    slot.nodes = points - 1;
    slot.tests = std::move(tests);
    if (last) break;
  }
}

Index Levels::choose(const double* q, Index stride) const {
  const Index m = basis_.size(), last = count() - 1;
  for (Index number = 0; number < last; ++number) {
    for (const Test& test : slots_[static_cast<std::size_t>(number)].tests) {
      double cost = 0.0;
      for (Index i = 0; i < m; ++i) cost += std::abs(q[i * stride]) * test.cost[i];
      if (cost <= test.budget) return number;
    }
  }
  return last;
}

const Level& Levels::operator[](Index number) const {
  Slot& slot = slots_[static_cast<std::size_t>(number)];
  std::call_once(slot.built,
                 [&] { slot.level = std::make_unique<Level>(basis_, orthonormal_, slot.nodes); });
  return *slot.level;
}

}  // namespace pipedyn
