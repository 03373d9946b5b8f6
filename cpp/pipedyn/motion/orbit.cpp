// SPDX-License-Identifier: MIT
#include "pipedyn/motion/orbit.hpp"

#include "pipedyn/pipe.hpp"

namespace pipedyn {

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
