// SPDX-License-Identifier: MIT
//
// States along a periodic orbit, from the polynomials through the accelerations at its stages.
//
// The file is local to each translation unit, like vector/pack.hpp.
#pragma once

#include "pipedyn/chain/motion.hpp"
#include "pipedyn/vector/layout.hpp"

namespace {

/// Implements MotionKernel::orbit_states, for as many phases at once as a pack has lanes.
void orbit_states(const pipedyn::OrbitPolynomials& of, const double* phases, Count points,
                  double* out) {
  const Count s = of.stages, half = of.half, n = 2 * half;
  struct Arrays {
    double *legendre, *less, *once, *twice, *state;
  };
  const auto [legendre, less, once, twice, state] = laid_out([&](Layout& layout) {
    return Arrays{layout.take((s + 2) * width), layout.take(s + 2), layout.take(s * width),
                  layout.take(s * width), layout.take(2 * width)};
  });
  // L(j) = x L(j - 1) + less(j) (x L(j - 1) - L(j - 2)), without a division in the recursion.
  for (Count j = 1; j < s + 2; ++j) less[j] = 1.0 - 1.0 / static_cast<double>(j);
  const double span = of.edges[of.count];
  Count last = 0;  // interval of the phase before, which is mostly near
  for (Count first = 0; first < points; first += width) {
    Count own[width];
    double durations[width], shares[width], signs[width];
    for (Count lane = 0; lane < width; ++lane) {
      const double at = phases[first + lane < points ? first + lane : points - 1];
      const double turns = std::floor(at / span), inside = at - turns * span;
      if (inside < of.edges[last]) last = 0;
      Count jump = inside < of.edges[last + 1] ? 0 : (of.count - last + 1) / 2;
      for (; jump > 0; jump /= 2) {
        while (last + jump < of.count && of.edges[last + jump] <= inside) last += jump;
      }
      own[lane] = last;
      const double size = of.edges[last + 1] - of.edges[last];
      durations[lane] = size / of.frequency;
      shares[lane] = (inside - of.edges[last]) / size;
      signs[lane] = 2.0 * std::floor(0.5 * turns) != turns ? of.mirror_sign : 1.0;
    }
    const Pack h = load<Pack>(durations), x = 2.0 * load<Pack>(shares) - 1.0;
    store(legendre, all<Pack>(1.0));
    store(legendre + width, x);
    for (Count j = 2; j < s + 2; ++j) {
      const Pack next = x * load<Pack>(legendre + (j - 1) * width);
      const Pack change = next - load<Pack>(legendre + (j - 2) * width);
      store(legendre + j * width, Pack(next + less[j] * change));
    }
    for (Count k = 0; k < s; ++k) {
      Pack single{}, twofold{};
      for (Count j = 0; j < s + 2; ++j) {
        const Pack value = load<Pack>(legendre + j * width);
        if (j < s + 1) single += of.single[j * s + k] * value;
        twofold += of.twofold[j * s + k] * value;
      }
      store(once + k * width, Pack(h * single));
      store(twice + k * width, Pack(h * h * twofold));
    }
    const Count there = points - first < width ? points - first : width;
    for (Count lane = 0, end = 0; lane < there; lane = end) {  // lanes in one interval
      while (end < there && own[end] == own[lane]) ++end;
      const double* const start = of.starts + own[lane] * n;
      const double* const rates = of.rates + own[lane] * s * half;
      for (Count c = 0; c < half; ++c) {
        Pack position = start[c] + h * load<Pack>(shares) * start[half + c];
        Pack speed = all<Pack>(start[half + c]);
        for (Count k = 0; k < s; ++k) {
          position += rates[k * half + c] * load<Pack>(twice + k * width);
          speed += rates[k * half + c] * load<Pack>(once + k * width);
        }
        store(state, Pack(load<Pack>(signs) * position));
        store(state + width, Pack(load<Pack>(signs) * speed));
        for (Count k = lane; k < end; ++k) {
          out[c * points + first + k] = state[k];
          out[(half + c) * points + first + k] = state[width + k];
        }
      }
    }
  }
}

}  // namespace
