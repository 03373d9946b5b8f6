// SPDX-License-Identifier: MIT
#include "pipedyn/galerkin/beam.hpp"

#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include "pipedyn/galerkin/quadrature.hpp"

namespace pipedyn {

namespace {

constexpr double infinite_stiffness = std::numeric_limits<double>::infinity();

/// Stiffness of the root below which the first mode of a beam with a free end is slow, kappa < 1/2:
/// the coefficients of the waves would be large there and cancel.
constexpr double soft = 0.02;

/// A, C and D, with B = 1, of the waves at a kappa that satisfy all conditions but one at s = 1,
/// and the residual of that condition.
struct Trial {
  double cosine, from_root, from_end, missed;
};

Trial trial(double kappa, double root, End end) {
  const double decay = std::exp(-kappa), c = std::cos(kappa), s = std::sin(kappa);
  const double clamped = root < infinite_stiffness ? root / (root + kappa) : 1.0;
  const double hinged = root < infinite_stiffness ? kappa / (root + kappa) : 0.0;
  const auto with = [&](double from_end) {
    const double far = decay * from_end;
    const double from_root = (clamped + (clamped - 2.0 * hinged) * far) / (clamped + 2.0 * hinged);
    return std::array{-from_root - far, from_root};
  };
  // Both conditions at s = 1, as halves of their sum and difference: the first determines D.
  const auto conditions = [&](double from_end) {
    const auto [cosine, from_root] = with(from_end);
    const double even = cosine * c + s, odd = cosine * s - c, rest = from_root * decay;
    if (end == End::guided) return std::array{from_end - rest, -odd};
    if (end == End::pinned) return std::array{from_end + rest, even};
    if (end == End::clamped)
      return std::array{0.5 * (even - odd) + from_end, rest + 0.5 * (even + odd)};
    return std::array{0.5 * (odd - even) + from_end, rest - 0.5 * (even + odd)};
  };
  const double at_none = conditions(0.0)[0], from_end = at_none / (at_none - conditions(1.0)[0]);
  const auto [cosine, from_root] = with(from_end);
  return {cosine, from_root, from_end, conditions(from_end)[1]};
}

/// kappa of mode i, counted from 0: it lies between those of a hinged and of a clamped root.
double wave_number(Index i, double root, End end) {
  constexpr int quarters[] = {1, 2, 4, 5};  // of pi, in kappa of high modes with a hinged root
  const auto about = [&](bool clamped) {
    const int part = quarters[static_cast<int>(end)] + (clamped ? 1 : 0);
    return (static_cast<double>(i) + 0.25 * part) * std::numbers::pi;
  };
  constexpr double off = 0.35;  // the first kappa of a cantilever is 0.304 above its estimate
  double low = std::max(about(root == infinite_stiffness) - off, 0.2);
  double high = about(root > 0.0) + off;
  if (root > 0.0 && root < infinite_stiffness) low = std::max(about(false) - off, 0.2);
  const bool rises = trial(low, root, end).missed < 0.0;
  for (int step = 0; step < 60; ++step) {
    const double middle = 0.5 * (low + high);
    ((trial(middle, root, end).missed < 0.0) == rises ? low : high) = middle;
  }
  return 0.5 * (low + high);
}

/// Derivative of K_n at s, where kappa4 is kappa^4.
double krylov(int n, double kappa4, double s, int derivative) {
  int power = n - derivative;
  double term = 1.0;
  if (power < 0) {
    power += 4;
    term = kappa4;
  }
  for (int k = 1; k <= power; ++k) term *= s / k;
  double sum = 0.0;
  for (int j = 1; j <= 6; ++j) {
    sum += term;
    for (int k = 1; k <= 4; ++k) term *= s / (power + 4 * j - 4 + k);
    term *= kappa4;
  }
  return sum;
}

}  // namespace

BeamModes::BeamModes(Index count, double root, End end) : stiffness_(count) {
  slow_ = end == End::free && root < soft && count > 0;
  if (slow_) {
    const auto sum = [&](double s, int derivative) {
      double total = 0.0;
      for (int n = 0; n < 3; ++n) {
        total += slow_parts_[n] * krylov(n + 1, stiffness_[0], s, derivative);
      }
      return total;
    };
    stiffness_[0] = 3.0 * root;
    slow_parts_ << 1.0, root, 0.0;
    for (int step = 0; step < 20; ++step) {
      slow_parts_[2] = 0.0;
      slow_parts_[2] = -sum(1.0, 2) / krylov(3, stiffness_[0], 1.0, 2);
      stiffness_[0] -= 3.0 * sum(1.0, 3);
    }
  }
  for (Index i = slow_ ? 1 : 0; i < count; ++i) {
    const double kappa = wave_number(i, root, end);
    const Trial found = trial(kappa, root, end);
    waves_.push_back({kappa, found.cosine, 1.0, found.from_root, found.from_end});
    stiffness_[i] = std::pow(kappa, 4);
  }
  const Quadrature rule(2 * count + 30);
  const Vector mass = evaluate(rule.node, 0).cwiseAbs2().transpose() * rule.weight;
  if (slow_) slow_parts_ /= std::sqrt(mass[0]);
  for (Index i = slow_ ? 1 : 0; i < count; ++i) {
    Waves& of = waves_[static_cast<std::size_t>(slow_ ? i - 1 : i)];
    of.sine = 1.0 / std::sqrt(mass[i]);
    of.from_root *= of.sine;
    of.from_end *= of.sine;
    // This coefficient is chosen so that the sum in `evaluate` is exactly 0 at the root.
    of.cosine = -(of.from_end * std::exp(-of.kappa) + of.from_root);
  }
}

Matrix BeamModes::evaluate(const Vector& s, int derivative) const {
  const Index first = slow_ ? 1 : 0;
  Matrix out = Matrix::Zero(s.size(), stiffness_.size());
  for (Index p = 0; slow_ && p < s.size(); ++p) {
    for (int n = 0; n < 3; ++n) {
      out(p, 0) += slow_parts_[n] * krylov(n + 1, stiffness_[0], s[p], derivative);
    }
  }
  for (Index i = first; i < out.cols(); ++i) {
    const Waves& of = waves_[static_cast<std::size_t>(i - first)];
    const double factor = std::pow(of.kappa, derivative);
    const double parity = derivative == 1 ? -1.0 : 1.0;
    for (Index p = 0; p < s.size(); ++p) {
      const double cosine = std::cos(of.kappa * s[p]), sine = std::sin(of.kappa * s[p]);
      double waves = of.cosine * cosine + of.sine * sine;
      if (derivative == 1) waves = of.sine * cosine - of.cosine * sine;
      if (derivative == 2) waves = -waves;
      out(p, i) = factor * (waves + (of.from_end * std::exp(-of.kappa * (1.0 - s[p])) +
                                     parity * of.from_root * std::exp(-of.kappa * s[p])));
    }
  }
  return out;
}

EndShape::EndShape(double root, bool direction_held) {
  const bool hinged = root < infinite_stiffness;
  if (direction_held) {
    a = hinged ? 6.0 / (4.0 + root) : 0.0;
    b = hinged ? 3.0 * root / (4.0 + root) : 3.0;
    c = hinged ? -2.0 * (1.0 + root) / (4.0 + root) : -2.0;
  } else {
    a = hinged ? 3.0 / (3.0 + root) : 0.0;
    b = hinged ? 1.5 * root / (3.0 + root) : 1.5;
    c = hinged ? -0.5 * root / (3.0 + root) : -0.5;
  }
  force = -6.0 * c;
}

}  // namespace pipedyn
