// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <vector>

namespace pipedyn {

/// At least count numbers of the thread, on the boundary of the widest vector; the thread's next
/// call may overwrite or move them.
inline double* scratch(std::ptrdiff_t count) {
  struct alignas(64) Line {
    double numbers[8];
  };
  thread_local std::vector<Line> kept(1);
  const std::size_t needed = static_cast<std::size_t>(count + 7) / 8;
  if (kept.size() < needed) kept = std::vector<Line>(needed);
  return kept.data()->numbers;
}

}  // namespace pipedyn
