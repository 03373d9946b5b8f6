// SPDX-License-Identifier: MIT
#include "pipedyn/galerkin/basis.hpp"

#include <algorithm>
#include <numbers>
#include <stdexcept>
#include <string>

#include "pipedyn/galerkin/quadrature.hpp"

namespace pipedyn {

namespace {

// Root i (from 0) of cos(kappa) + sech(kappa) = 0, by Newton's method from (i + 1/2) pi.
double beam_root(Index i) {
  double kappa = (static_cast<double>(i) + 0.5) * std::numbers::pi;
  for (int step = 0; step < 8; ++step) {
    const double decay = std::exp(-kappa);
    const double sech = 2.0 * decay / (1.0 + decay * decay);
    kappa -= (std::cos(kappa) + sech) / (-std::sin(kappa) - sech * std::tanh(kappa));
  }
  return kappa;
}

/// Functions with the first normalised Legendre polynomials for curvature on all of [0, 1], or
/// their derivatives.
Matrix legendre_functions(const Vector& s, Index count, int derivative) {
  Matrix table = legendre_values(s, count + 2 - derivative);  // each integral takes one
  if (derivative < 2) table = legendre_integrals(table, s);
  if (derivative < 1) table = legendre_integrals(table, 0.5 * s.array().square());
  for (Index k = 0; k < count; ++k) table.col(k) *= std::sqrt(2.0 * static_cast<double>(k) + 1.0);
  return table;
}

/// Of a panel of length h the function of degree k > 1 moves a mass of about (h / k)^4 / 100: at
/// this length 1e-15 with k = 6, below which eigenvalues are rounding.
constexpr double shortest_enriched = 3e-3;

}  // namespace

Basis::Basis(Family family, Index m, const Vector& joints, Index more)
    : family_(family), size_(m), ends_(joints.size() + 2) {
  if (m < 1) throw std::invalid_argument("a basis must have at least one function");
  if (family == Family::beam) {
    if (joints.size() > 0) throw std::invalid_argument("beam modes have no panels");
    roots_.resize(m);
    for (Index i = 0; i < m; ++i) roots_[i] = beam_root(i);
  }
  ends_ << 0.0, joints, 1.0;
  const Index panels = ends_.size() - 1;
  const Vector lengths = ends_.tail(panels) - ends_.head(panels);
  if (!(lengths.array() > 0.0).all()) {
    throw std::invalid_argument("joints must ascend between 0 and 1");
  }
  if (m < panels) {
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
    return has > few ? length / (has - few) : length + most - has;  // 1 at most, 1 at least
  };
  Vector claims(panels);
  for (Index panel = 0; panel < panels; ++panel) claims[panel] = claim(panel);
  for (Index i = 0; i < m; ++i) {
    Index panel = 0;
    claims.maxCoeff(&panel);
    numbers_[static_cast<std::size_t>(panel)].push_back(i);
    claims[panel] = claim(panel);
  }
}

Index Basis::most_on_a_panel() const {
  std::size_t most = 0;
  for (const std::vector<Index>& numbers : numbers_) most = std::max(most, numbers.size());
  return static_cast<Index>(most);
}

Matrix Basis::evaluate_panels(const Vector& s, int derivative) const {
  Matrix out(s.size(), size_);
  for (std::size_t panel = 0; panel < numbers_.size(); ++panel) {
    const std::vector<Index>& numbers = numbers_[panel];
    const double low = ends_[static_cast<Index>(panel)],
                 high = ends_[static_cast<Index>(panel) + 1];
    const double length = high - low;
    const Vector local = ((s.array() - low) / length).cwiseMax(0.0).cwiseMin(1.0);
    Matrix values = std::pow(length, 1.5 - derivative) *
                    legendre_functions(local, static_cast<Index>(numbers.size()), derivative);
    if (derivative == 0) {  // of the slopes at a panel's end only the first is not 0
      values.col(0).array() += std::sqrt(length) * (s.array() - high).cwiseMax(0.0);
    }
    if (derivative == 2) {
      for (Index p = 0; p < s.size(); ++p) {
        const bool inside = s[p] >= low && (s[p] < high || high == 1.0);
        if (!inside) values.row(p).setZero();
      }
    }
    for (std::size_t k = 0; k < numbers.size(); ++k) {
      out.col(numbers[k]) = values.col(static_cast<Index>(k));
    }
  }
  return out;
}

Matrix Basis::evaluate(const Vector& s, int derivative) const {
  if (derivative < 0 || derivative > 2) {
    throw std::invalid_argument("derivative must be 0, 1 or 2");
  }
  if (family_ == Family::legendre) return evaluate_panels(s, derivative);
  Matrix out(s.size(), size_);
  for (Index i = 0; i < size_; ++i) {
    const double kappa = roots_[i];
    const double decay = std::exp(-kappa);
    const double outer = (std::sin(kappa) - std::cos(kappa) - decay) /
                         (1.0 - decay * decay + 2.0 * decay * std::sin(kappa));
    const double sigma = 1.0 - 2.0 * outer * decay;
    const double inner = 1.0 - outer * decay;
    const double factor = std::pow(kappa, derivative);
    const double parity = derivative == 1 ? -1.0 : 1.0;
    for (Index p = 0; p < s.size(); ++p) {
      const double cosine = std::cos(kappa * s[p]), sine = std::sin(kappa * s[p]);
      double waves = -cosine + sigma * sine;
      if (derivative == 1) waves = sine + sigma * cosine;
      if (derivative == 2) waves = cosine - sigma * sine;
      out(p, i) = factor * (waves + outer * std::exp(-kappa * (1.0 - s[p])) +
                            parity * inner * std::exp(-kappa * s[p]));
    }
  }
  return out;
}

Vector Basis::stiffness() const {
  if (family_ == Family::legendre) return Vector::Ones(size_);
  return roots_.array().square().square();
}

}  // namespace pipedyn
