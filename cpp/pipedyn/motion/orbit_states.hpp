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
                  layout.take(s * width), layout.take(n)};
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
      for (Count jump = (of.count - last) / 2; jump > 0; jump /= 2) {
        while (last + jump < of.count && of.edges[last + jump] <= inside) last += jump;
      }
      while (last + 1 < of.count && of.edges[last + 1] <= inside) ++last;
      own[lane] = last;
      const double size = of.edges[last + 1] - of.edges[last];
      durations[lane] = size / of.frequency;
      shares[lane] = (inside - of.edges[last]) / size;
      signs[lane] = std::fmod(turns, 2.0) != 0.0 ? of.mirror_sign : 1.0;
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
    for (Count lane = 0; lane < width && first + lane < points; ++lane) {
      const double* const start = of.starts + own[lane] * n;
      const double* const rates = of.rates + own[lane] * s * half;
      const double since = durations[lane] * shares[lane];
      for (Count c = 0; c < half; ++c) {
        state[c] = start[c] + since * start[half + c];
        state[half + c] = start[half + c];
      }
      for (Count k = 0; k < s; ++k) {
        const double position = twice[k * width + lane], speed = once[k * width + lane];
        for (Count c = 0; c < half; ++c) {
          state[c] += position * rates[k * half + c];
          state[half + c] += speed * rates[k * half + c];
        }
      }
      for (Count c = 0; c < n; ++c) out[c * points + first + lane] = signs[lane] * state[c];
    }
  }
}

}  // namespace
