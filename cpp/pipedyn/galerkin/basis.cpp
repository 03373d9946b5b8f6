// SPDX-License-Identifier: MIT
#include "pipedyn/galerkin/basis.hpp"

#include <Eigen/SparseCore>
#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

#include "pipedyn/galerkin/quadrature.hpp"

namespace pipedyn {

namespace {

/// Functions whose curvatures are the first normalised Legendre polynomials on all of [0, 1], or
/// derivatives of these functions.
Matrix legendre_functions(const Vector& s, Index count, int derivative) {
  Matrix table = legendre_values(s, count + 2 - derivative);  // one more for each integration
  if (derivative < 2) table = legendre_integrals(table, s);
  if (derivative < 1) table = legendre_integrals(table, 0.5 * s.array().square());
  for (Index k = 0; k < count; ++k) table.col(k) *= std::sqrt(2.0 * static_cast<double>(k) + 1.0);
  return table;
}

/// Shortest length of a panel that gets `more` functions. On a panel of length h the function of
/// degree k > 1 moves a mass of about (h / k)^4 / 100: at this length it is 1e-15 for k = 6, and
/// below it eigenvalues are only rounding errors.
constexpr double shortest_enriched = 3e-3;

}  // namespace

Basis::Basis(Family family, Index m, const Vector& joints, Index more, const Pipe& held)
    : family_(family),
      size_(m),
      root_(held.root),
      turns_(held.root < std::numeric_limits<double>::infinity()),
      end_guided_(held.end_guided()),
      held_across_(held.end_held()),
      ends_(joints.size() + 2) {
  const bool beam = family == Family::beam;
  if (m < (beam && held_across_ ? 2 : 1)) {
    throw std::invalid_argument("a basis must have at least one function");
  }
  if (beam) {
    if (joints.size() > 0) throw std::invalid_argument("beam modes have no panels");
    modes_ = BeamModes(held_across_ ? m - 1 : m, held.root, held.end);
  }
  ends_ << 0.0, joints, 1.0;
  const Index panels = ends_.size() - 1;
  const Vector lengths = ends_.tail(panels) - ends_.head(panels);
  if (!(lengths.array() > 0.0).all()) {
    throw std::invalid_argument("joints must ascend between 0 and 1");
  }
  const Index own = m + dropped() - ahead();  // functions on panels
  if (own < panels) {
    throw std::invalid_argument("a basis must have at least one function for each of " +
                                std::to_string(panels) + " panels");
  }
  numbers_.resize(static_cast<std::size_t>(panels));
  const auto claim = [&](Index panel) {
    const double length = lengths[panel];
    double few = length < 0.03 ? std::floor(-6.0 / std::log10(length)) : 4.0;
    if (length >= shortest_enriched) few += static_cast<double>(more);
    const auto has = static_cast<double>(numbers_[static_cast<std::size_t>(panel)].size());
    const double most = 6.0 + static_cast<double>(more);
    return has > few ? length / (has - few) : length + most - has;  // at most 1, or at least 1
  };
  Vector claims(panels);
  for (Index panel = 0; panel < panels; ++panel) claims[panel] = claim(panel);
  for (Index i = 0; i < own; ++i) {
    Index panel = 0;
    claims.maxCoeff(&panel);
    numbers_[static_cast<std::size_t>(panel)].push_back(i);
    claims[panel] = claim(panel);
  }
  if (!beam) set_panels();
}

Index Basis::most_on_a_panel() const {
  std::size_t most = 0;
  for (const std::vector<Index>& numbers : numbers_) most = std::max(most, numbers.size());
  return static_cast<Index>(most);
}

std::vector<std::vector<Index>> Basis::by_panel() const {
  std::vector<std::vector<Index>> places = numbers_;
  for (std::vector<Index>& of_panel : places) {
    for (Index& place : of_panel) place += ahead() - dropped();
  }
  return places;
}

void Basis::set_panels() {
  const Index first = turns_ ? 1 : 0, count = size_ + dropped() - ahead();
  Matrix by_number = Matrix::Zero(count, size_);
  to_panels_ = Matrix::Zero(first + count, size_);
  by_number.bottomRightCorner(size_ - ahead(), size_ - ahead()).setIdentity();
  if (ahead() > 0) to_panels_(0, 0) = 1.0 / std::sqrt(std::max(root_, 1.0));
  if (end_guided_) by_number.row(0).setZero();
  // The curvatures of degree 0 turn the end by the square roots of the panels' lengths, which form
  // a unit vector: a Householder reflection maps it to one of them, so that the others do not turn
  // the end. This one is s^2 / 2 up to its sign, the sum of all of them with these coefficients.
  const Index panels = ends_.size() - 1;
  const Vector turning = (ends_.tail(panels) - ends_.head(panels)).cwiseSqrt();
  Vector normal = turning;
  std::vector<Index> constant;
  Index next = first;
  for (const std::vector<Index>& numbers : numbers_) {
    if (numbers[0] == 0) normal[static_cast<Index>(constant.size())] += 1.0;
    constant.push_back(next);
    for (const Index number : numbers) to_panels_.row(next++) = by_number.row(number);
  }
  if (!end_guided_) return;
  const Matrix own = to_panels_(constant, Eigen::all);
  to_panels_(constant, Eigen::all) -=
      (2.0 / normal.squaredNorm() * normal) * (normal.transpose() * own);
  if (turns_) {
    to_panels_(0, 0) = -1.0 / std::sqrt(1.0 + root_);
    to_panels_(constant, 0) += turning / std::sqrt(1.0 + root_);
  }
}

Matrix Basis::evaluate_panels(const Vector& s, int derivative) const {
  Matrix out = Matrix::Zero(s.size(), to_panels_.rows());
  Index next = turns_ ? 1 : 0;
  if (turns_ && derivative == 0) out.col(0) = s;
  if (turns_ && derivative == 1) out.col(0).setOnes();
  for (std::size_t panel = 0; panel < numbers_.size(); ++panel) {
    const double low = ends_[static_cast<Index>(panel)],
                 high = ends_[static_cast<Index>(panel) + 1];
    const double length = high - low;
    const Vector local = ((s.array() - low) / length).cwiseMax(0.0).cwiseMin(1.0);
    const Index count = static_cast<Index>(numbers_[panel].size());
    auto values = out.middleCols(next, count);
    values = std::pow(length, 1.5 - derivative) * legendre_functions(local, count, derivative);
    if (derivative == 0) {  // only the first slope is not 0 at the end of its panel
      values.col(0).array() += std::sqrt(length) * (s.array() - high).cwiseMax(0.0);
    }
    for (Index p = 0; derivative == 2 && p < s.size(); ++p) {
      const bool inside = s[p] >= low && (s[p] < high || high == 1.0);
      if (!inside) values.row(p).setZero();
    }
    next += count;
  }
  return out * Eigen::SparseMatrix<double>(to_panels_.sparseView());  // few entries are not 0
}

Matrix Basis::evaluate(const Vector& s, int derivative) const {
  if (derivative < 0 || derivative > 2) {
    throw std::invalid_argument("derivative must be 0, 1 or 2");
  }
  if (family_ == Family::legendre) return evaluate_panels(s, derivative);
  if (!held_across_) return modes_.evaluate(s, derivative);
  const EndShape shape(root_, end_guided_);
  const auto x = s.array();
  Matrix out(s.size(), size_);
  out.rightCols(size_ - 1) = modes_.evaluate(s, derivative);
  if (derivative == 0) out.col(0) = x * (shape.a + x * (shape.b + x * shape.c));
  if (derivative == 1) out.col(0) = shape.a + x * (2.0 * shape.b + x * (3.0 * shape.c));
  if (derivative == 2) out.col(0) = 2.0 * shape.b + x * (6.0 * shape.c);
  return out;
}

Vector Basis::stiffness() const {
  Vector found = Vector::Ones(size_);
  if (family_ == Family::beam) {
    found.tail(modes_.stiffness().size()) = modes_.stiffness();
    if (held_across_) found[0] = EndShape(root_, end_guided_).force;
  } else if (ahead() > 0) {
    found[0] = std::min(root_, 1.0);
  }
  return found;
}

}  // namespace pipedyn
