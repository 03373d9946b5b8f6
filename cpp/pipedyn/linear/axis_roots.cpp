// SPDX-License-Identifier: MIT
#include "pipedyn/linear/axis_roots.hpp"

#include <algorithm>
#include <cmath>

namespace pipedyn {

namespace {

/// Most iterations of Newton's method, which takes three or four from the cubic of a step.
constexpr int most_iterations = 12;

/// Relative length of a step of Newton's method below which its end is rounded.
constexpr double short_enough = 1e-8;

/// A number to 26 bits, by Veltkamp's splitting.
double rounded(double x) {
  const double large = 134217729.0 * x;  // 2^27 + 1
  return large - (large - x);
}

}  // namespace

double zero_between(const Function& f, double low, double high, double tolerance) {
  double a = low, b = high, fa = f(a), fb = f(b), share = 0.5, before = infinite;
  for (int evaluations = 1;; ++evaluations) {
    const double x = a + share * (b - a), fx = f(x);
    double c = b, fc = fb;  // the point that is dropped
    if ((fx > 0.0) == (fa > 0.0)) {
      c = a, fc = fa;
    } else {
      b = a, fb = fa;
    }
    a = x, fa = fx;
    const double least = tolerance / std::abs(b - a);
    if (fa == 0.0 || fb == 0.0 || !(least < 0.5)) return std::abs(fa) < std::abs(fb) ? a : b;
    const double xi = (a - b) / (c - b), phi = (fa - fb) / (fc - fb);
    share = 0.5;
    if (phi * phi < xi && (1.0 - phi) * (1.0 - phi) < 1.0 - xi) {
      share = fa / (fb - fa) * fc / (fb - fc) + (c - a) / (b - a) * fa / (fc - fa) * fb / (fc - fb);
    }
    share = std::clamp(share, least, 1.0 - least);
    // Noise of f about one end keeps the zero of the interpolating curve there, however far away
    // the other end is.
    if (evaluations % 4 != 0) continue;
    if (std::abs(b - a) > 0.5 * before) share = 0.5;
    before = std::abs(b - a);
  }
}

std::pair<double, Pair> newton(Spectrum& spectrum, double u, Pair guess, double low, double high) {
  double last = infinite;
  bool is_rounded = false;
  for (int iteration = 0;; ++iteration) {
    const bool ends = iteration == most_iterations || last == 0.0;
    Pair pair = spectrum.refined(u, guess, ends);
    const double change = -pair.value.real() / pair.slope.real(), size = std::abs(change);
    const bool inside = u + change >= low && u + change <= high;
    if (ends) return {u, std::move(pair)};
    if (!inside) return {u, spectrum.refined(u, pair)};
    u = std::max(u + change, 0.0);
    guess = std::move(pair);
    guess.value += guess.slope * change;
    // The last steps begin at a point to 26 bits. So their end does not depend on the guess, and a
    // pipe has the same answer whether it is searched alone or among others.
    if (size <= short_enough * (1.0 + u) && !std::exchange(is_rounded, true)) {
      u = rounded(u);
      guess.value = {0.0, rounded(guess.value.imag())};
      last = 1e-4;
      continue;
    }
    // Either the iteration has converged, or its steps do not shrink any more and what is left is
    // rounding. Convergence is quadratic: the next step would be shorter than this one in the
    // square of the ratio of this one to the last.
    const double ratio = last == infinite ? 1.0 : std::min(size / last, 1.0);
    const double next = size * ratio * ratio;
    const double rate = std::abs(guess.slope.real());
    const bool within = is_rounded && (next * rate <= 0.1 * guess.uncertain || next <= 4e-16 * u);
    last = within || size >= last ? 0.0 : size;
  }
}

double error_of(const Pair& pair) {
  const double rate = std::abs(pair.slope.real());
  return rate > 0.0 ? (pair.uncertain + std::abs(pair.value.real())) / rate : infinite;
}

}  // namespace pipedyn
