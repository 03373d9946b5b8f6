// SPDX-License-Identifier: MIT
#include "pipedyn/motion/orbit.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "pipedyn/pipe.hpp"

namespace pipedyn {

void states_at(const Polynomials& orbit, const double* phases, std::ptrdiff_t size, double* out) {
  const std::ptrdiff_t s = orbit.stages, half = orbit.half, n = 2 * half;
  const double span = orbit.edges[orbit.count];
  std::vector<double> legendre(s + 2), once(s), twice(s);
  for (std::ptrdiff_t k = 0; k < size; ++k) {
    const double turns = std::floor(phases[k] / span), inside = phases[k] - turns * span;
    const double* const after = std::upper_bound(orbit.edges, orbit.edges + orbit.count, inside);
    const std::ptrdiff_t m = std::max<std::ptrdiff_t>(after - orbit.edges - 1, 0);
    const double width = orbit.edges[m + 1] - orbit.edges[m], h = width / orbit.frequency;
    const double share = (inside - orbit.edges[m]) / width, x = 2.0 * share - 1.0;
    legendre[0] = 1.0;
    legendre[1] = x;
    for (std::ptrdiff_t j = 2; j < s + 2; ++j) {
      const double order = static_cast<double>(j);
      legendre[j] =
          ((2.0 * order - 1.0) * x * legendre[j - 1] - (order - 1.0) * legendre[j - 2]) / order;
    }
    std::fill(once.begin(), once.end(), 0.0);
    std::fill(twice.begin(), twice.end(), 0.0);
    for (std::ptrdiff_t i = 0; i < s + 2; ++i) {
      for (std::ptrdiff_t j = 0; j < s; ++j) {
        if (i < s + 1) once[j] += legendre[i] * orbit.once[i * s + j];
        twice[j] += legendre[i] * orbit.twice[i * s + j];
      }
    }
    const double sign = orbit.mirror < 0.0 && std::fmod(turns, 2.0) != 0.0 ? -1.0 : 1.0;
    const double* const start = orbit.starts + m * n;
    for (std::ptrdiff_t a = 0; a < half; ++a) {
      double position = start[a] + h * share * start[half + a], velocity = start[half + a];
      for (std::ptrdiff_t j = 0; j < s; ++j) {
        const double rate = orbit.rates[(m * s + j) * half + a];
        position += h * h * twice[j] * rate;
        velocity += h * once[j] * rate;
      }
      out[a * size + k] = sign * position;
      out[(half + a) * size + k] = sign * velocity;
    }
  }
}

std::vector<std::ptrdiff_t> carry_maps(const double* maps, std::ptrdiff_t count, std::ptrdiff_t n,
                                       std::ptrdiff_t columns, double most, double* out) {
  std::vector<std::ptrdiff_t> begins;
  for (std::ptrdiff_t m = 0; m < count; ++m) {
    const Eigen::Map<const Matrix> map(maps + m * n * columns, n, columns);
    Eigen::Map<Matrix> to(out + m * n * columns, n, columns);
    if (m > 0) {
      const Eigen::Map<const Matrix> before(to.data() - n * columns, n, columns);
      to.noalias() = map.leftCols(n) * before;
      to.rightCols(columns - n) += map.rightCols(columns - n);
      if ((to.leftCols(n).array().abs() < most).all()) continue;
    }
    to = map;
    begins.push_back(m);
  }
  return begins;
}

}  // namespace pipedyn
